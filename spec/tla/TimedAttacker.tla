----------------------------- MODULE TimedAttacker -----------------------------
(***************************************************************************)
(* TimedSystem on the radio of Attacker.  `air` is what he has recorded    *)
(* and the envelope still lets through: what was sent is fresh for Window  *)
(* ticks, and meanwhile he delivers it whenever and as often as he likes,  *)
(* or never.  CAMs overtake each other, so whether one is newer is found   *)
(* out (ACT-5).                                                            *)
(*                                                                         *)
(* Window takes the place of Delay in the bound of T-2.  T-5 needs a       *)
(* Window of at most Min(LifeTime, QuarantineTime - CamLoss).              *)
(***************************************************************************)
EXTENDS Environments, Attacker

CONSTANT Window  \* ticks for which what was sent is fresh

VARIABLE newest  \* newest[s]: `left` of the last CAM that counted at s

AttackedView == <<tview, newest>>

None == 0 - 1

AttackedInit == EInit /\ newest = [s \in Stations |-> None]

\* The window of a message or CAM.
WindowOf(m) == Window

\* Replaces Copies.
Recorded(s, ms, counts) ==
  UNION { { [to |-> t, message |-> m, left |-> WindowOf(m), sure |-> FALSE] :
              t \in Addressees(m) \cap Honest } : m \in ms }

\* Where no CAM counts yet in this session, any does.
Newest(s, left) ==
  newest' = [newest EXCEPT ![s] = IF st'[s].heard THEN left ELSE None]
Kept(s) == Newest(s, newest[s])

\* An input that does nothing is no step.
Works(s, i) ==
  LET r == Effected(s, i) IN r.st # st[s] \/ r.out # {} \/ r.again # {}

\* The actions of TNext.
KeptFireDue(s)  == FireDue(s)  /\ Kept(s)
KeptObey(s)     == Obey(s)     /\ Kept(s)
KeptTRestart(s) == TRestart(s) /\ Kept(s)
OlderTick ==
  /\ Tick
  /\ newest' = [s \in Stations |-> Max(newest[s] - 1, None)]

Replay == \E c \in MessagesInAir : Arrives(c, {}) /\ Kept(c.to)

ReplayCam ==
  \E c \in CamsInAir :
  \E i \in {[InputOf(c) EXCEPT !.newer = c.left > newest[c.to]]} :
    /\ Due(c.to) = {}
    /\ Works(c.to, i)
    /\ TDo(c.to, i, {})
    /\ Newest(c.to, c.left)

\* He signs a CAM that names the session of its addressee.
CamForgeries(s) ==
  { [kind |-> "cam", src |-> p, newer |-> TRUE, marks |-> {st[s].session}] :
      p \in {q \in Stations \ {s} : MaySign(q)} }

ForgeNow(s) ==
  /\ Due(s) = {}
  /\ \E i \in Forgeries(s) \cup CamForgeries(s) :
       Works(s, i) /\ TDo(s, i, {}) /\ Kept(s)

TimedAttackedNext ==
  \/ \E s \in Honest :
       KeptFireDue(s) \/ KeptObey(s) \/ KeptTRestart(s) \/ ForgeNow(s)
  \/ Replay \/ ReplayCam
  \/ OlderTick

TimedAttackedSpec == AttackedInit /\ [][TimedAttackedNext]_<<tvars, newest>>

Attacked ==
  { [ Fault("attacked", FALSE, FALSE, {}, FALSE, FALSE, TRUE, FALSE)
        EXCEPT !.aborters = Honest, !.restarters = Restarters,
               !.commands = @ \cup {"refuse", "complete"} ] }

\* T-6 is about receivers that break off.
BreaksOffAttacked ==
  { [e EXCEPT !.aborters = Receivers,
              !.commands = {"request", "prescribe", "accept", "abort"}] :
      e \in Attacked }

\* T-2.
ClaimedUnderAttack(e) == Min(Lease, Window + CamLoss)

THEOREM TimedAttackedSpec => [](AcceptedInv /\ AgreementInv /\ SettledHazardInv)
THEOREM TimedAttackedSpec => [](DurationInv /\ HazardInv /\ SendingsInv)
THEOREM TimedAttackedSpec => [](LeaseInv /\ OrdersInv /\ OneWordInv)

(***************************************************************************)
(* Must-fail models                                                        *)
(***************************************************************************)
\* No freshness window for CAMs.  They still count in their order only.
CamsNeverStale(m) == IF m.type = "CAM" THEN Lease ELSE Window

TooLong(m) == Min(LifeTime, QuarantineTime - CamLoss) + 1

\* No last proposal (END-5).
AnyProposal(k) == TRUE

\* He sends CAMs only.
NoSayings(p, s, x) == {}
==============================================================================
