---------------------------- MODULE Independence ----------------------------
(***************************************************************************)
(* What the sessions of one station have to do with each other, for every  *)
(* input of OpenStation in every state.                                    *)
(*                                                                         *)
(*  N-1  An input of one session changes no other session.  A session is  *)
(*       barred only by a newer one of its prescriber, which the station   *)
(*       joins; unbarred only by forget(p).  Quarantine and back-off       *)
(*       change only by an input of the session that the station is in,    *)
(*       or when their own timer expires.                                  *)
(*  N-2  What an input does to its session depends on that session alone,  *)
(*       but for the interface: whether a session may start (Free), and    *)
(*       whether a station that is not in a session calls itself busy.     *)
(*  N-3  In a session, an input from one station leaves the others alone.  *)
(*                                                                         *)
(* So a station in many sessions is, for each of them, a station in that   *)
(* session only, to which Advertisements are lost and requests refused     *)
(* (docs/verification.md, "Any number of stations").  A restart concerns   *)
(* every session.                                                          *)
(***************************************************************************)
EXTENDS StationProperties

(***************************************************************************)
(* The part of a station that belongs to session x: what it is bound to,   *)
(* and what it still sends there.                                          *)
(***************************************************************************)
Part(a, x) ==
  [ IF a.session = x THEN a ELSE Initial
      EXCEPT !.outbox = {e \in a.outbox : e.session = x},
             !.number = 0, !.joined = {}, !.quarantine = FALSE,
             !.backoff = FALSE ]

\* ADV-8, ADV-1: x is over, or it is too late to start it.
Barred(a, x) ==
  IF x[1] = Me THEN x[2] <= a.number
  ELSE \E j \in a.joined : j[1] = x[1] /\ j[2] >= x[2]

\* The station that is in x alone.
Alone(a, x) ==
  [ Part(a, x) EXCEPT
      !.number = IF x[1] # Me THEN 0 ELSE IF Barred(a, x) THEN x[2] ELSE x[2] - 1,
      !.joined = IF x[1] # Me /\ Barred(a, x) THEN {x} ELSE {} ]

OfSession == {"advertise", "decide", "hold", "answer", "cam", "lease"}

\* The sessions that a timer of station a belongs to.
OfTimer(a, t) ==
  CASE t[1] = "resend"    -> {t[2].session}
    [] t[1] = "giveup"    -> {t[2].session}
    [] t[1] \in OfSession -> {a.session}
    [] OTHER              -> {}

\* The sessions that an input belongs to.
Of(a, i) ==
  CASE i.kind = "receive" -> {i.message.session}
    [] i.kind = "cam"     -> i.marks
    [] i.kind = "expire"  -> OfTimer(a, i.timer)
    [] i.kind = "command" -> {IF i.name = "request" THEN <<Me, a.number + 1>>
                                                    ELSE i.session}
    [] i.kind = "restart" -> Sessions

\* (Those that it stops follow from the parts before and after.)
ArmedOf(r, x) == {t \in r.arm : x \in OfTimer(r.st, t)}

(***************************************************************************)
(* N-1                                                                     *)
(***************************************************************************)
\* ADV-3, ADV-8: it joins a newer session of the same prescriber, or forgets.
BarredRightly(a, r, i, x) ==
  IF Barred(r.st, x)
  THEN Barred(a, x) \/ (/\ r.st.session \in Of(a, i) /\ a.session # r.st.session
                       /\ r.st.session[1] = x[1] /\ r.st.session[2] > x[2])
  ELSE ~Barred(a, x) \/ (i.kind = "expire" /\ i.timer = Forget(x[1]))

\* What the application may be told of an input of another session.
OfNone == {Nothing, <<"discarded">>, <<"refused">>}

Untouched(a, r, i, x) ==
  /\ Part(r.st, x) = Part(a, x)
  /\ BarredRightly(a, r, i, x)
  /\ \A m \in r.out : m.session # x
  /\ a.session = x => r.told \in OfNone
  /\ ArmedOf(r, x) = {}
  /\ (x \in Marks(r.st)) = (x \in Marks(a))

\* END-8, ACT-6, END-7: what concerns every session.
Flags(a) == <<a.quarantine, a.backoff>>

KeepsFlags(a, r, i) ==
  \/ i.kind = "restart" \/ a.session \in Of(a, i)
  \/ i.kind = "expire" /\ i.timer = Timer("quarantine") /\ r.st.backoff = a.backoff
  \/ i.kind = "expire" /\ i.timer = Timer("backoff") /\ r.st.quarantine = a.quarantine
  \/ Flags(r.st) = Flags(a)

(***************************************************************************)
(* N-2.  The interface between sessions: each member can be taken away by  *)
(* a must-fail model.                                                      *)
(***************************************************************************)
Unbound(a)      == ~Bound(a)                                   \* ADV-4
Unquarantined(a) == ~a.quarantine                              \* END-8, ACT-6
NoBackoff(a)    == ~a.backoff                                  \* END-7
HasRoom(a)      == Room(a)                                     \* MEM-1
Remembers(a, i) == RoomToRemember(a, i.message.src)            \* MEM-1
Busy(a)         == Bound(a)                                    \* NEG-4

\* Whether the input asks to start its session, and the station may.
Requests(i)   == i.kind = "command" /\ i.name = "request"
Advertises(i) == i.kind = "receive" /\ i.message.type = "Advertisement"

Free(a, i) ==
  /\ Unbound(a) /\ Unquarantined(a) /\ HasRoom(a)
  /\ Requests(i) => NoBackoff(a)
  /\ Advertises(i) => Remembers(a, i)

\* Nothing changes, and nothing is sent.
Idle(a, r) == r.st = a /\ r.out = {} /\ r.arm = {}

Same(a, r, q, x) ==
  /\ Part(r.st, x) = Part(q.st, x)
  /\ Flags(r.st) = <<a.quarantine \/ q.st.quarantine, a.backoff \/ q.st.backoff>>
  /\ Barred(r.st, x) = Barred(q.st, x)
  /\ (x \in Marks(r.st)) = (x \in Marks(q.st))
  /\ r.out = q.out /\ r.told = q.told
  /\ ArmedOf(r, x) = ArmedOf(q, x)

\* As if it were lost, or with a refusal.
NotStarted(a, r, i) ==
  /\ (Requests(i) \/ Advertises(i)) /\ ~Free(a, i)
  /\ Idle(a, r)

\* NEG-4, NEG-5: one refusal or the other; NEG-7 treats them alike.
SaysBusy(a, r, q, i, x) ==
  /\ i.kind = "receive" /\ i.message.type = "Prescription"
  /\ Busy(a) /\ a.session # x
  /\ r.st = a /\ r.told = q.told /\ r.arm = {}
  /\ r.out = {RefusalAnswer(Me, i.message, "busy")}
  /\ q.out = {RefusalAnswer(Me, i.message, "unknown_session")}

Own(a, r, i, x) ==
  \E b \in {Alone(a, x)} : \E q \in {Step(Me, b, i)} :
    Same(a, r, q, x) \/ NotStarted(a, r, i) \/ SaysBusy(a, r, q, i, x)

(***************************************************************************)
(* N-3                                                                     *)
(***************************************************************************)
\* The station that what a timer is for is sent to.
To(t) ==
  CASE t[1] = "resend" -> t[2].to
    [] t[1] = "giveup" -> t[2].to
    [] OTHER           -> Nobody

\* The station that an input comes from, or is about.
From(i) ==
  CASE i.kind = "receive" -> i.message.src
    [] i.kind = "cam"     -> i.src
    [] i.kind = "expire"  -> To(i.timer)
    [] OTHER              -> Nobody

\* In session x, station p is recorded or the peer.
Concerns(a, x, p) == a.session = x /\ p \in a.recorded \cup {Peer(a)}

\* What session x has to do with station p: where it takes part, all but the
\* other participants.
Participation(a, x, p) ==
  << IF Concerns(a, x, p)
     THEN [a EXCEPT !.recorded = @ \cap {p}, !.withdrawn = {}, !.outbox = {},
                    !.number = 0, !.joined = {}]
     ELSE Initial,
     Barred(a, x) /\ x[1] = p,
     a.session = x /\ p \in a.withdrawn,
     {e \in a.outbox : e.to = p /\ e.session = x} >>

\* Timers of the session, but those of what is sent to others.
ArmedTo(a, r, x, p) ==
  {t \in ArmedOf(r, x) : IF t[1] \in OfSession THEN Concerns(a, x, p)
                                               ELSE To(t) = p}

OthersAlone(a, r, i, x) ==
  \A p \in Peers \ {From(i)} :
    /\ \A m \in r.out : m.dst # p
    /\ Participation(r.st, x, p) = Participation(a, x, p)
    /\ ArmedTo(a, r, x, p) = {}
    /\ Concerns(a, x, p) => r.told \in OfNone

(***************************************************************************)
(* Each lemma, for an input i in state a with the outcome r.               *)
(***************************************************************************)
N1(a, r, i) ==
  \/ Idle(a, r)
  \/ /\ \A x \in Sessions \ Of(a, i) : Untouched(a, r, i, x)
     /\ KeepsFlags(a, r, i)

N2(a, r, i) == i.kind # "restart" => \A x \in Of(a, i) : Own(a, r, i, x)

N3(a, r, i) ==
  From(i) \in Peers => \A x \in Of(a, i) : OthersAlone(a, r, i, x)

\* For every input in every state.
Done == [st |-> st', out |-> last'.out, told |-> last'.told, arm |-> last'.arm]

N1Prop == [][N1(st, Done, last'.input)]_<<st, last>>
N2Prop == [][N2(st, Done, last'.input)]_<<st, last>>
N3Prop == [][N3(st, Done, last'.input)]_<<st, last>>

THEOREM SSpec => N1Prop /\ N2Prop /\ N3Prop

(***************************************************************************)
(* Stations whose sessions are coupled, for must-fail models.              *)
(***************************************************************************)
Always(a)       == TRUE
AlwaysTo(a, i)  == TRUE
Never(a)        == FALSE

\* An Ack that does not look at the session (END-6).
AckOfAnySession(e, m) ==
  /\ e.to = m.src
  /\ m.of[2] # 0
  /\ m.of = <<e.type, e.seq>>

\* An outbox with room for one entry to each peer: a new one replaces it.
PostPerPeer(a, ms) ==
  [a EXCEPT !.outbox = {e \in @ : \A m \in ms : e.to # m.dst}
                       \cup {Entry(m) : m \in ms}]

\* An Ack that counts for every participant (END-6).
AckFromAnybody(e, m) ==
  /\ e.session = m.session
  /\ m.of[2] # 0
  /\ m.of = <<e.type, e.seq>>

\* A message counts for every session of its prescriber.
AnyOfPrescriber(s, t) == s = t \/ s[1] = t[1]
==============================================================================
