----------------------------- MODULE ProbeStation -----------------------------
(***************************************************************************)
(* As Probe, for one station to which anything may happen (OpenStation):   *)
(* every input in every state, also those that change nothing, so every    *)
(* rule, refusal and indication.  What is printed comes from what Step     *)
(* answered.  PNext is one action: it looks at all inputs of a state at    *)
(* once, as that of OpenStation does, and no counterexample comes of it.   *)
(***************************************************************************)
EXTENDS OpenStation

REACHED == 8

PInit ==
  /\ st = Initial
  /\ TLCSet(ALPHABET, TLCEval(AsSeq(Alphabet)))
  /\ TLCSet(REACHED, {})

\* Which refusal of a command: the rule tells.
Told(r) == IF r.told = Nothing THEN {}
           ELSE {"told " \o r.told[1]}
                \cup If(r.told[1] = "refused", {"refused by " \o r.rule})

Reached(r) ==
  {"rule " \o r.rule}
  \cup If(r.st # st, {"phase " \o r.st.role \o " " \o r.st.phase})
  \cup {"message " \o m.type : m \in r.out}
  \cup {"refusal " \o m.reason :
          m \in {k \in r.out : k.type = "Acceptance" /\ ~k.accepted}}
  \cup Told(r)

Note(things) ==
  \E new \in {things \ TLCGet(REACHED)} :
    /\ TLCSet(REACHED, TLCGet(REACHED) \cup new)
    /\ \A x \in new : PrintT(ToString(<<"REACHED", x>>))

PNext ==
  \E inputs \in {TLCGet(ALPHABET)} :
  \E results \in {TLCEval({Step(Me, st, inputs[j]) :
                    j \in {k \in 1 .. Len(inputs) : Offered(st, inputs[k])}})} :
    /\ Note(UNION {Reached(r) : r \in results})
    /\ \E r \in results : st' = r.st

PSpec == PInit /\ [][PNext]_st
==============================================================================
