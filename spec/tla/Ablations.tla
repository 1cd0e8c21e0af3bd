------------------------------ MODULE Ablations ------------------------------
(***************************************************************************)
(* One mechanism taken away at a time.  A must-fail model replaces a guard *)
(* of Station.tla by one of these in its cfg (Guard <- NoGuard) and names  *)
(* the property that must break (docs/protocol.md, "Every mechanism is     *)
(* needed").                                                               *)
(***************************************************************************)
EXTENDS System

\* No session number: a message counts for any session of its prescriber.
NoSessionNumber(s, t) == s[1] = t[1]

\* No proposal number: an Acceptance counts for whatever is proposed now.
NoProposalNumber(k, l) == TRUE

\* An Ack without type and seq: it counts for anything sent to its sender.
BareAck(e, m) == e.to = m.src /\ e.session = m.session

\* A receiver that breaks its commitment off may request a maneuver at once.
AlwaysMayRequest(x) == TRUE

\* To look at less: station 2 requests while station 1 acts on its word.
WhileOneActs == st[2].number = 1 => st[1].phase = "ACTUATING" /\ st[1].target = 2

\* Answers carry a real seq, so their Acks look like those of messages.
RealSeq(seq) == seq

\* No busy refusal: the instruction of another session is taken up.
NoBusyRefusal(me, x, m) ==
  IF Bound(x) THEN
    Effect([Leave(x) EXCEPT !.phase = "NEGOTIATING", !.role = "receiver",
                             !.session = m.session, !.proposal = m.proposal,
                             !.joined = @ \cup {m.session}],
           {Ack(me, m)}, <<"verify">>, "NEG-4")
  ELSE Answer(x, RefusalAnswer(me, m, "unknown_session"), "NEG-5")

\* A receiver may join a session again.
Rejoin(x, s) == TRUE

\* No quarantine after a restart.
NoQuarantine(x) == FALSE

\* A refused prescriber names another target, one that it has released.
Retarget(x, p) ==
  \/ p = x.target
  \/ \E m \in net : /\ m.type = "Cancel" /\ m.reason = "as_sent"
                    /\ m.dst = p /\ m.session = x.session

\* An Ack counts whoever it comes from.
AckFromAnybody(e, m) ==
  /\ e.session = m.session
  /\ m.of[2] # 0
  /\ m.of = <<e.type, e.seq>>

\* The memory of a session is dropped at once.
ForgetAtOnce(s, t) == TRUE
NothingDies(i) == {}

\* The receiver lets go when its Acceptance is not acked.
AbandonAcceptance(me, x, e) ==
  IF e.type = "Acceptance" /\ e.accepted
  THEN CancelPeer(me, x, "timeout", "NEG-9")
  ELSE GiveUpEntry(me, x, e)

\* The two leases end in any order.
AnyLeaseOrder(s) == TRUE
==============================================================================
