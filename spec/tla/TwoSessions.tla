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

FewCommand(s) == \E i \in {c \in Commands(s) : c.name \in Given} : Do(s, i)
FewExpire(s)  ==
  \E i \in {x \in Expiries(s) : x.timer[1] \in Expiring} : Do(s, i)

FewNext ==
  \E s \in Stations : Restart(s) \/ FewExpire(s) \/ Receive(s) \/ FewCommand(s)

FewSpec == Init /\ [][FewNext]_vars

\* An Ack counts in whatever session its message was.
AckOfAnySession(e, m) ==
  /\ e.to = m.src
  /\ m.of[2] # 0
  /\ m.of = <<e.type, e.seq>>
=============================================================================
