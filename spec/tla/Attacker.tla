------------------------------- MODULE Attacker -------------------------------
(***************************************************************************)
(* System on a radio that an attacker serves.  Every message is signed, in *)
(* an envelope (docs/security.md).                                         *)
(*                                                                         *)
(* The attacker receives everything.  He drops, delays, reorders and       *)
(* replays what others have sent; the set of Network, which never shrinks, *)
(* allows that already.  At any moment he sends what the envelope lets him *)
(* send.  The keys that he has make three attackers:                       *)
(*   outsider  Keys = {}            he can sign nothing;                   *)
(*   insider   Keys outside Honest  he signs as stations of his own;       *)
(*   thief     Keys inside Honest   he signs as vehicles that drive on.    *)
(*                                                                         *)
(* The loyal are the honest stations whose keys he does not have.  The     *)
(* insider may send all that the vehicle of a thief and the thief send     *)
(* together, so what holds among the loyal with an insider holds with a    *)
(* thief.                                                                  *)
(*                                                                         *)
(* Reduced = TRUE is sound as in System while Signed = Fields: a message   *)
(* that is taken away can do nothing more, or the attacker can send it     *)
(* again.                                                                  *)
(***************************************************************************)
EXTENDS Refinement

CONSTANTS
  Honest,  \* stations that do what Station.tla says, and nothing else
  Keys     \* ids as which the attacker can sign

Loyal == Honest \ Keys

(***************************************************************************)
(* The envelope.  Must-fail models replace one of these, or Dies of System *)
(* (the freshness window: copies die).                                     *)
(***************************************************************************)
\* A certificate names the id as which its key may sign.
MaySign(src) == src \in Keys

\* The fields that the signature covers.
Fields == {"type", "src", "dst", "session", "seq", "proposal", "accepted",
           "reason", "of"}
Signed == Fields

ASSUME Honest \cup Keys = Stations
ASSUME Signed = Fields \/ ~Reduced

(***************************************************************************)
(* What the attacker sends                                                 *)
(***************************************************************************)
Sessions == (Prescribers \cup Keys) \X (1 .. MaxSessions)

SessionsOfOthers == (Prescribers \ Keys) \X (1 .. MaxSessions)

Proposals == 1 .. MaxRounds + 1

\* As p, to station s, of session x: as its prescriber, its receiver, or as
\* neither.  (An Ack of what s is not sending does nothing: END-6.)
Interjections(p, s, x) ==
  {Advertisement(p, x), Fin(p, s, x), Cancel(p, s, x, "as_sent"),
   [Cancel(p, s, x, "closed") EXCEPT !.seq = AnswerSeq(1)]}
  \cup UNION {{Prescription(p, s, x, k), Acceptance(p, x, k),
               Refusal(p, x, k, "as_sent"),
               [Refusal(p, x, k, "busy") EXCEPT !.seq = AnswerSeq(k)]} :
                k \in Proposals}
  \cup {[Message("Ack", p, s, x, 0) EXCEPT !.of = <<e.type, e.seq>>] :
          e \in st[s].outbox}

\* With an Intention he takes part in it.
Sayings(p, s, x) == {Intention(p, x)} \cup Interjections(p, s, x)

\* The values to which he changes a field.
Values(f) ==
  CASE f = "session"  -> Sessions
    [] f = "proposal" -> Proposals
    [] f = "accepted" -> BOOLEAN
    [] f = "of"       -> {<<e.type, e.seq>> :
                            e \in UNION {st[s].outbox : s \in Honest}}

\* A recorded message, changed in a field that the signature does not cover.
Changed(m) ==
  UNION {{[m EXCEPT ![f] = v] : v \in Values(f)} : f \in Fields \ Signed}

Forged(s) ==
  {m \in UNION {Sayings(p, s, x) : p \in {q \in Stations : MaySign(q)},
                                   x \in Sessions}
         \cup UNION {Changed(k) : k \in net} : m.dst \in {s, Broadcast}}

Forgeries(s) ==
  { [kind |-> "receive", message |-> m, concerned |-> s \in Receivers] :
      m \in Forged(s) }

Forge(s) == \E i \in Forgeries(s) : Do(s, i)

AttackedNext ==
  \E s \in Honest :
    Restart(s) \/ Expire(s) \/ Receive(s) \/ Command(s) \/ Forge(s)

AttackedSpec == Init /\ [][AttackedNext]_vars

\* Nothing need be sent to his own stations.
SentToTheHonest(air, ms) ==
  air \cup {m \in ms : m.dst \in Honest \cup {Broadcast}}

\* S-6 is about what the loyal send.
ReceivedFromTheLoyal(i) ==
  IF i.kind = "receive" /\ i.message.src \in Loyal /\ i.message.seq # 0
     /\ i.message.type # "Advertisement"
  THEN {i.message} ELSE {}

(***************************************************************************)
(* The properties among the loyal.  Acts is replaced by ActsAmongTheLoyal, *)
(* so the properties of System speak of sessions of the loyal only.        *)
(***************************************************************************)
ActsAmongTheLoyal(s, role) ==
  /\ st[s].phase = "ACTUATING" /\ st[s].role = role
  /\ {s, Peer(st[s])} \subseteq Loyal

\* S-6
LoyalAckedProp ==
  [][ LET s == last'.station IN
      /\ ~Reduced
      /\ s \in Loyal
      /\ last'.input.kind = "receive"
      /\ last'.input.message.type = "Ack"
      => \A e \in st[s].outbox \ st'[s].outbox :
           e.to \in Loyal => Copy(s, e) \in received ]_vars

\* R-1.  In a session with another, a loyal driver counts as alone.
LoyalDoing(s) ==
  IF {st[s].session[1], st[s].target} \subseteq Loyal \cup {Nobody}
  THEN Doing(s, st[s]) ELSE Doing(s, Initial)

AmongTheLoyal(agreements) ==
  {a \in agreements : {a[1][1], a[2]} \subseteq Loyal}

LoyalPromise == INSTANCE Coordination WITH
  Drivers <- Loyal, Nothing <- NoSession,
  doing <- [s \in Loyal |-> LoyalDoing(s)],
  asked <- AmongTheLoyal(Instructions(net)),
  agreed <- AmongTheLoyal(Agreements(net))

LoyalPromiseProp == LoyalPromise!Safe

(***************************************************************************)
(* What is claimed.                                                        *)
(***************************************************************************)
THEOREM AttackedSpec => [](TypeInv /\ AcceptedInv /\ AgreementInv)
THEOREM AttackedSpec => [](NoHazardInv /\ ExclusiveInv)
THEOREM AttackedSpec => OneSessionProp /\ CommitmentProp /\ NoCrossEffectProp
THEOREM AttackedSpec => LoyalPromiseProp
THEOREM ~Reduced => (AttackedSpec => LoyalAckedProp)

(***************************************************************************)
(* Must-fail models                                                        *)
(***************************************************************************)
\* A valid key signs as anybody.
AnyKey(src) == Keys # {}

AllButSession  == Fields \ {"session"}
AllButProposal == Fields \ {"proposal"}
AllButAccepted == Fields \ {"accepted"}
AllButOf       == Fields \ {"of"}

\* No freshness window.
NothingStale(i) == {}

\* Whoever speaks of the session is taken for the peer.
AnybodyIsPeer(x, src) == TRUE

\* One kind of message.
OnlyFin(p, s, x)        == {Fin(p, s, x)}
OnlyCancel(p, s, x)     == {Cancel(p, s, x, "as_sent")}
OnlyAcceptance(p, s, x) == {Acceptance(p, x, k) : k \in Proposals}
==============================================================================
