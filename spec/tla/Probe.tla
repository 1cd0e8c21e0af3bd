-------------------------------- MODULE Probe --------------------------------
(***************************************************************************)
(* What the models reach, lest a property hold for want of anything        *)
(* happening.  What is printed comes from the step that was taken (last'   *)
(* and what it left), never from a guard: without the step it is gone.     *)
(* Each thing is printed once.  The steps are those of System; an action   *)
(* constraint that is always true prints.                                  *)
(***************************************************************************)
EXTENDS System, TLC, Sequences

\* A register of TLC; one worker only.
REACHED == 8

PInit == TLCSet(REACHED, {}) /\ Init

Refusals(ms) == {m \in ms : m.type = "Acceptance" /\ ~m.accepted}

Reached ==
  LET x == st'[last'.station] IN
  {"rule " \o last'.rule}
  \cup {"phase " \o x.role \o " " \o x.phase}
  \cup {"message " \o m.type : m \in net' \ net}
  \cup {"refusal " \o m.reason : m \in Refusals(net' \ net)}

Note(things) ==
  \E new \in {things \ TLCGet(REACHED)} :
    /\ TLCSet(REACHED, TLCGet(REACHED) \cup new)
    /\ \A x \in new : PrintT(ToString(<<"REACHED", x>>))

Noted == Note(Reached)

PSpec == PInit /\ [][Next]_vars
==============================================================================
