---------------------------- MODULE AttackedLiveness ----------------------------
(***************************************************************************)
(* L-1, L-3, L-4 and R-2 on the radio of Attacker.  It owes nothing: he    *)
(* delivers what he has recorded whenever and as often as he likes, or     *)
(* never.  So of the fairness of Liveness only that of the timers is left, *)
(* and L-2 says nothing.                                                   *)
(***************************************************************************)
EXTENDS Liveness, Attacker

\* Replaces WithSome: all that is sent is recorded.
Recording(air, ms) == {SentToTheHonest(air, ms)}

ForgeSome(s) ==
  \E i \in Forgeries(s) : Decide(s, st[s], i).st # st[s] /\ Take(s, i)

AttackedLivenessNext ==
  \E s \in Honest :
    \/ Duplicate(s)
    \/ ForgeSome(s)
    \/ Fire(s, Ending \cup {"cam", "resend", "backoff"})
    \/ Obey(s, Free)

AttackedLivenessSpec == LInit /\ [][AttackedLivenessNext]_lvars /\ FairTimers

\* L-3: from some moment on no CAM is heard, not even one of his.
AttackedSilentSpec ==
  LInit /\ [][AttackedLivenessNext \/ FallSilent]_lvars
  /\ FairTimers /\ FairSilence

LoyalFulfilled == INSTANCE Coordination WITH
  Drivers <- Loyal, Nothing <- NoSession,
  doing <- [s \in Loyal |-> LoyalDoing(s)],
  asked <- AmongTheLoyal(asked),
  agreed <- AmongTheLoyal(agreed)

\* R-2 among the loyal.
LoyalFulfilledProp == LoyalFulfilled!Spec

THEOREM AttackedLivenessSpec => EndsProp /\ GivenUpProp /\ LoyalFulfilledProp
THEOREM "lease" \in Missing => (AttackedSilentSpec => SilenceProp)
==============================================================================
