--------------------------------- MODULE Drift ---------------------------------
(***************************************************************************)
(* Clocks that drift.  While a session lasts, the clock of one station may *)
(* lose SlowTicks ticks on the others: in such a tick its timers and its   *)
(* CAMs stand still.  So two clocks are never further apart than that.     *)
(*                                                                         *)
(* A prescriber's lease that is shorter by as much (ACT-4) still ends      *)
(* before its target's (T-4), so S-5 holds as it does with clocks that run *)
(* alike.  The hazard of T-2 lasts longer by the ticks that were lost: the *)
(* prescriber's cam timer is late by so much.                              *)
(***************************************************************************)
EXTENDS Environments

CONSTANTS
  Slow,       \* stations whose clock may be slow
  SlowTicks,  \* how many ticks a clock may lose
  Margin      \* by how much the prescriber's lease is shorter

VARIABLE lost  \* lost[s]: ticks that the clock of s has lost

DriftView == <<tview, lost>>

DriftInit == EInit /\ lost = [s \in Stations |-> 0]

SlowTick(s) ==
  /\ Goes
  /\ lost[s] < SlowTicks
  /\ \A t \in Stations \ {s} : lost[t] = 0
  /\ Pass({s})
  /\ lost' = [lost EXCEPT ![s] = @ + 1]

Kept == UNCHANGED lost

\* The actions of TNext, in which no clock loses anything.
KeptFireDue(s)  == FireDue(s)  /\ Kept
KeptObey(s)     == Obey(s)     /\ Kept
KeptTRestart(s) == TRestart(s) /\ Kept
KeptHearCam     == HearCam     /\ Kept
KeptDeliver     == Deliver     /\ Kept
KeptDuplicate   == Duplicate   /\ Kept
KeptCutOff      == CutOff      /\ Kept
KeptTick        == Tick        /\ Kept

DriftNext ==
  \/ \E s \in Stations : KeptFireDue(s) \/ KeptObey(s) \/ KeptTRestart(s)
  \/ KeptHearCam \/ KeptDeliver \/ KeptDuplicate
  \/ KeptCutOff
  \/ KeptTick
  \/ \E s \in Slow : SlowTick(s)

\* T-2 with drift.
LateBound(e) == BoundOf(e) + SlowTicks

DriftSpec == DriftInit /\ [][DriftNext]_<<tvars, lost>>

THEOREM DriftSpec => [](AcceptedInv /\ AgreementInv /\ SettledHazardInv)
THEOREM DriftSpec => [](HazardInv /\ LeaseInv)

\* Who may leave without the prescriber's hearing of it.
Unheard == {e \in Faults : e.name \in {"abort, lossy", "restart, lossy"}}
================================================================================
