----------------------------- MODULE ProbeStation -----------------------------
(***************************************************************************)
(* As Probe, for one station to which anything may happen: every input in  *)
(* every state, also those that change nothing, so every rule, refusal and *)
(* indication.  What is printed comes from the step that was taken.        *)
(***************************************************************************)
EXTENDS StationProperties

\* A register of TLC; one worker only.
REACHED == 8

PInit == TLCSet(REACHED, {}) /\ SInit

\* Which refusal of a command: the rule tells.
Told(r) == IF r.told = Nothing THEN {}
           ELSE {"told " \o r.told[1]}
                \cup If(r.told[1] = "refused", {"refused by " \o r.rule})

Reached(r) ==
  {"rule " \o r.rule}
  \cup If(st' # st, {"phase " \o st'.role \o " " \o st'.phase})
  \cup {"message " \o m.type : m \in r.out}
  \cup {"refusal " \o m.reason :
          m \in {k \in r.out : k.type = "Acceptance" /\ ~k.accepted}}
  \cup Told(r)

Note(things) ==
  \E new \in {things \ TLCGet(REACHED)} :
    /\ TLCSet(REACHED, TLCGet(REACHED) \cup new)
    /\ \A x \in new : PrintT(ToString(<<"REACHED", x>>))

Noted == Note(Reached(last'))

PSpec == PInit /\ [][SNext]_<<st, last>>
==============================================================================
