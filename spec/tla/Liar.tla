--------------------------------- MODULE Liar ---------------------------------
(***************************************************************************)
(* System with a third station that lies under its own id.  It may say, at *)
(* any moment and to anybody, everything that a Lie can be: as if it were  *)
(* the prescriber or the receiver of a session that others are in.  What   *)
(* System claims of the others must hold all the same.                     *)
(*                                                                         *)
(* It is among Stations, as one that takes no input, so what it is said to *)
(* be in (nothing) is true; and what is sent to it is left out, for it     *)
(* says all it can anyway.  It neither advertises nor intends: whoever is  *)
(* in a session with it has a peer that lies, and no rule helps against    *)
(* that.                                                                   *)
(***************************************************************************)
EXTENDS System

CONSTANT Liar

Honest == Stations \ {Liar}

Sessions == {<<p, n>> : p \in Prescribers, n \in 1 .. MaxSessions}

\* Of one session, to station s.
LiesOf(x, s) ==
  {Fin(Liar, s, x), Cancel(Liar, s, x, "abort"),
   [Cancel(Liar, s, x, "closed") EXCEPT !.seq = AnswerSeq(1)]}
  \cup UNION {{Acceptance(Liar, x, k), Refusal(Liar, x, k, "unsafe"),
               Prescription(Liar, s, x, k)} : k \in 1 .. MaxRounds}
  \cup {[Message("Ack", Liar, s, x, 0) EXCEPT !.of = <<e.type, e.seq>>] :
          e \in st[s].outbox}

\* And an instruction of its own.
Lies(s) ==
  {Prescription(Liar, s, <<Liar, 1>>, 1)} \cup UNION {LiesOf(x, s) : x \in Sessions}

Lie(s) ==
  { [kind |-> "receive", message |-> m, concerned |-> FALSE] :
      m \in {k \in Lies(s) : k.dst = s} }

HearLie(s) == s # Liar /\ \E i \in Lie(s) : Do(s, i)

LiarNext ==
  \E s \in Honest :
    Restart(s) \/ Expire(s) \/ Receive(s) \/ Command(s) \/ HearLie(s)

LiarSpec == Init /\ [][LiarNext]_vars

\* Nothing is sent to the liar.
SentToTheHonest(air, ms) == air \cup {m \in ms : m.dst # Liar}

\* Nor is it remembered what the liar has sent (S-6 asks of the others).
ReceivedHonestly(i) ==
  IF i.kind = "receive" /\ i.message.src # Liar /\ i.message.seq # 0
     /\ i.message.type # "Advertisement"
  THEN {i.message} ELSE {}

THEOREM LiarSpec => [](TypeInv /\ AcceptedInv /\ AgreementInv /\ NoHazardInv)
THEOREM LiarSpec => [](ExclusiveInv)
THEOREM LiarSpec => OneSessionProp /\ CommitmentProp /\ NoCrossEffectProp
THEOREM ~Reduced => (LiarSpec => AckedProp)

\* Whoever speaks of the session is taken for the peer.
AnybodyIsPeer(x, src) == TRUE

\* Must-fail models look at one lie.
OnlyFin(x, s)        == {Fin(Liar, s, x)}
OnlyAcceptance(x, s) == {Acceptance(Liar, x, k) : k \in 1 .. MaxRounds}
==============================================================================
