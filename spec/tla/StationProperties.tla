-------------------------- MODULE StationProperties --------------------------
(***************************************************************************)
(* What one station owes its application and its peers, whatever happens   *)
(* to it: every input of OpenStation in every state.                       *)
(***************************************************************************)
EXTENDS OpenStation

\* History: the input and what Step said; no guard reads it.  turn alternates,
\* so that no step is one of stuttering, which action properties do not judge.
VARIABLE last

\* last is no part of the state.
station == st

Kinds == {"restart", "expire", "receive", "cam", "command"}

SInit ==
  /\ st = Initial
  /\ last = [ station |-> Me, input |-> [kind |-> "start"], rule |-> "none",
              out |-> {}, told |-> Nothing, arm |-> {}, turn |-> FALSE ]
  /\ TLCSet(ALPHABET, TLCEval([k \in Kinds |-> {i \in Alphabet : i.kind = k}]))

Inputs(kind) == TLCGet(ALPHABET)[kind]

Take(i) ==
  /\ Offered(st, i)
  /\ \E r \in {Step(Me, st, i)} :
       /\ st' = r.st
       /\ last' = [ station |-> Me, input |-> i, rule |-> r.rule,
                    out |-> r.out, told |-> r.told, arm |-> r.arm,
                    turn |-> ~last.turn ]

Restart == \E i \in Inputs("restart") : Take(i)
Expire  == \E i \in Inputs("expire")  : Take(i)
Receive == \E i \in Inputs("receive") : Take(i)
HearCam == \E i \in Inputs("cam")     : Take(i)
Command == \E i \in Inputs("command") : Take(i)

SNext == Restart \/ Expire \/ Receive \/ HearCam \/ Command

\* Why a station leaves: the reason that its Cancel carries and, if nobody
\* here wanted it, its application is told.
Reason(i) ==
  CASE i.kind = "command" /\ i.name = "abort"         -> "abort"
    [] i.kind = "command" /\ i.name = "proceed"       -> "not_needed"
    [] i.kind = "command" /\ i.name = "prescribe"     -> "not_selected"
    [] i.kind = "receive" /\ i.message.type = "Acceptance" -> "no_agreement"
    [] i.kind = "receive" /\ i.message.type = "Cancel" -> i.message.reason
    [] i.kind = "expire" /\ i.timer[1] = "cam"        -> "cam_loss"
    [] i.kind = "expire" /\ i.timer[1] = "lease"      -> "lease_expired"
    [] i.kind = "expire" /\ i.timer[1] = "decide"     -> "abort"
    [] i.kind = "expire"                              -> "timeout"
    [] OTHER                                          -> "none"

Enters(phase, x, y) == x.phase # phase /\ y.phase = phase

\* What the application is told when x becomes y by i: it is a matter of the
\* phases and the cause alone.
Owed(x, y, i) ==
  LET left == Bound(x) /\ ~Bound(y) IN
  CASE x.phase = "ADVERTISING" /\ y.phase = "CHOOSING" -> <<"choose">>
    [] y.role = "receiver" /\ Enters("NEGOTIATING", x, y) -> <<"verify">>
    [] y.deciding /\ ~x.deciding                       -> <<"propose">>
    [] y.role = "prescriber" /\ Enters("ACTUATING", x, y) -> <<"accepted">>
    [] x.phase = "NEGOTIATING" /\ i.kind = "expire" /\ y.phase = "WAITING" ->
         <<"undecided">>
    [] left /\ i.kind \in {"command", "restart"}       -> Nothing
    [] left /\ x.phase \in {"ADVERTISING", "CHOOSING"} /\ y.backoff # x.backoff ->
         <<"no_participants">>
    [] left /\ i.kind = "receive" /\ i.message.type = "Fin" -> <<"finished">>
    [] left                                            -> <<"fallback", Reason(i)>>
    [] OTHER                                           -> Nothing

(***************************************************************************)
(* S-9: the application is told what has come about, and why.  (A command  *)
(* that changes nothing is refused; a message that breaks the protocol is  *)
(* reported.)                                                              *)
(***************************************************************************)
ToldProp ==
  [][ LET i == last'.input IN
      IF st' # st THEN last'.told = Owed(st, st', i)
      ELSE last'.told \in CASE i.kind = "command" -> {<<"refused">>}
                        [] i.kind = "receive" -> {Nothing, <<"discarded">>}
                        [] OTHER              -> {Nothing} ]_<<st, last>>

(***************************************************************************)
(* S-10: a reliable Cancel names the reason for which it is sent.          *)
(***************************************************************************)
ReasonProp ==
  [][ \A m \in last'.out :
        m.type = "Cancel" /\ m.seq # 0 /\ Entry(m) \notin st.outbox =>
          m.reason = Reason(last'.input) ]_<<st, last>>

(***************************************************************************)
(* S-11: a command changes something only if it is about the session that  *)
(* the station is in, and a verdict only if it is on the proposal that was *)
(* verified last (PRE-5): nobody drives what his application said of       *)
(* something else.  A request starts a session only where none is, in no   *)
(* back-off and no quarantine (END-7, ACT-6).  A receiver commits at its   *)
(* application's word alone, and to nothing else before it leaves (NEG-2). *)
(***************************************************************************)
WordProp ==
  [][ LET i == last'.input
          says(name) == i.kind = "command" /\ i.name = name
      IN
      /\ i.kind = "command" /\ i.name # "request" /\ st' # st =>
           /\ i.session = st.session
           /\ i.name \in {"accept", "refuse"} => i.proposal = st.proposal
      /\ says("request") /\ st' # st => ~(Bound(st) \/ st.backoff \/ st.quarantine)
      /\ st'.role = "receiver" /\ Enters("ACTUATING", st, st') => says("accept")
      /\ st.role = "receiver" /\ st.phase = "ACTUATING" /\ Bound(st') =>
           st'.phase = "ACTUATING" /\ st'.proposal = st.proposal
    ]_<<st, last>>

(***************************************************************************)
(* S-12: no more stations take part in a session than there is room for,   *)
(* those that have withdrawn included (MEM-1).                             *)
(***************************************************************************)
ParticipantsInv == Cardinality(st.recorded \cup st.withdrawn) <= MaxParticipants

(***************************************************************************)
(* S-13: what is sent reliably is sent again until it is acknowledged,     *)
(* given up, or answered (REL-1); or, but for Fin and Cancel, its session  *)
(* is over (END-1).  A restart forgets it (END-8).  Its resend timer sends *)
(* it when it expires.                                                     *)
(***************************************************************************)
Reliable(m) == m.seq # 0 /\ m.type # "Advertisement"

Answers(e, i) ==
  /\ i.kind = "receive"
  /\ \/ i.message.type = "Ack"
     \/ i.message.type = "Prescription" /\ e.type = "Intention"
     \/ i.message.type = "Acceptance" /\ e.type = "Prescription"

KeptProp ==
  [][ LET i == last'.input IN
      /\ i.kind = "expire" /\ i.timer[1] = "resend" =>
           \E m \in last'.out : Entry(m) = i.timer[2]
      /\ \A m \in last'.out : Reliable(m) => Entry(m) \in st'.outbox
      /\ \A e \in st.outbox \ st'.outbox :
           \/ Answers(e, i)
           \/ i.kind = "expire" /\ i.timer = <<"giveup", e>>
           \/ i.kind = "restart"
           \/ e.type \notin {"Fin", "Cancel"} /\ ~Bound(st')
    ]_<<st, last>>

(***************************************************************************)
(* S-14: a timer that has expired and is still needed runs again, or       *)
(* nothing would be sent a third time (REL-1); and a restart begins the    *)
(* quarantine anew (END-8).                                                *)
(***************************************************************************)
AnewProp ==
  [][ LET i == last'.input IN
      /\ i.kind = "expire" /\ i.timer \in Armed(Me, st') => i.timer \in last'.arm
      /\ i.kind = "restart" => Timer("quarantine") \in last'.arm ]_<<st, last>>

(***************************************************************************)
(* S-15: a session that was joined is remembered until its time is over,   *)
(* the same prescriber's next one is joined, or a restart (ADV-8).         *)
(***************************************************************************)
RememberedProp ==
  [][ LET i == last'.input IN
      \A j \in st.joined \ st'.joined :
        \/ \E k \in st'.joined : k[1] = j[1]
        \/ i.kind = "expire" /\ i.timer = <<"forget", j[1]>>
        \/ i.kind = "restart" ]_<<st, last>>

(***************************************************************************)
(* S-16: whoever still is in a session that this station has ended learns  *)
(* of it as soon as its Intention or its Acceptance arrives (ADV-5, NEG-6).*)
(***************************************************************************)
Asks(m) == m.type = "Intention" \/ (m.type = "Acceptance" /\ m.accepted)

EndedProp ==
  [][ LET i == last'.input IN
      i.kind = "receive" /\ Asks(i.message) /\ ~In(st, i.message.session)
      /\ i.message.dst = Me /\ last'.told = Nothing =>
        \E m \in last'.out :
          /\ m.type \in {"Fin", "Cancel"}
          /\ m.dst = i.message.src /\ m.session = i.message.session ]_<<st, last>>

(***************************************************************************)
(* S-17: of each prescriber one session is remembered, and no forget timer *)
(* runs for the session that the station is in (ADV-3, ADV-8).             *)
(***************************************************************************)
OnceInv ==
  /\ \A j, k \in st.joined : j[1] = k[1] => j = k
  /\ st.role = "receiver" => Forget(Peer(st)) \notin Armed(Me, st)

(***************************************************************************)
(* S-18: a CAM counts only if it is newer than the last one that counted   *)
(* in this session (ACT-5).                                                *)
(***************************************************************************)
NewerProp ==
  [][ LET i == last'.input IN
      i.kind = "cam" /\ Timer("cam") \in last'.arm =>
        /\ st'.heard
        /\ st.heard => i.newer ]_<<st, last>>

(***************************************************************************)
(* S-19: a station that ends a session, or releases another from it, sends *)
(* the others a Fin or a Cancel, reliably (END-1, PRE-2 to PRE-4, ACT-3);  *)
(* but not to who has left, nor after the hold timer (ADV-7) or a restart. *)
(***************************************************************************)
Parts(x) == IF Bound(x) THEN Others(x) ELSE {}

LeavingProp ==
  [][ LET i == last'.input IN
      \A p \in Parts(st) \ Parts(st') :
        \/ i.kind = "restart"
        \/ i.kind = "expire" /\ i.timer = Timer("hold")
        \/ /\ i.kind = "receive" /\ i.message.src = p
           /\ i.message.type \in {"Fin", "Cancel"}
        \/ \E m \in last'.out :
             /\ m.type \in {"Fin", "Cancel"} /\ Reliable(m)
             /\ m.dst = p /\ m.session = st.session ]_<<st, last>>

\* A message to this station in its session.
Mine(m) == m.dst = Me /\ In(st, m.session) /\ ~BreaksProtocol(Me, m)

(***************************************************************************)
(* S-20: whoever cancels in the window is not recorded in this session any *)
(* more: it has withdrawn, or there is no room for another (END-2, MEM-1); *)
(* nor is anybody after the window (ADV-5).                                *)
(***************************************************************************)
WithdrawnProp ==
  [][ LET i == last'.input IN
      /\ st.phase = "ADVERTISING" /\ st'.phase = "ADVERTISING" =>
           /\ st.withdrawn \subseteq st'.withdrawn
           /\ /\ i.kind = "receive" /\ i.message.type = "Cancel" /\ Mine(i.message)
              => i.message.src \in st'.withdrawn \/ ~RoomToRecord(st)
      /\ st'.recorded \ st.recorded # {} => st.phase = "ADVERTISING" ]_<<st, last>>

(***************************************************************************)
(* S-21: a message of the peer counts in any phase of its session: a newer *)
(* Prescription is verified before the receiver acts (NEG-1), a refusal as *)
(* `busy` or `unknown_session` (NEG-7), a Fin (ACT-3) and a Cancel (END-2) *)
(* end the session.  An Advertisement that does not concern the station    *)
(* changes nothing (ADV-3).                                                *)
(***************************************************************************)
EffectProp ==
  [][ LET i == last'.input
          m == i.message
          peer == Mine(m) /\ m.src = Peer(st)
      IN i.kind = "receive" =>
        /\ m.type = "Advertisement" /\ ~i.concerned => st' = st
        /\ /\ peer /\ m.type = "Prescription" /\ m.proposal > st.proposal
           /\ st.phase \in {"INTENDING", "WAITING"}
           => last'.told = <<"verify">>
        /\ /\ peer /\ m.type = "Acceptance" /\ m.reason \in {"busy", "unknown_session"}
           /\ AwaitsAnswer(st) /\ m.proposal = st.proposal
           => ~Bound(st')
        /\ /\ peer /\ (m.type = "Cancel" \/ (m.type = "Fin" /\ st.role = "receiver"))
           => ~Bound(st') ]_<<st, last>>

(***************************************************************************)
(* S-22: no lease runs while the prescriber decides on a further proposal  *)
(* (ACT-4).                                                                *)
(***************************************************************************)
DecidingInv == st.deciding => Timer("lease") \notin Armed(Me, st)

SSpec == SInit /\ [][SNext]_<<st, last>>

THEOREM SSpec => [](TypeInv /\ ParticipantsInv /\ OnceInv /\ DecidingInv)
THEOREM SSpec => ToldProp /\ ReasonProp /\ WordProp /\ KeptProp /\ AnewProp
THEOREM SSpec => RememberedProp /\ EndedProp /\ NewerProp /\ LeavingProp
THEOREM SSpec => WithdrawnProp /\ EffectProp

\* A receiver that gets its Fin does not say so.
FinishesSilently(me, x, m) ==
  IF In(x, m.session) /\ x.role = "receiver" /\ m.src = Peer(x)
  THEN Effect(Leave(x), {Ack(me, m)}, Nothing, "ACT-3")
  ELSE Effect(x, AckCopy(me, m), Nothing, "END-3")

\* Whoever leaves says that it aborted.
AlwaysAborts(me, x, why, rule) ==
  LeaveWith(x, Cancels(me, x, {Peer(x)}, "abort"), <<"fallback", why>>, rule)

\* An application's yes is taken for whatever is proposed now.
AcceptsAnything(me, x, c) ==
  LET m == Acceptance(me, x.session, x.proposal) IN
  IF ~(x.phase = "NEGOTIATING" /\ x.role = "receiver") THEN Refuse(x, "CMD-1")
  ELSE Effect(Post([x EXCEPT !.phase = "ACTUATING"], {m}), {m}, Nothing, "NEG-2")

\* A Cancel is sent once.
CancelsOnce(x, ms) ==
  [x EXCEPT !.outbox = @ \cup {Entry(m) : m \in {k \in ms : k.type # "Cancel"}}]

\* A timer that has expired is not armed again.
NeverExpired(i) == {}

\* Whose time is over takes all others along.
ForgetsAll(x, p) == Ignore([x EXCEPT !.joined = {}], "ADV-8")

\* Who asks about a session that is over gets an Ack.
OnlyAcks(me, x, m, rule) == Effect(x, {Ack(me, m)}, Nothing, rule)

\* Who has withdrawn is not counted.
CountsTheRecorded(x) == Cardinality(x.recorded) < MaxParticipants

\* The resend timer runs, and nothing is sent.
SendsNothing(me, x, e) == Ignore(x, "REL-1")

Joins(me, x, s, joined) ==
  LET i == Intention(me, s)
  IN Effect(Post([x EXCEPT !.phase = "INTENDING", !.role = "receiver",
                           !.session = s, !.joined = joined], {i}),
            {i}, Nothing, "ADV-3")

\* A newer session of a prescriber is joined, and the older one remembered.
KeepsOlder(me, x, m, concerned) ==
  IF Bound(x) \/ ~NewerThanJoined(x, m.session) \/ ~concerned THEN Ignore(x, "ADV-3")
  ELSE Joins(me, x, m.session, x.joined \cup {m.session})

\* The CAM that counted first is not remembered.
HearsAnyAge(me, x, i) ==
  IF x.phase = "ACTUATING" /\ OfPeer(x, i.src) /\ Marked(x, i.marks)
  THEN [Ignore(x, "ACT-5") EXCEPT !.again = {Timer("cam")}]
  ELSE Ignore(x, "ACT-5")

\* A Prescription is given up, and nobody learns of it.
GivesUpSilently(me, x, e) ==
  IF e.type = "Prescription" THEN Effect(Leave(x), {}, <<"fallback", "timeout">>, "PRE-4")
  ELSE GiveUpEntry(me, x, e)

\* A withdrawal counts only after the Intention.
ForgetsTheWithdrawn(me, x, m) ==
  IF In(x, m.session) /\ x.phase = "ADVERTISING" /\ m.src \in x.recorded
  THEN Effect([x EXCEPT !.recorded = @ \ {m.src}, !.withdrawn = @ \cup {m.src}],
              {Ack(me, m)}, Nothing, "END-2")
  ELSE Effect(x, {Ack(me, m)}, Nothing, "END-3")

\* A Prescription counts only once the Intention is acknowledged.
VerifiesWaiting(me, x, m) ==
  IF In(x, m.session) /\ x.phase = "WAITING" /\ m.proposal > x.proposal
  THEN Effect([x EXCEPT !.phase = "NEGOTIATING", !.proposal = m.proposal],
              {Ack(me, m)}, <<"verify">>, "NEG-1")
  ELSE Effect(x, AckCopy(me, m), Nothing, "NEG-1")

\* A newer proposal counts though the receiver is committed.
VerifiesActing(me, x, m) ==
  IF In(x, m.session) /\ ~OlderOrSame(m.proposal, x.proposal)
  THEN Effect([x EXCEPT !.phase = "NEGOTIATING", !.proposal = m.proposal, !.heard = FALSE,
                        !.outbox = {e \in @ : e.type # "Intention"}],
              {Ack(me, m)}, <<"verify">>, "NEG-1")
  ELSE Effect(x, AckCopy(me, m), Nothing, "NEG-1")

\* A request counts in the back-off, and ends it.
RequestsAtOnce(me, x) ==
  IF Bound(x) \/ ~MayRequest(x) \/ ~Room(x) THEN Refuse(x, "ADV-1")
  ELSE LET s == <<me, x.number + 1>> IN
       Effect([x EXCEPT !.phase = "ADVERTISING", !.role = "prescriber", !.session = s,
                        !.number = @ + 1, !.backoff = FALSE],
              {Advertisement(me, s)}, Nothing, "ADV-1")

\* Who asks after the window is recorded, too.
RecordsChoosing(me, x, m) ==
  IF In(x, m.session) /\ x.phase \in {"ADVERTISING", "CHOOSING"} /\ RoomToRecord(x)
  THEN Effect([x EXCEPT !.recorded = @ \cup {m.src}], {Ack(me, m)}, Nothing, "ADV-5")
  ELSE Effect(x, {Ack(me, m)}, Nothing, "ADV-5")

\* A receiver that is refused as busy is asked again.
ProposesAgain(me, x, m) ==
  IF In(x, m.session) /\ AwaitsAnswer(x) /\ ~m.accepted
  THEN Effect([x EXCEPT !.phase = "NEGOTIATING", !.deciding = TRUE,
                        !.outbox = {e \in @ : e.type # "Prescription"}],
              {}, <<"propose">>, "NEG-7")
  ELSE AckIfReliable(me, x, m)

\* A Fin counts only while the receiver acts.
FinishesActing(me, x, m) ==
  IF In(x, m.session) /\ x.phase = "ACTUATING" /\ x.role = "receiver"
  THEN Effect(Leave(x), {Ack(me, m)}, <<"finished">>, "ACT-3")
  ELSE Effect(x, AckCopy(me, m), Nothing, "END-3")

\* A station joins, whether the session concerns it or not.
JoinsAll(me, x, m, concerned) ==
  IF Bound(x) \/ ~NewerThanJoined(x, m.session) THEN Ignore(x, "ADV-3")
  ELSE Joins(me, x, m.session, {m.session})

\* A refusal does not stop the lease.
LeaseWhileDeciding(x) ==
  \/ x.phase \in {"PRESCRIBING", "ACTUATING"}
  \/ x.phase = "NEGOTIATING" /\ x.role = "prescriber"
==============================================================================
