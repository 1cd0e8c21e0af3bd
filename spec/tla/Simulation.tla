------------------------------ MODULE Simulation ------------------------------
(***************************************************************************)
(* For random behaviours: System's steps without those that end a session  *)
(* early, so that a walk gets as far as driving.  Every step here is one   *)
(* of System; behaviours with the others are those of AnyNext.             *)
(*                                                                         *)
(* TLC chooses an action first, and then one of its successors.  So each   *)
(* station has one action here, not one for each kind of input as in       *)
(* System: a restart would come as often as a message.                     *)
(***************************************************************************)
EXTENDS System

Inputs(s) ==
  Receptions(s) \cup Commands(s) \cup Expiries(s)
  \cup If(s \in Restarters, {[kind |-> "restart"]})

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

AnyNext    == \E s \in Stations : \E i \in Inputs(s) : Do(s, i)
LivelyNext == \E s \in Stations : \E i \in Inputs(s) : ~Early(s, i) /\ Do(s, i)

AnySpec    == Init /\ [][AnyNext]_vars
LivelySpec == Init /\ [][LivelyNext]_vars

\* It is Next, with its actions put together.
THEOREM AnySpec <=> Spec
==============================================================================
