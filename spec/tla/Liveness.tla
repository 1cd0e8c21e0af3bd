------------------------------- MODULE Liveness -------------------------------
(***************************************************************************)
(* What happens in the end: L-1 to L-4.                                    *)
(*                                                                         *)
(* The stations of System on another radio.  A message is taken out of the *)
(* air when it is received.  Any may be lost when it is sent, delivered    *)
(* and yet stay (a duplicate, and what is answered to it may be lost), and *)
(* overtaken.  At most Capacity messages are on their way to one station;  *)
(* one that does not fit is lost.  So the state space is                   *)
(* bounded by what the radio does, not by a constraint.  Nothing is        *)
(* reduced and no symmetry is used: each of them may hide a behaviour that *)
(* never ends.  The VIEW hides `last` alone, which names the step for the  *)
(* reader: no guard, fairness or property looks at it.                     *)
(*                                                                         *)
(* Fairness is what the world owes the protocol, and each property is      *)
(* checked with as little of it as it needs:                               *)
(*  - FairTimers: a timer that stays armed expires in the end.  That is    *)
(*    what a clock does; one that is stopped or armed anew again and again *)
(*    need not.  So nothing is assumed of the cam timer, nor of resend.    *)
(*    (The giveup timers of a station count as one here; as sessions and   *)
(*    rounds are finite in number, that is no more.)                       *)
(*  - FairMarks: the cam timer expires when the peer no longer names the   *)
(*    session.  Only a must-fail model needs it, lest it fail for less.    *)
(*  - FairSilence: the cam timer expires too once no CAM is heard.         *)
(*  - FairRadio: an entry of an outbox is sent again and again, and in the *)
(*    end a copy of it is not lost; what is in the air arrives, and what   *)
(*    is answered then is not lost.  (The copies that are lost, or whose   *)
(*    answer is lost, come before.)  With "a reliable message is not given *)
(*    up" (Patient) that is: one of its N copies gets through.             *)
(*  - FairDriver: an application that is asked answers, and ends its       *)
(*    maneuver.                                                            *)
(* All of it is weak fairness.  Nothing is assumed of requests and aborts, *)
(* of a refusal only (for L-2) that it is not the answer to the last       *)
(* proposal, and nothing of the radio for L-1, L-3 and L-4.                *)
(***************************************************************************)
EXTENDS Refinement

CONSTANTS
  Capacity,  \* messages on their way to one station
  Missing,   \* timers taken away: they never expire
  Patient    \* the assumptions of L-2, see MayFire

VARIABLES
  silent,    \* L-3: no CAM is heard any more
  asked,     \* history, for Coordination: what prescribers have asked
  agreed,    \* history, for Coordination: what receivers have agreed to
  fallback   \* history, if Patient: an application was told of a fallback

unused == <<excused, received>>
lvars  == <<st, net, unused, silent, asked, agreed, fallback>>

LInit ==
  Init /\ silent = FALSE /\ asked = {} /\ agreed = {} /\ fallback = FALSE

(***************************************************************************)
(* Steps                                                                   *)
(***************************************************************************)
\* What may be in the air after ms are sent: of those to each station, all
\* that fit.
Fits(air) ==
  \A s \in Stations : Cardinality(MessagesTo(air, s)) <= Capacity
Largest(airs) == {a \in airs : ~ \E b \in airs : a # b /\ a \subseteq b}
WithAll(air, ms)  == Largest({a \in {air \cup k : k \in SUBSET ms} : Fits(a)})
\* ... or any of them is lost.
WithSome(air, ms) ==
  {a \in {air \cup k : k \in SUBSET ms} : Fits(a)}

\* Something happens that is no step of a station.
Event(i) == [station |-> Nobody, input |-> i, rule |-> "none"]

Become(s, i, r, airs) ==
  /\ st' = [st EXCEPT ![s] = r.st]
  /\ net' \in airs
  /\ asked' = asked \cup Instructions(r.out)
  /\ agreed' = agreed \cup Agreements(r.out)
  /\ fallback' = (fallback \/ (Patient /\ r.told[1] = "fallback"))
  /\ last' = [station |-> s, input |-> i, rule |-> r.rule]
  /\ UNCHANGED <<unused, silent>>

\* Station s takes an input that does not come from the air.
Take(s, i) ==
  \E r \in {Decide(s, st[s], i)} :
    Become(s, i, r, WithSome(net, {Plain(m) : m \in r.out}))

Input(s, m) ==
  [kind |-> "receive", message |-> m, concerned |-> s \in Receivers]

Hear(s, m) ==
  \E r \in {Decide(s, st[s], Input(s, m))} :
    Become(s, Input(s, m), r, WithAll(net \ {m}, {Plain(k) : k \in r.out}))

Deliver(s) == \E m \in MessagesTo(net, s) : Hear(s, m)

Duplicate(s) ==
  \E m \in MessagesTo(net, s) :
  \E r \in {Decide(s, st[s], Input(s, m))} :
    Become(s, Input(s, m), r, WithSome(net, {Plain(k) : k \in r.out}))

\* What is in the air may still be lost as long as nothing is owed.
Lose ==
  /\ ~Patient
  /\ \E m \in net :
       /\ net' = net \ {m}
       /\ last' = Event([kind |-> "lose", message |-> m])
  /\ UNCHANGED <<st, unused, silent, asked, agreed, fallback>>

\* The peer's CAMs do not name the session (any more): none counts (ACT-5).
Unheard(s) == st[s].session \notin Marks(st[Peer(st[s])])

\* The assumptions of L-2 on timers: an Intention arrives inside the window;
\* one of the N copies of a reliable message and its Ack get through before
\* it is given up; applications answer in time and the lease is long enough;
\* CAMs are heard while the peer sends them with the mark (ACT-5).
MayFire(s, t) ==
  /\ t[1] \notin Missing
  /\ MayExpire(s, t)
  /\ Patient =>
       CASE t[1] = "advertise" -> st[s].recorded # {}
         [] t[1] = "cam"       -> Unheard(s)
         [] t[1] \in {"giveup", "decide", "hold", "answer", "lease"} -> FALSE
         [] OTHER              -> TRUE

Fire(s, names) ==
  \E t \in {x \in Armed(s, st[s]) : x[1] \in names /\ MayFire(s, x)} :
    Take(s, [kind |-> "expire", timer |-> t])

\* Sent again, and this copy is not lost.
Resent(s, k) ==
  \E t \in {x \in Armed(s, st[s]) :
               x[1] = "resend" /\ x[2].seq = k /\ MayFire(s, x)} :
  \E i \in {[kind |-> "expire", timer |-> t]} :
  \E r \in {Decide(s, st[s], i)} :
    Become(s, i, r, WithAll(net, {Plain(m) : m \in r.out}))

\* The assumption of L-2 on verdicts: the last proposal is accepted.
MayObey(c) == Patient /\ c.name = "refuse" => c.proposal < MaxRounds

Obey(s, names) ==
  \E c \in {x \in Obeyed(s, names) : MayObey(x)} : Take(s, c)

FallSilent == /\ ~silent /\ silent' = TRUE
              /\ last' = Event([kind |-> "silence"])
              /\ UNCHANGED <<st, net, unused, asked, agreed, fallback>>

Types  == {"Advertisement", "Intention", "Prescription", "Acceptance", "Fin",
           "Cancel", "Ack"}
Ending == {"advertise", "decide", "hold", "answer", "lease", "giveup"}
\* Those a station can arm.
EndingOf(s) == Ending \ (If(s \notin Receivers, {"hold"})
                         \cup If(s \notin Prescribers, {"advertise", "answer"}))
Asked  == {"prescribe", "accept", "complete"}
Free   == IF Patient THEN Asked \cup {"request", "close", "refuse"}
          ELSE Asked \cup {"request", "close", "proceed", "refuse", "abort"}

LNext ==
  \/ \E s \in Stations :
       \/ Deliver(s)
       \/ Duplicate(s)
       \/ Fire(s, Ending \cup {"cam", "resend", "backoff"})
       \/ Obey(s, Free)
  \/ Lose

(***************************************************************************)
(* Fairness                                                                *)
(***************************************************************************)
FairTimers  ==
  \A s \in Stations : \A n \in EndingOf(s) : WF_lvars(Fire(s, {n}))
FairSilence == \A s \in Stations : WF_lvars(silent /\ Fire(s, {"cam"}))
FairMarks  ==
  \A s \in Stations :
    WF_lvars(st[s].phase = "ACTUATING" /\ Unheard(s) /\ Fire(s, {"cam"}))
\* What arrives at a station in the end: a message of each type, and of each
\* proposal.
Kinds ==
  ({"Prescription", "Acceptance", "Ack"} \X (1 .. MaxRounds))
  \cup ((Types \ {"Prescription", "Acceptance", "Ack"}) \X {1})
KindsTo(s) ==
  {k \in Kinds :
     /\ s \notin Receivers =>
          k[1] \notin {"Advertisement", "Prescription", "Fin"}
     /\ s \notin Prescribers => k[1] \notin {"Intention", "Acceptance"}}
Kind(m) ==
  <<m.type, IF m.type = "Ack" THEN m.of[2]
            ELSE IF m.proposal = 0 THEN 1 ELSE m.proposal>>
FairRadio ==
  \A s \in Stations :
    /\ \A k \in 1 .. MaxRounds : WF_lvars(Resent(s, k))
    /\ \A y \in KindsTo(s) :
         WF_lvars(\E m \in MessagesTo(net, s) : Kind(m) = y /\ Hear(s, m))
FairDriver  == \A s \in Stations : WF_lvars(Obey(s, Asked))

LSpec      == LInit /\ [][LNext]_lvars /\ FairTimers
SilentSpec ==
  LInit /\ [][LNext \/ FallSilent]_lvars /\ FairTimers /\ FairSilence
MarkedSpec == LSpec /\ FairMarks
PatientSpec ==
  LInit /\ [][LNext]_lvars /\ FairTimers /\ FairRadio /\ FairDriver

(***************************************************************************)
(* L-1: every session ends.                                                *)
(***************************************************************************)
EndsProp == \A s \in Stations : Bound(st[s]) ~> ~Bound(st[s])

(***************************************************************************)
(* L-2: a request leads to both acting, then both STANDALONE with the Fin  *)
(* acknowledged, and no application is told of a fallback: both left by    *)
(* Fin.                                                                    *)
(***************************************************************************)
BothAct ==
  \E s, t \in Stations : /\ Acts(s, "prescriber") /\ Acts(t, "receiver")
                         /\ st[s].session = st[t].session
AllDone == \A s \in Stations : ~Bound(st[s]) /\ st[s].outbox = {}

CompletesProp ==
  /\ (\E s \in Stations : st[s].phase = "ADVERTISING") ~> BothAct
  /\ BothAct ~> AllDone
  /\ [](~fallback)

(***************************************************************************)
(* L-3: CAM silence leads to all STANDALONE; checked without the lease.    *)
(***************************************************************************)
SilenceProp == silent ~> \A s \in Stations : ~Bound(st[s])

(***************************************************************************)
(* L-4: every reliable message is acknowledged or given up: the outbox is  *)
(* empty again in the end.  (Sessions are finite in number here.)          *)
(***************************************************************************)
GivenUpProp ==
  \A s \in Stations : st[s].outbox # {} ~> st[s].outbox = {}

(***************************************************************************)
(* R-2: Coordination, its safety and its liveness.                         *)
(***************************************************************************)
Fulfilled == INSTANCE Coordination WITH
  Drivers <- Stations, Nothing <- NoSession, doing <- Driving
FulfilledProp == Fulfilled!Spec

(***************************************************************************)
(* What is claimed.                                                        *)
(***************************************************************************)
THEOREM Missing = {} /\ ~Patient => (LSpec => EndsProp /\ GivenUpProp /\ FulfilledProp)
THEOREM Patient => (PatientSpec => CompletesProp)
THEOREM "lease" \in Missing => (SilentSpec => SilenceProp)
==============================================================================
