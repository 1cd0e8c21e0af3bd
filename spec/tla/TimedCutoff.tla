----------------------------- MODULE TimedCutoff -----------------------------
(***************************************************************************)
(* Cutoff with real durations: one session of any number of stations,      *)
(* which are its prescriber and two of its receivers.                      *)
(*                                                                         *)
(* It is TimedSystem, and a receiver may break off a commitment in another *)
(* session, which puts it in quarantine.  What else happens elsewhere      *)
(* needs no step: `busy` has the effect of `unknown_session` (NEG-7), and  *)
(* a newer session of the same prescriber bars one that is over, and keeps *)
(* it barred for longer.  A prescriber that turns to a station outside has *)
(* left for those here, as if it aborted.                                  *)
(***************************************************************************)
EXTENDS Environments

ASSUME Receivers \cap Prescribers = {}

\* ACT-6.  Once its prescriber is gone it makes no difference to the session.
QuarantineElsewhere(s) ==
  /\ PrescriberGoes
  /\ ~Bound(st[s]) /\ ~st[s].quarantine
  /\ \E x \in {[st[s] EXCEPT !.quarantine = TRUE]} :
       /\ st' = [st EXCEPT ![s] = x]
       /\ clock' = [clock EXCEPT ![s] =
                      [t \in Armed(s, x) |-> IF t \in DOMAIN @ THEN @[t]
                                             ELSE Duration(s, t)]]
  /\ last' = [Event("quarantine elsewhere") EXCEPT !.station = s]
  /\ UNCHANGED <<net, excused, received, env, cut, air, next, age, sends, been,
                 hazard>>

TimedCutoffNext ==
  \/ \E s \in Stations   : FireDue(s) \/ Obey(s) \/ TRestart(s)
  \/ \E s \in Receivers  : QuarantineElsewhere(s)
  \/ HearCam \/ Deliver \/ Duplicate
  \/ CutOff
  \/ Tick

TimedCutoffSpec == EInit /\ [][TimedCutoffNext]_tvars

\* Everything but duplicates; Delay = 0 leaves no other.
InCompany == {[e EXCEPT !.duplicates = FALSE] : e \in Worst}

\* Interchangeable stations.  Ids are model values then.
Symmetry ==
  {f @@ g : f \in Permutations(Prescribers), g \in Permutations(Receivers)}

THEOREM TimedCutoffSpec => [](AcceptedInv /\ AgreementInv /\ SettledHazardInv)
THEOREM TimedCutoffSpec => [](DurationInv /\ HazardInv /\ SendingsInv)
THEOREM TimedCutoffSpec => [](LeaseInv /\ OrdersInv)
THEOREM TimedCutoffSpec => OneSessionProp /\ CommitmentProp /\ NoCrossEffectProp

(***************************************************************************)
(* Must-fail models                                                        *)
(***************************************************************************)
\* A CAM of anybody in the session counts (ACT-5).
AnybodyIsPeer(x, src) == TRUE
==============================================================================
