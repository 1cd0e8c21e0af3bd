--------------------------------- MODULE Naive ---------------------------------
(***************************************************************************)
(* The radio as one would write it down at first: what is received is      *)
(* taken out of the net, and Lose takes out anything.  Only for comparison *)
(* with the set that never shrinks (Network.tla, automcm bench encodings): the  *)
(* stations, their inputs and the properties are those of System, nothing  *)
(* is reduced, and nothing else in the project rests on this module.       *)
(*                                                                         *)
(*  Copies = 1  a set; a message may also be received and stay (a          *)
(*              duplicate).                                                *)
(*  Copies = 2  a bag with at most two copies of a message: the second     *)
(*              comes from sending it again, and a third is lost.  The     *)
(*              radio itself duplicates nothing: fewer behaviours, to the  *)
(*              advantage of the bag.                                      *)
(*                                                                         *)
(* It is NOT for more than one receiver: an Advertisement is taken out by  *)
(* the first that hears it.  Nor for forgetting, which needs copies to die *)
(* out.                                                                    *)
(***************************************************************************)
EXTENDS System, TLC

CONSTANTS
  Copies,   \* of a message in the net: 1 or 2
  Seconds   \* after these TLC ends, finished or not (0: never)

ASSUME Copies \in 1 .. 2 /\ ~Reduced /\ ~Forgetting /\ Restarters = {}

VARIABLES
  twice,     \* the messages of net with a second copy in it
  accepted   \* history: Acceptances sent in the open sessions (S-3)

naiveView == <<st, net, twice, excused, accepted>>

NaiveInit == Init /\ twice = {} /\ accepted = {}

\* net and twice without one copy of each of ms.
One(ms) == net \ (ms \ twice)
Two(ms) == twice \ ms

\* What an input may take out: a set of messages.
Takes(i) ==
  IF i.kind # "receive" THEN {{}}
  ELSE IF Copies = 1 THEN {{i.message}, {}}
  ELSE {{i.message}}

\* Kept only while the prescriber is in the session, so that it costs little.
Accepted(x, ms) ==
  {m \in accepted \cup {k \in ms : k.type = "Acceptance" /\ k.accepted} :
     x[m.session[1]].session = m.session}

NaiveDo(s, i) ==
  \E r \in {Decide(s, st[s], i)} : \E ms \in Takes(i) :
  \E x \in {[st EXCEPT ![s] = r.st]} : \E out \in {{Plain(m) : m \in r.out}} :
    /\ st' = x
    /\ net' = One(ms) \cup out
    /\ twice' = Two(ms) \cup If(Copies = 2, One(ms) \cap out)
    /\ accepted' = Accepted(x, out)
    /\ excused' = IF Excuses(s, i) THEN excused \cup {<<st[s].session, s>>}
                  ELSE excused
    /\ last' = [station |-> s, input |-> i, rule |-> r.rule]
    /\ UNCHANGED received

Lose ==
  \E m \in net :
    /\ net' = One({m})
    /\ twice' = Two({m})
    /\ last' = [station |-> Nobody, input |-> [kind |-> "lose"], rule |-> "none"]
    /\ UNCHANGED <<st, excused, received, accepted>>

NaiveExpire(s)  == \E i \in Expiries(s)   : NaiveDo(s, i)
NaiveReceive(s) == \E i \in Receptions(s) : NaiveDo(s, i)
NaiveCommand(s) == \E i \in Commands(s)   : NaiveDo(s, i)

NaiveNext ==
  \/ Lose
  \/ \E s \in Stations : NaiveExpire(s) \/ NaiveReceive(s) \/ NaiveCommand(s)

NaiveSpec == NaiveInit /\ [][NaiveNext]_<<vars, twice, accepted>>

\* S-3, with the history instead of the net.
NaiveAcceptedInv ==
  \A s \in Stations : Acts(s, "prescriber") =>
    \E m \in accepted : /\ m.src = st[s].target /\ m.dst = s
                        /\ m.session = st[s].session
                        /\ m.proposal = st[s].proposal

\* A constraint that is always true: it ends TLC when the time is over.  It
\* names a variable because TLC evaluates what names none only once.
TimeBox ==
  Seconds > 0 /\ st = st /\ TLCGet("duration") >= Seconds
    => TLCSet("exit", TRUE)
==============================================================================
