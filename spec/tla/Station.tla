------------------------------- MODULE Station -------------------------------
(***************************************************************************)
(* What ONE station does.  Step(me, st, input) is a function: the next     *)
(* station, the messages it sends, the timers it arms and stops, what its  *)
(* application is told, and the id of the rule that decided                *)
(* (docs/protocol.md).                                                     *)
(*                                                                         *)
(* There is no network here, no second station and no duration.  All       *)
(* choice (accept or refuse, whom to prescribe, which timer expires, what  *)
(* is lost) comes from outside, as the input.                              *)
(*                                                                         *)
(* What is deliberately left out:                                          *)
(*  - content.  Trajectories, scenarios, hold and lease are opaque to the  *)
(*    service.  An outbox entry keeps what identifies a message; a copy of *)
(*    it carries the content "as_sent".                                    *)
(*  - the counter behind seq.  Within one session, addressee and type, a   *)
(*    reliable message is identified by its proposal (Prescription,        *)
(*    Acceptance) or is the only one (Intention, Fin, Cancel).  So seq is  *)
(*    the proposal or 1 here; an answer has 0.                             *)
(*  - form.  A message that is malformed (a field missing, an answer with  *)
(*    a seq, a Fin without one) never gets here: the decoder reports it    *)
(*    (END-5).                                                             *)
(*  - generation times of CAMs: the input says whether a CAM is newer than *)
(*    the last one that counted, and not too far ahead (ACT-5.3).          *)
(***************************************************************************)
EXTENDS Naturals, FiniteSets

CONSTANTS
  MaxRounds,        \* proposals in a session (max_rounds), the same everywhere
  MaxParticipants,  \* stations recorded or withdrawn in a session
  OutboxLimit,      \* entries of the outbox
  MemoryLimit       \* prescribers remembered (ADV-8)

Nobody    == 0
Broadcast == 0
NoSession == <<0, 0>>      \* a session is <<prescriber, number>>

Phases == {"STANDALONE", "ADVERTISING", "CHOOSING", "PRESCRIBING",
           "INTENDING", "WAITING", "NEGOTIATING", "ACTUATING"}
Roles  == {"none", "prescriber", "receiver"}

(***************************************************************************)
(* The station                                                             *)
(***************************************************************************)
Initial ==
  [ phase      |-> "STANDALONE",
    role       |-> "none",
    session    |-> NoSession,  \* the session it is bound to
    recorded   |-> {},         \* ADVERTISING, CHOOSING: stations that intend
    withdrawn  |-> {},         \* ADVERTISING: stations that cancelled
    target     |-> Nobody,     \* prescriber, from PRESCRIBING on
    proposal   |-> 0,          \* the last one sent, or seen
    deciding   |-> FALSE,      \* prescriber, NEGOTIATING: computes the next
    heard      |-> FALSE,      \* ACTUATING: a CAM has counted (ACT-5)
    number     |-> 0,          \* of its last own session
    joined     |-> {},         \* newest session joined, per prescriber
    outbox     |-> {},         \* reliable messages still being sent
    quarantine |-> FALSE,      \* joins, requests nothing (END-8, ACT-6)
    backoff    |-> FALSE ]     \* after a session without participants (END-7)

Bound(st) == st.phase # "STANDALONE"
Peer(st)  == IF st.role = "receiver" THEN st.session[1] ELSE st.target

(***************************************************************************)
(* Messages, outbox entries                                                *)
(***************************************************************************)
Message(type, src, dst, session, seq) ==
  [ type |-> type, src |-> src, dst |-> dst, session |-> session, seq |-> seq,
    proposal |-> 0, accepted |-> FALSE, reason |-> "none",
    of |-> <<"none", 0>> ]

Advertisement(me, s)   == Message("Advertisement", me, Broadcast, s, 1)
Intention(me, s)       == Message("Intention", me, s[1], s, 1)
Prescription(me, to, s, k) ==
  [Message("Prescription", me, to, s, k) EXCEPT !.proposal = k]
Acceptance(me, s, k)   ==
  [Message("Acceptance", me, s[1], s, k) EXCEPT !.proposal = k,
                                                !.accepted = TRUE]
Refusal(me, s, k, why) ==
  [Message("Acceptance", me, s[1], s, k) EXCEPT !.proposal = k, !.reason = why]
Fin(me, to, s)         == Message("Fin", me, to, s, 1)
Cancel(me, to, s, why) ==
  [Message("Cancel", me, to, s, 1) EXCEPT !.reason = why]

\* Answers: seq 0, sent once for each copy that calls for them.
AnswerSeq(seq)         == 0
Ack(me, m)             ==
  [Message("Ack", me, m.src, m.session, 0) EXCEPT !.of = <<m.type, m.seq>>]
RefusalAnswer(me, m, why) ==
  [Refusal(me, m.session, m.proposal, why) EXCEPT !.seq = AnswerSeq(m.proposal)]
Closed(me, m) ==
  [Cancel(me, m.src, m.session, "closed") EXCEPT !.seq = AnswerSeq(1)]

Entry(m) == [ type |-> m.type, to |-> m.dst, session |-> m.session,
              seq |-> m.seq, accepted |-> m.accepted ]

Copy(me, e) ==
  [ Message(e.type, me, e.to, e.session, e.seq)
      EXCEPT !.proposal = IF e.type \in {"Prescription", "Acceptance"}
                          THEN e.seq ELSE 0,
             !.accepted = e.accepted,
             !.reason   = IF e.type = "Cancel"
                             \/ (e.type = "Acceptance" /\ ~e.accepted)
                          THEN "as_sent" ELSE "none" ]

(***************************************************************************)
(* Timers.  Which are armed is a function of the station.                  *)
(***************************************************************************)
Timer(name)       == <<name>>
Resend(e)         == <<"resend", e>>
GiveUp(e)         == <<"giveup", e>>
Forget(p)         == <<"forget", p>>

LeaseRuns(st) ==
  \/ st.phase \in {"PRESCRIBING", "ACTUATING"}
  \/ st.phase = "NEGOTIATING" /\ st.role = "prescriber" /\ ~st.deciding

If(condition, timers) == IF condition THEN timers ELSE {}

Armed(me, st) ==
  UNION
  { If(st.phase = "ADVERTISING",
       {Timer("advertise"), Resend(Entry(Advertisement(me, st.session)))}),
    If(\/ st.phase = "CHOOSING"
       \/ st.phase = "NEGOTIATING" /\ (st.role = "receiver" \/ st.deciding),
       {Timer("decide")}),
    If(st.phase = "WAITING", {Timer("hold")}),
    If(st.phase = "NEGOTIATING" /\ st.role = "prescriber" /\ ~st.deciding,
       {Timer("answer")}),
    If(st.phase = "ACTUATING", {Timer("cam")}),
    If(LeaseRuns(st), {Timer("lease")}),
    {GiveUp(e) : e \in st.outbox},
    {Resend(e) : e \in st.outbox},
    If(st.quarantine, {Timer("quarantine")}),
    If(st.backoff, {Timer("backoff")}),
    {Forget(s[1]) : s \in {x \in st.joined : x # st.session}} }

(***************************************************************************)
(* What a rule decides.  "told" is what the application is told.           *)
(***************************************************************************)
Nothing == <<"nothing">>

Effect(st, out, told, rule) ==
  [ st |-> st, out |-> out, told |-> told, rule |-> rule, again |-> {} ]

Ignore(st, rule)      == Effect(st, {}, Nothing, rule)
Answer(st, m, rule)   == Effect(st, {m}, Nothing, rule)
Discard(st, rule)     == Effect(st, {}, <<"discarded">>, rule)
Refuse(st, rule)      == Effect(st, {}, <<"refused">>, rule)

\* Send reliably: the message goes out and into the outbox.
Post(st, ms) == [st EXCEPT !.outbox = @ \cup {Entry(m) : m \in ms}]
Drop(st, e)  == [st EXCEPT !.outbox = @ \ {e}]

\* END-1: leaving ends the retransmission of Intention, Prescription and
\* Acceptance; a Fin or a Cancel goes on.
Leave(st) ==
  [ st EXCEPT !.phase = "STANDALONE", !.role = "none", !.session = NoSession,
              !.recorded = {}, !.withdrawn = {}, !.target = Nobody,
              !.proposal = 0, !.deciding = FALSE, !.heard = FALSE,
              !.outbox = {e \in @ : e.type \in {"Fin", "Cancel"}} ]

\* ACT-6: a receiver that ends its commitment itself (abort, CAM loss, lease)
\* is quarantined: its prescriber may go on acting on its word.
BreakOff(st) == IF st.phase = "ACTUATING" /\ st.role = "receiver"
                THEN [Leave(st) EXCEPT !.quarantine = TRUE] ELSE Leave(st)

\* Leave by its own decision, and send ms reliably.
LeaveWith(st, ms, told, rule) == Effect(Post(BreakOff(st), ms), ms, told, rule)

Cancels(me, st, to, why) == {Cancel(me, p, st.session, why) : p \in to}

\* Leave by a Cancel to the peer, and tell the application.
CancelPeer(me, st, why, rule) ==
  LeaveWith(st, Cancels(me, st, {Peer(st)}, why), <<"fallback", why>>, rule)

\* END-1: in ADVERTISING and CHOOSING the Cancel goes to every recorded one.
Others(st) == IF st.phase \in {"ADVERTISING", "CHOOSING"}
              THEN st.recorded ELSE {Peer(st)}

(***************************************************************************)
(* Guards that carry the protocol's safety, apart and named, so that a     *)
(* model can take one away (Ablations.tla) and see what breaks.            *)
(***************************************************************************)
SameSession(s, t)  == s = t                                    \* END-4
OfPeer(st, src)    == src = Peer(st)                           \* END-2, ACT-3
SameProposal(k, l) == k = l                                    \* NEG-6
OlderOrSame(k, l)  == k <= l                                   \* NEG-1
AckMatches(e, m)   ==                                          \* END-6
  /\ e.to = m.src
  /\ e.session = m.session
  /\ m.of[2] # 0
  /\ m.of = <<e.type, e.seq>>
WithinRounds(k) == k <= MaxRounds                              \* END-5
MayClose(st) == st.recorded # {}                               \* ADV-9
NewerThanJoined(st, s) ==                                      \* ADV-8
  ~ \E j \in st.joined : j[1] = s[1] /\ j[2] >= s[2]
Quarantined(st) == st.quarantine                               \* END-8
MayRequest(st) == ~st.quarantine                               \* ACT-6
NextTarget(st, p) == p = st.target                             \* NEG-7
Marked(st, marks) == st.session \in marks                      \* ACT-5
NextProposal(k) == k + 1                                       \* NEG-7
RoundLeft(st) == st.proposal < MaxRounds                       \* NEG-7
AckCopy(me, m) == {Ack(me, m)}                                 \* NEG-1, END-3

\* MEM-1: bounded memory.  A prescriber needs an entry for each participant,
\* a receiver one for each round, and either one more to end the session.
Reserve == 1 + IF MaxRounds > MaxParticipants THEN MaxRounds
                                              ELSE MaxParticipants
Room(st) == Cardinality(st.outbox) + Reserve <= OutboxLimit
RoomToRecord(st) ==
  Cardinality(st.recorded \cup st.withdrawn) < MaxParticipants
RoomToRemember(st, p) ==
  \/ \E j \in st.joined : j[1] = p
  \/ Cardinality(st.joined) < MemoryLimit

In(st, s) == Bound(st) /\ SameSession(st.session, s)

(***************************************************************************)
(* Advertising                                                             *)
(***************************************************************************)
OnRequest(me, st) ==                                           \* ADV-1
  IF Bound(st) THEN Refuse(st, "ADV-1")
  ELSE IF ~MayRequest(st) THEN Refuse(st, "ACT-6")
  ELSE IF st.backoff THEN Refuse(st, "END-7")
  ELSE IF ~Room(st) THEN Refuse(st, "MEM-1")
  ELSE LET s == <<me, st.number + 1>> IN
       Effect([st EXCEPT !.phase = "ADVERTISING", !.role = "prescriber",
                         !.session = s, !.number = @ + 1],
              {Advertisement(me, s)}, Nothing, "ADV-1")

OnResendAdvertisement(me, st) ==
  Effect(st, {Advertisement(me, st.session)}, Nothing, "ADV-2")

OnAdvertisement(me, st, m, concerned) ==
  IF Bound(st) THEN Ignore(st, "ADV-4")
  ELSE IF Quarantined(st) THEN Ignore(st, "END-8")
  ELSE IF ~NewerThanJoined(st, m.session) THEN Ignore(st, "ADV-8")
  ELSE IF ~concerned THEN Ignore(st, "ADV-3")
  ELSE IF ~(Room(st) /\ RoomToRemember(st, m.src)) THEN Ignore(st, "MEM-1")
  ELSE LET i == Intention(me, m.session)
           j == [st EXCEPT !.phase = "INTENDING", !.role = "receiver",
                           !.session = m.session,
                           !.joined = {x \in @ : x[1] # m.src}
                                      \cup {m.session}]
       IN Effect(Post(j, {i}), {i}, Nothing, "ADV-3")

\* What a station answers for a session it is not, or no longer, in: the Fin
\* or Cancel it is still sending there, else Cancel(closed).
AnswerClosed(me, st, m, rule) ==
  LET mine == {e \in st.outbox : /\ e.to = m.src /\ e.session = m.session
                                 /\ e.type \in {"Fin", "Cancel"}}
  IN Effect(st, IF mine # {} THEN {Copy(me, e) : e \in mine}
                             ELSE {Closed(me, m)}, Nothing, rule)

OnIntention(me, st, m) ==                                      \* ADV-5
  LET p == m.src IN
  IF ~In(st, m.session) THEN AnswerClosed(me, st, m, "ADV-5")
  ELSE IF st.phase = "ADVERTISING" THEN
    IF p \in st.recorded THEN Answer(st, Ack(me, m), "ADV-5")
    ELSE IF p \in st.withdrawn THEN AnswerClosed(me, st, m, "ADV-5")
    ELSE IF ~RoomToRecord(st) THEN Ignore(st, "MEM-1")
    ELSE Answer([st EXCEPT !.recorded = @ \cup {p}], Ack(me, m), "ADV-5")
  ELSE IF p \in st.recorded \cup {st.target}
    THEN Answer(st, Ack(me, m), "ADV-5")
  ELSE AnswerClosed(me, st, m, "ADV-5")

OnHold(me, st) ==
  Effect(Leave(st), {}, <<"fallback", "timeout">>, "ADV-7")

OnForget(st, p) ==
  Ignore([st EXCEPT !.joined = {j \in @ : j[1] # p}], "ADV-8")

(***************************************************************************)
(* Prescribing                                                             *)
(***************************************************************************)
NoParticipants(st, out) ==                                     \* PRE-1, END-7
  Effect([Leave(st) EXCEPT !.backoff = TRUE], out,
         <<"no_participants">>, "PRE-1")

OnAdvertiseEnd(me, st) ==
  IF st.recorded = {} THEN NoParticipants(st, {})
  ELSE Effect([st EXCEPT !.phase = "CHOOSING", !.withdrawn = {}],
              {}, <<"choose">>, "PRE-1")

\* The application closes the window: it ends as by the timer, which Step stops.
OnClose(me, st, c) ==                                          \* ADV-9
  IF st.phase # "ADVERTISING" THEN Refuse(st, "CMD-1")
  ELSE IF c.session # st.session THEN Refuse(st, "PRE-5")
  ELSE IF ~MayClose(st) THEN Refuse(st, "ADV-9")
  ELSE [OnAdvertiseEnd(me, st) EXCEPT !.rule = "ADV-9"]

\* Sends proposal k to the target and releases the others.
Prescribe(me, st, to, k, rule) ==
  LET ms == {Prescription(me, to, st.session, k)}
            \cup Cancels(me, st, st.recorded \ {to}, "not_selected")
  IN Effect(Post([st EXCEPT !.phase = "PRESCRIBING", !.target = to,
                            !.proposal = k, !.deciding = FALSE,
                            !.recorded = {}], ms),
            ms, Nothing, rule)

OnPrescribe(me, st, c) ==
  IF ~(st.phase = "CHOOSING" \/ st.deciding) THEN Refuse(st, "CMD-1")
  ELSE IF c.session # st.session \/ c.proposal # NextProposal(st.proposal)
    THEN Refuse(st, "PRE-5")
  ELSE IF st.phase = "CHOOSING" THEN
    IF c.target \in st.recorded THEN Prescribe(me, st, c.target, 1, "PRE-2")
    ELSE Refuse(st, "PRE-2")
  ELSE IF NextTarget(st, c.target)
    THEN Prescribe(me, st, c.target, c.proposal, "NEG-7")
  ELSE Refuse(st, "NEG-7")

OnProceed(me, st, c) ==
  IF st.phase # "CHOOSING" THEN Refuse(st, "CMD-1")
  ELSE IF c.session # st.session THEN Refuse(st, "PRE-5")
  ELSE LeaveWith(st, Cancels(me, st, st.recorded, "not_needed"),
                 Nothing, "PRE-3")

(***************************************************************************)
(* Negotiating                                                             *)
(***************************************************************************)
OnForeignPrescription(me, st, m) ==
  IF Bound(st) THEN Answer(st, RefusalAnswer(me, m, "busy"), "NEG-4")
  ELSE Answer(st, RefusalAnswer(me, m, "unknown_session"), "NEG-5")

OnPrescription(me, st, m) ==
  IF ~In(st, m.session) THEN OnForeignPrescription(me, st, m)
  ELSE IF OlderOrSame(m.proposal, st.proposal)
    THEN Effect(st, AckCopy(me, m), Nothing, "NEG-1")
  ELSE IF st.phase \in {"INTENDING", "WAITING"} THEN
    Effect([st EXCEPT !.phase = "NEGOTIATING", !.proposal = m.proposal,
                      !.outbox = {e \in @ : e.type # "Intention"}],
           {Ack(me, m)}, <<"verify">>, "NEG-1")
  ELSE Discard(st, "END-5")

OnAccept(me, st, c) ==
  IF ~(st.phase = "NEGOTIATING" /\ st.role = "receiver")
    THEN Refuse(st, "CMD-1")
  ELSE IF c.session # st.session \/ c.proposal # st.proposal
    THEN Refuse(st, "PRE-5")
  ELSE LET m == Acceptance(me, st.session, st.proposal) IN
       Effect(Post([st EXCEPT !.phase = "ACTUATING"], {m}), {m},
              Nothing, "NEG-2")

RefuseProposal(me, st, why, told) ==
  LET m == Refusal(me, st.session, st.proposal, why) IN
  Effect(Post([st EXCEPT !.phase = "WAITING"], {m}), {m}, told, "NEG-3")

OnRefuse(me, st, c) ==
  IF ~(st.phase = "NEGOTIATING" /\ st.role = "receiver")
    THEN Refuse(st, "CMD-1")
  ELSE IF c.session # st.session \/ c.proposal # st.proposal
    THEN Refuse(st, "PRE-5")
  ELSE RefuseProposal(me, st, "unsafe", Nothing)

\* The prescriber waits for the answer to its current proposal.
AwaitsAnswer(st) ==
  \/ st.phase = "PRESCRIBING"
  \/ st.phase = "NEGOTIATING" /\ ~st.deciding

\* A copy of a reliable Acceptance is acked; an answer is not.
AckIfReliable(me, st, m) ==
  Effect(st, IF m.seq # 0 THEN AckCopy(me, m) ELSE {}, Nothing, "NEG-6")

OnAcceptance(me, st, m) ==                                     \* NEG-6, NEG-7
  IF ~In(st, m.session) THEN
    IF m.accepted THEN AnswerClosed(me, st, m, "NEG-6")
    ELSE AckIfReliable(me, st, m)
  ELSE IF ~OfPeer(st, m.src) \/ m.proposal > st.proposal
    THEN Discard(st, "END-5")
  ELSE IF ~(AwaitsAnswer(st) /\ SameProposal(m.proposal, st.proposal))
    THEN AckIfReliable(me, st, m)
  ELSE LET acks == IF m.seq # 0 THEN {Ack(me, m)} ELSE {}
           done == [st EXCEPT
                     !.outbox = {e \in @ : e.type # "Prescription"}]
       IN
       IF m.accepted THEN
         Effect([done EXCEPT !.phase = "ACTUATING"], acks,
                <<"accepted">>, "NEG-6")
       ELSE IF /\ m.reason \notin {"busy", "unknown_session"}
               /\ RoundLeft(st) THEN
         Effect([done EXCEPT !.phase = "NEGOTIATING", !.deciding = TRUE],
                acks, <<"propose">>, "NEG-7")
       ELSE LET r == CancelPeer(me, done, "no_agreement", "NEG-7")
            IN [r EXCEPT !.out = @ \cup acks]

(***************************************************************************)
(* Actuating                                                               *)
(***************************************************************************)
OnCam(me, st, i) ==                                            \* ACT-5
  IF /\ st.phase = "ACTUATING" /\ OfPeer(st, i.src)
     /\ Marked(st, i.marks) /\ (i.newer \/ ~st.heard)
  THEN [Ignore([st EXCEPT !.heard = TRUE], "ACT-5")
          EXCEPT !.again = {Timer("cam")}]
  ELSE Ignore(st, "ACT-5")

OnCamLoss(me, st) == CancelPeer(me, st, "cam_loss", "ACT-2")

OnComplete(me, st, c) ==                                       \* ACT-3
  IF ~(st.phase = "ACTUATING" /\ st.role = "prescriber")
    THEN Refuse(st, "CMD-1")
  ELSE IF c.session # st.session THEN Refuse(st, "PRE-5")
  ELSE LeaveWith(st, {Fin(me, st.target, st.session)}, Nothing, "ACT-3")

OnFin(me, st, m) ==
  IF In(st, m.session) /\ st.role = "receiver" /\ OfPeer(st, m.src)
  THEN Effect(Leave(st), {Ack(me, m)}, <<"finished">>, "ACT-3")
  ELSE Effect(st, AckCopy(me, m), Nothing, "END-3")

(***************************************************************************)
(* Ending and robustness                                                   *)
(***************************************************************************)
OnAbort(me, st, c) ==
  IF ~Bound(st) THEN Refuse(st, "CMD-1")
  ELSE IF c.session # st.session THEN Refuse(st, "PRE-5")
  ELSE LeaveWith(st, Cancels(me, st, Others(st), "abort"), Nothing, "END-1")

OnCancel(me, st, m) ==                                         \* END-2, END-3
  LET acks == IF m.seq # 0 THEN {Ack(me, m)} ELSE {} IN
  IF ~In(st, m.session)
    THEN Effect(st, IF m.seq # 0 THEN AckCopy(me, m) ELSE {}, Nothing, "END-3")
  ELSE IF st.phase = "ADVERTISING" THEN
    IF m.src \in st.withdrawn \/ (m.src \notin st.recorded /\ ~RoomToRecord(st))
    THEN Effect(st, acks, Nothing, "END-3")
    ELSE Effect([st EXCEPT !.recorded = @ \ {m.src},
                           !.withdrawn = @ \cup {m.src}],
                acks, Nothing, "END-2")
  ELSE IF st.phase = "CHOOSING" /\ m.src \in st.recorded THEN
    IF st.recorded = {m.src} THEN NoParticipants(st, acks)
    ELSE Effect([st EXCEPT !.recorded = @ \ {m.src}], acks, Nothing, "END-2")
  ELSE IF st.phase # "CHOOSING" /\ OfPeer(st, m.src)
  THEN Effect(Leave(st), acks, <<"fallback", m.reason>>, "END-2")
  ELSE Effect(st, acks, Nothing, "END-3")

OnAck(me, st, m) ==                                            \* END-6
  LET acked == {e \in st.outbox : AckMatches(e, m)}
      rest  == [st EXCEPT !.outbox = @ \ acked]
      types == {e.type : e \in acked}
  IN IF acked = {} THEN Ignore(st, "END-6")
     ELSE IF "Intention" \in types
       THEN Ignore([rest EXCEPT !.phase = "WAITING"], "ADV-6")
     ELSE IF "Prescription" \in types
       THEN Ignore([rest EXCEPT !.phase = "NEGOTIATING"], "PRE-4")
     ELSE IF "Acceptance" \in types THEN Ignore(rest, "NEG-9")
     ELSE Ignore(rest, "END-6")

\* END-8: it remembers no session, but its numbers go on growing.
OnRestart(me, st) ==
  [Ignore([Initial EXCEPT !.number = st.number, !.quarantine = TRUE], "END-8")
     EXCEPT !.again = {Timer("quarantine")}]

\* END-5: a message that breaks the protocol whatever the phase.
BreaksProtocol(me, m) ==
  \/ m.src = me
  \/ (m.dst = Broadcast) # (m.type = "Advertisement")
  \/ m.type \in {"Advertisement", "Prescription"} /\ m.src # m.session[1]
  \/ m.type = "Prescription" /\ ~WithinRounds(m.proposal)
  \/ m.type \in {"Intention", "Acceptance"} /\ m.session[1] # me
  \/ m.type = "Cancel" /\ m.reason = "closed" /\ m.src # m.session[1]

OnMessage(me, st, m, concerned) ==
  IF m.dst \notin {me, Broadcast} THEN Ignore(st, "MSG-1")
  ELSE IF BreaksProtocol(me, m) THEN Discard(st, "END-5")
  ELSE CASE m.type = "Advertisement" -> OnAdvertisement(me, st, m, concerned)
         [] m.type = "Intention"     -> OnIntention(me, st, m)
         [] m.type = "Prescription"  -> OnPrescription(me, st, m)
         [] m.type = "Acceptance"    -> OnAcceptance(me, st, m)
         [] m.type = "Fin"           -> OnFin(me, st, m)
         [] m.type = "Cancel"        -> OnCancel(me, st, m)
         [] m.type = "Ack"           -> OnAck(me, st, m)

OnCommand(me, st, c) ==
  CASE c.name = "request"   -> OnRequest(me, st)
    [] c.name = "close"     -> OnClose(me, st, c)
    [] c.name = "prescribe" -> OnPrescribe(me, st, c)
    [] c.name = "proceed"   -> OnProceed(me, st, c)
    [] c.name = "accept"    -> OnAccept(me, st, c)
    [] c.name = "refuse"    -> OnRefuse(me, st, c)
    [] c.name = "complete"  -> OnComplete(me, st, c)
    [] c.name = "abort"     -> OnAbort(me, st, c)

(***************************************************************************)
(* Timers                                                                  *)
(***************************************************************************)
OnDecide(me, st) ==
  IF st.role = "receiver"
  THEN RefuseProposal(me, st, "undecided", <<"undecided">>)
  ELSE LeaveWith(st, Cancels(me, st, Others(st), "abort"),
                 <<"fallback", "abort">>, "PRE-5")

OnResend(me, st, e) ==
  IF e.type = "Advertisement" THEN OnResendAdvertisement(me, st)
  ELSE Effect(st, {Copy(me, e)}, Nothing, "REL-1")

GiveUpEntry(me, st, e) ==
  CASE e.type = "Intention"    ->
         Ignore([Drop(st, e) EXCEPT !.phase = "WAITING"], "ADV-6")
    [] e.type = "Prescription" -> CancelPeer(me, st, "timeout", "PRE-4")
    [] e.type = "Acceptance"   -> Ignore(Drop(st, e), "NEG-9")
    [] OTHER                   -> Ignore(Drop(st, e), "REL-1")

OnGiveUp(me, st, e) == GiveUpEntry(me, st, e)

OnExpiry(me, st, t) ==
  CASE t[1] = "advertise"  -> OnAdvertiseEnd(me, st)
    [] t[1] = "resend"     -> OnResend(me, st, t[2])
    [] t[1] = "giveup"     -> OnGiveUp(me, st, t[2])
    [] t[1] = "decide"     -> OnDecide(me, st)
    [] t[1] = "hold"       -> OnHold(me, st)
    [] t[1] = "answer"     -> CancelPeer(me, st, "timeout", "NEG-8")
    [] t[1] = "cam"        -> OnCamLoss(me, st)
    [] t[1] = "lease"      -> CancelPeer(me, st, "lease_expired", "ACT-4")
    [] t[1] = "quarantine" -> Ignore([st EXCEPT !.quarantine = FALSE], "END-8")
    [] t[1] = "backoff"    -> Ignore([st EXCEPT !.backoff = FALSE], "END-7")
    [] t[1] = "forget"     -> OnForget(st, t[2])

(***************************************************************************)
(* The step.  An input is one of                                           *)
(*   [kind |-> "receive", message, concerned]  a message of the seven      *)
(*   [kind |-> "cam", src, marks, newer]       a CAM                       *)
(*   [kind |-> "command", name, session, proposal, target]                 *)
(*   [kind |-> "expire", timer]                an armed timer expires      *)
(*   [kind |-> "restart"]                                                  *)
(* Decide leaves the timers out; Step adds what they do.                   *)
(***************************************************************************)
Decide(me, st, i) ==
  CASE i.kind = "receive" -> OnMessage(me, st, i.message, i.concerned)
    [] i.kind = "cam"     -> OnCam(me, st, i)
    [] i.kind = "command" -> OnCommand(me, st, i)
    [] i.kind = "expire"  -> OnExpiry(me, st, i.timer)
    [] i.kind = "restart" -> OnRestart(me, st)

Expired(i) == IF i.kind = "expire" THEN {i.timer} ELSE {}

Step(me, st, i) ==
  LET r == Decide(me, st, i)
      before == Armed(me, st)
      after  == Armed(me, r.st)
  IN [ st   |-> r.st, out |-> r.out, told |-> r.told, rule |-> r.rule,
       arm  |-> {t \in after : t \notin before \/ t \in Expired(i) \cup r.again},
       stop |-> (before \ after) \ Expired(i) ]

\* ACT-2, ACT-5: the sessions its CAM names.
Marks(st) == (IF Bound(st) THEN {st.session} ELSE {})
             \cup {e.session : e \in {x \in st.outbox : x.type = "Fin"}}

\* MEM-1, assumed wherever there is a model: a station with less memory opens
\* and joins no session, and everything holds.  (A log may tell of such a
\* station.)
LimitsSuffice ==
  /\ {MaxRounds, MaxParticipants, MemoryLimit} \subseteq Nat \ {0}
  /\ OutboxLimit \in Nat /\ OutboxLimit >= Reserve

(***************************************************************************)
(* Type invariant, and what the fields have to do with each other.         *)
(***************************************************************************)
StationTypeInv(me, st) ==
  /\ st.phase \in Phases /\ st.role \in Roles
  /\ (st.role = "none") = (st.phase = "STANDALONE")
  /\ (st.session = NoSession) = (st.phase = "STANDALONE")
  /\ st.role = "prescriber" => st.session = <<me, st.number>>
  /\ st.role = "receiver" => st.session \in st.joined /\ st.session[1] # me
  /\ st.recorded \cap st.withdrawn = {}
  /\ st.recorded # {} => st.phase \in {"ADVERTISING", "CHOOSING"}
  /\ st.phase = "CHOOSING" => st.recorded # {}
  /\ st.withdrawn # {} => st.phase = "ADVERTISING"
  /\ (st.target # Nobody) = (/\ st.role = "prescriber"
                             /\ st.phase \notin {"ADVERTISING", "CHOOSING"})
  /\ st.proposal \in 0 .. MaxRounds
  /\ ~Bound(st) =>  \* as new, but for what outlives a session
       st = [ Initial EXCEPT !.number = st.number, !.joined = st.joined,
                             !.outbox = {e \in st.outbox :
                                           e.type \in {"Fin", "Cancel"}},
                             !.quarantine = st.quarantine,
                             !.backoff = st.backoff ]
  /\ st.deciding => st.role = "prescriber" /\ st.phase = "NEGOTIATING"
  /\ st.heard => st.phase = "ACTUATING"
  /\ (st.phase = "INTENDING") = (\E e \in st.outbox : e.type = "Intention")
  /\ (st.phase = "PRESCRIBING") = (\E e \in st.outbox : e.type = "Prescription")
  /\ \A e \in st.outbox : e.seq # 0
  /\ Cardinality(st.outbox) <= OutboxLimit
  /\ st.quarantine => st.role # "receiver"
  /\ Cardinality(st.joined) <= MemoryLimit
==============================================================================
