--------------------------- MODULE AttackedTogether ---------------------------
(***************************************************************************)
(* T-9 on the radio of Attacker: a receiver that its prescriber has left   *)
(* does not stay for long.  Window takes the place of Delay.               *)
(***************************************************************************)
EXTENDS Together, TimedAttacker

AttackedTogetherView == <<AttackedView, apart>>

AttackedTogetherInit == TogetherInit /\ newest = [s \in Stations |-> None]

\* Replaces Alone: a liar is in no session.
AloneAmongTheLoyal(s) ==
  /\ Bound(st[s])
  /\ {s, Peer(st[s])} \subseteq Loyal
  /\ st[Peer(st[s])].session # st[s].session

\* The actions of TimedAttackedNext, counted.
CountKeptFireDue(s)  == KeptFireDue(s)  /\ Count
CountKeptObey(s)     == KeptObey(s)     /\ Count
CountKeptTRestart(s) == KeptTRestart(s) /\ Count
CountForgeNow(s)     == ForgeNow(s)     /\ Count
CountReplay          == Replay          /\ Count
CountReplayCam       == ReplayCam       /\ Count
CountOlderTick       == OlderTick       /\ Count

AttackedTogetherNext ==
  \/ \E s \in Honest :
       \/ CountKeptFireDue(s) \/ CountKeptObey(s) \/ CountKeptTRestart(s)
       \/ CountForgeNow(s)
  \/ CountReplay \/ CountReplayCam
  \/ CountOlderTick

AttackedTogetherSpec ==
  AttackedTogetherInit /\ [][AttackedTogetherNext]_<<tvars, newest, apart>>

\* As Leaving in Together: the prescriber finishes, aborts or restarts.
LeavingAttacked ==
  {[e EXCEPT !.aborters = Prescribers, !.commands = @ \ {"refuse"}] : e \in Attacked}

\* T-9
ActsOnUnderAttack(e) ==
  Max(Window + Verdict + CamLoss, Min(Lease, GiveUpTime + Window + CamLoss))
WaitsOnUnderAttack == Max(GiveUpTime, Window + Verdict) + HoldTime

THEOREM AttackedTogetherSpec => []LeftInv

\* A must-fail model replaces Alone: a liar, who drives with nobody, has left
\* from the start.
CommittedToLiar(s) == Acts(s, "receiver") /\ Peer(st[s]) \notin Honest
==============================================================================
