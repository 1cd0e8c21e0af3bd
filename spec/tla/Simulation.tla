------------------------------ MODULE Simulation ------------------------------
(***************************************************************************)
(* For random behaviours: System's steps without those that end a session  *)
(* early, so that a walk gets as far as driving.  Every step here is one   *)
(* of System; behaviours with the others come from System itself.          *)
(***************************************************************************)
EXTENDS System

Early(s, i) ==
  LET x == st[s] IN
  CASE i.kind = "restart" -> TRUE
    [] i.kind = "command" -> \/ i.name = "proceed"
                             \/ i.name = "abort" /\ x.phase # "ACTUATING"
    [] i.kind = "expire"  ->
         \/ i.timer[1] \in {"hold", "decide", "answer", "cam", "lease"}
         \/ i.timer[1] = "advertise" /\ x.recorded = {}
         \/ i.timer[1] = "giveup" /\ i.timer[2].type \in {"Intention", "Prescription"}
    [] OTHER              -> FALSE

LivelyNext == \E s \in Stations : \E i \in Inputs(s) : ~Early(s, i) /\ Do(s, i)
==============================================================================
