------------------------------- MODULE Together -------------------------------
(***************************************************************************)
(* With a perfect radio, those who belong together leave together.  A      *)
(* station that leaves a session tells everybody whom that concerns, by a  *)
(* Fin, a Cancel, or Cancel(closed) as an answer to an Intention that came *)
(* too late: so nobody stays in a session whose other side has left it for *)
(* longer than a copy takes there and back.  Where it is not perfect, a    *)
(* receiver that was left still does not stay for long (T-9).              *)
(***************************************************************************)
EXTENDS Environments

VARIABLE apart  \* apart[s]: ticks for which s has been left alone

TogetherView == <<tview, apart>>

\* Nothing is lost; everybody may abort.
Perfect ==
  { [ Fault("none", TRUE, TRUE, {}, FALSE, FALSE, TRUE, FALSE)
        EXCEPT !.aborters = Stations,
               !.commands = {"request", "close", "prescribe", "proceed",
                             "accept", "refuse", "complete", "abort"} ] }

\* In a session that its other side is not in, or no longer.
Alone(s) ==
  /\ Bound(st[s])
  /\ Peer(st[s]) # Nobody
  /\ st[Peer(st[s])].session # st[s].session

TogetherInit == EInit /\ apart = [s \in Stations |-> 0]

Count ==
  apart' = [s \in Stations |->
              IF ~Alone(s)' THEN 0
              ELSE IF last'.input.kind = "tick" THEN apart[s] + 1
              ELSE apart[s]]

\* The actions of TNext, counted.  (TLC takes a conjunction for one action: of
\* TNext /\ Count it would name none.)
CountFireDue(s)  == FireDue(s)  /\ Count
CountObey(s)     == Obey(s)     /\ Count
CountTRestart(s) == TRestart(s) /\ Count
CountHearCam     == HearCam     /\ Count
CountDeliver     == Deliver     /\ Count
CountDuplicate   == Duplicate   /\ Count
CountCutOff      == CutOff      /\ Count
CountTick        == Tick        /\ Count

TogetherNext ==
  \/ \E s \in Stations : CountFireDue(s) \/ CountObey(s) \/ CountTRestart(s)
  \/ CountHearCam \/ CountDeliver \/ CountDuplicate
  \/ CountCutOff
  \/ CountTick

(***************************************************************************)
(* T-7: within twice the delay.                                            *)
(***************************************************************************)
TogetherInv == \A s \in Stations : apart[s] <= 2 * Delay

TogetherSpec == TogetherInit /\ [][TogetherNext]_<<tvars, apart>>

(***************************************************************************)
(* T-9: a receiver that its prescriber has left does not stay for long,    *)
(* whatever is lost.                                                       *)
(*   acting  The last CAM with the mark may have been sent as the          *)
(*           prescriber left, or as it gave up its Fin.  Or the receiver   *)
(*           accepts only then: the last Prescription, too, is sent before *)
(*           the prescriber leaves.                                        *)
(*   waiting The hold timer runs from the give-up of the Intention, or     *)
(*           from the refusal of the last Prescription.                    *)
(***************************************************************************)
Verdict == IF Prompt THEN 0 ELSE Deciding

ActsOn(e) ==
  Max(Delay + Verdict + CamLoss,
      IF "complete" \in e.commands
      THEN Min(Lease, GiveUpTime + Delay + CamLoss) ELSE 0)
WaitsOn == Max(GiveUpTime, Delay + Verdict) + HoldTime

MayActOn(e) == ActsOn(e)
MayWaitOn   == WaitsOn

LeftInv ==
  \A s \in Stations :
    st[s].role = "receiver" =>
      apart[s] <= IF st[s].phase = "ACTUATING" THEN MayActOn(env) ELSE MayWaitOn

THEOREM TogetherSpec => []TogetherInv
THEOREM TogetherSpec => []LeftInv

\* The prescriber finishes, aborts or restarts, and what may be lost may be lost.
Leaving ==
  { [Fault("finishes", FALSE, TRUE, {}, FALSE, FALSE, FALSE, FALSE)
       EXCEPT !.commands = {"request", "close", "prescribe", "accept", "complete"}],
    [Fault("aborts", FALSE, TRUE, {}, FALSE, FALSE, FALSE, FALSE)
       EXCEPT !.aborters = Prescribers, !.commands = @ \cup {"close"}],
    [Fault("restarts", FALSE, FALSE, {}, FALSE, FALSE, FALSE, FALSE)
       EXCEPT !.restarters = Prescribers, !.commands = @ \cup {"close"}] }

\* When the receivers have left there is nothing more to see.
ReceiverGoes == \E s \in Receivers : Bound(st[s]) \/ st[s].joined = {}

\* Must-fail models: one tick less.
Finishing == {e \in Leaving : e.name = "finishes"}
Aborting  == {e \in Leaving : e.name = "aborts"}
ActsOnOneLess(e) == ActsOn(e) - 1
WaitsOnOneLess   == WaitsOn - 1

\* ADV-9 without its phase: the window closes once more, whatever the phase.
ClosesInAnyPhase(me, x, c) ==
  IF c.session # x.session THEN Refuse(x, "PRE-5")
  ELSE [OnAdvertiseEnd(me, x) EXCEPT !.rule = "ADV-9"]

\* ADV-9 without stopping the advertise timer.
RunsAfterClosing(s, i, r) ==
  Armed(s, r.st)
  \cup If(Bound(r.st), {Timer("advertise")} \cap (DOMAIN clock[s] \ Expired(i)))

\* A prescriber releases nobody whom it has not chosen.
KeepsTheOthers(me, x, to, why) ==
  IF why = "not_selected" THEN {}
  ELSE {Cancel(me, p, x.session, why) : p \in to}
==============================================================================
