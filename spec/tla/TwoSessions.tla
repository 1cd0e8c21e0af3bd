------------------------------ MODULE TwoSessions ------------------------------
(***************************************************************************)
(* Every message and every Ack by itself, with two sessions.  S-6 and S-7  *)
(* look at Acks, which the reduced models do not have; and where nothing   *)
(* is reduced, two sessions with all inputs are too many states.  So here  *)
(* only some commands are given, and only some timers expire.              *)
(***************************************************************************)
EXTENDS System

CONSTANTS
  Given,    \* names of commands
  Expiring  \* names of timers

FewInputs(s) ==
  { i \in Inputs(s) :
      CASE i.kind = "command" -> i.name \in Given
        [] i.kind = "expire"  -> i.timer[1] \in Expiring
        [] OTHER              -> TRUE }

FewNext == \E s \in Stations : \E i \in FewInputs(s) : Do(s, i)

\* An Ack counts in whatever session its message was.
AckOfAnySession(e, m) ==
  /\ e.to = m.src
  /\ m.of[2] # 0
  /\ m.of = <<e.type, e.seq>>
=============================================================================
