----------------------------- MODULE OpenStation -----------------------------
(***************************************************************************)
(* One station and an environment that may send it anything from a finite  *)
(* alphabet, at any moment: its graph, written out, is the oracle.         *)
(*                                                                         *)
(* The station is Me.  Peers are stations it can deal with; the Stranger   *)
(* is a station of which only its session and its id are ever heard.       *)
(* Next prints each state once, as a tuple: the state; the marks of its    *)
(* CAM; every input that changes it or arms a timer, with all that Step    *)
(* says; of the inputs that change nothing, those answered otherwise than  *)
(* in the initial state; and the inputs that are not offered.  An input is *)
(* named by its place in the alphabet, which is printed first, with the    *)
(* answer of the initial state.                                            *)
(***************************************************************************)
EXTENDS Station, Sequences, TLC

CONSTANTS
  Peers,        \* ids of the peers
  OwnSessions,  \* numbers of own sessions
  PeerSessions  \* numbers of sessions of each peer

ASSUME LimitsSuffice

VARIABLE st

Me       == 1
Stranger == 9
Rounds   == 1 .. MaxRounds
Beyond   == MaxRounds + 1

OwnIds     == {<<Me, n>> : n \in OwnSessions}
PeerIds(p) == {<<p, n>> : n \in PeerSessions}
Foreign    == {<<Stranger, 1>>}
Sessions   == OwnIds \cup UNION {PeerIds(p) : p \in Peers} \cup Foreign

(***************************************************************************)
(* The alphabet                                                            *)
(***************************************************************************)
\* A message from p that is well formed; its answer-or-not is in its seq.
FromPeer(p) ==
  UNION
  { {Advertisement(p, s) : s \in Sessions},
    {[Intention(p, s) EXCEPT !.dst = Me] : s \in Sessions},
    {Prescription(p, Me, s, k) : s \in PeerIds(p), k \in Rounds \cup {Beyond}},
    {Prescription(p, Me, s, 1) : s \in Sessions \ PeerIds(p)},
    {Acceptance(p, s, k) : s \in OwnIds, k \in Rounds \cup {Beyond}},
    {Refusal(p, s, k, "as_sent") : s \in OwnIds, k \in Rounds},
    {[Refusal(p, s, k, why) EXCEPT !.seq = 0] :
       s \in OwnIds, k \in Rounds, why \in {"busy", "unknown_session"}},
    {[Acceptance(p, s, 1) EXCEPT !.dst = Me] : s \in Sessions \ OwnIds},
    {Fin(p, Me, s) : s \in Sessions},
    {Cancel(p, Me, s, "as_sent") : s \in Sessions},
    {[Cancel(p, Me, s, "closed") EXCEPT !.seq = 0] : s \in Sessions} }

Acks(p) ==
  { [Message("Ack", p, Me, s, 0) EXCEPT !.of = of] :
      s \in Sessions,
      of \in {<<"Advertisement", 1>>, <<"Intention", 1>>, <<"Fin", 1>>,
              <<"Cancel", 1>>, <<"Cancel", 0>>, <<"Acceptance", 0>>,
              <<"Intention", 2>>, <<"Fin", 2>>, <<"Cancel", 2>>}
             \cup ({"Prescription", "Acceptance"} \X Rounds) }

\* One of each type, from and to whom it must not come.
OneOfEach(src, dst, s) ==
  { [m EXCEPT !.dst = dst] :
      m \in { Advertisement(src, s), Intention(src, s),
              Prescription(src, Me, s, 1), Acceptance(src, s, 1),
              Fin(src, Me, s), Cancel(src, Me, s, "as_sent"),
              [Message("Ack", src, Me, s, 0) EXCEPT !.of = <<"Cancel", 1>>] } }

Improper(p) ==
  UNION
  { OneOfEach(Me, Me, s) : s \in {<<Me, 1>>, <<p, 1>>} }
  \cup {Advertisement(Me, <<Me, 1>>)}
  \cup UNION { {m \in OneOfEach(p, Broadcast, s) : m.type # "Advertisement"} :
                 s \in {<<Me, 1>>, <<p, 1>>} }
  \cup {[Advertisement(p, <<p, 1>>) EXCEPT !.dst = Me]}
  \cup UNION { OneOfEach(p, Stranger, s) : s \in {<<Me, 1>>, <<p, 1>>} }

Heard(ms, concerned) ==
  {[kind |-> "receive", message |-> m, concerned |-> concerned] : m \in ms}

Cams(p) ==
  { [kind |-> "cam", src |-> p, marks |-> marks, newer |-> newer] :
      marks \in {{}} \cup {{s} : s \in Sessions}
                \cup {{<<Me, 1>>, <<p, 1>>}, {<<p, 1>>, <<Stranger, 1>>}},
      newer \in BOOLEAN }

Cmd(name, session, proposal, target) ==
  [ kind |-> "command", name |-> name, session |-> session,
    proposal |-> proposal, target |-> target ]

Commands ==
  UNION
  { {Cmd("request", NoSession, 0, Nobody)},
    {Cmd("prescribe", s, k, p) : s \in Sessions, k \in Rounds, p \in Peers},
    {Cmd(name, s, k, Nobody) : name \in {"accept", "refuse"}, k \in Rounds,
                               s \in Sessions},
    {Cmd(name, s, 0, Nobody) : name \in {"close", "proceed", "complete", "abort"},
                               s \in Sessions} }

MyEntries ==
  { Entry(m) : m \in
      UNION { {Advertisement(Me, s) : s \in OwnIds},
              {Prescription(Me, p, s, k) : p \in Peers, s \in OwnIds, k \in Rounds},
              {Fin(Me, p, s) : p \in Peers, s \in OwnIds},
              {Cancel(Me, p, s, "as_sent") : p \in Peers, s \in OwnIds} }
      \cup UNION
        { {Intention(Me, s) : s \in PeerIds(p)}
          \cup {Acceptance(Me, s, k) : s \in PeerIds(p), k \in Rounds}
          \cup {Refusal(Me, s, k, "unsafe") : s \in PeerIds(p), k \in Rounds}
          \cup {Cancel(Me, p, s, "as_sent") : s \in PeerIds(p)} : p \in Peers } }

Timers ==
  {Timer(n) : n \in {"advertise", "decide", "hold", "answer", "cam", "lease",
                     "quarantine", "backoff"}}
  \cup {Resend(e) : e \in MyEntries}
  \cup {GiveUp(e) : e \in {x \in MyEntries : x.type # "Advertisement"}}
  \cup {Forget(p) : p \in Peers}

Alphabet ==
  UNION
  { Heard(UNION {FromPeer(p) : p \in Peers}, TRUE),
    Heard(UNION {{Advertisement(p, s) : s \in PeerIds(p)} : p \in Peers}, FALSE),
    Heard(UNION {Acks(p) : p \in Peers}, FALSE),
    Heard(UNION {Improper(p) : p \in Peers}, TRUE),
    UNION {Cams(p) : p \in Peers},
    Commands,
    {[kind |-> "expire", timer |-> t] : t \in Timers},
    {[kind |-> "restart"]} }

\* A set as a sequence.  The order is TLC's; the reader of the print-out
\* sorts by content.
RECURSIVE AsSeq(_)
AsSeq(S) == IF S = {} THEN <<>>
            ELSE LET x == CHOOSE y \in S : TRUE IN <<x>> \o AsSeq(S \ {x})

\* Inputs the environment offers: armed timers; requests while numbers last.
\* One order of two timers of the same station is assumed: an entry sent when
\* leaving is given up (t_giveup) before the session is forgotten (t_life).
Offered(x, i) ==
  /\ i.kind = "expire" => i.timer \in Armed(Me, x)
  /\ i.kind = "expire" /\ i.timer[1] = "forget" =>
       \A e \in x.outbox : e.session[1] # i.timer[2]
  /\ i.kind = "command" /\ i.name = "request" =>
       Bound(x) \/ x.number + 1 \in OwnSessions

(***************************************************************************)
(* The print-out: tuples only.                                             *)
(***************************************************************************)
EntryT(e)   == <<e.type, e.to, e.session, e.seq, e.accepted>>
MessageT(m) == <<m.type, m.src, m.dst, m.session, m.seq, m.proposal,
                 m.accepted, m.reason, m.of>>
TimerT(t)   == IF Len(t) = 1 THEN t
               ELSE IF t[1] = "forget" THEN t ELSE <<t[1], EntryT(t[2])>>
StateT(x)   == << x.phase, x.role, x.session, x.recorded, x.withdrawn,
                  x.target, x.proposal, x.deciding, x.heard, x.number,
                  x.joined, {EntryT(e) : e \in x.outbox}, x.quarantine,
                  x.backoff >>
InputT(i) ==
  CASE i.kind = "receive" -> <<"receive", MessageT(i.message), i.concerned>>
    [] i.kind = "cam"     -> <<"cam", i.src, i.marks, i.newer>>
    [] i.kind = "command" -> <<"command", i.name, i.session, i.proposal, i.target>>
    [] i.kind = "expire"  -> <<"expire", TimerT(i.timer)>>
    [] i.kind = "restart" -> <<"restart">>

\* (The initial state changes on some inputs; then this is not used.)
Outputs(r) == <<{MessageT(m) : m \in r.out}, r.told, r.rule>>
Changes(j, r) ==
  <<j, StateT(r.st), {MessageT(m) : m \in r.out}, r.told, r.rule,
    {TimerT(t) : t \in r.arm}, {TimerT(t) : t \in r.stop}>>

\* Registers hold what must be computed once.
ALPHABET == 1
BASE     == 2

Compute ==
  LET alphabet == TLCEval(AsSeq(Alphabet)) IN
  /\ TLCSet(ALPHABET, alphabet)
  /\ TLCSet(BASE, TLCEval([j \in 1 .. Len(alphabet) |->
       IF Offered(Initial, alphabet[j])
       THEN Outputs(Step(Me, Initial, alphabet[j])) ELSE <<>>]))
  /\ \A j \in 1 .. Len(alphabet) :
       PrintT(ToString(<<"INPUT", j, InputT(alphabet[j]), TLCGet(BASE)[j]>>))

Init == st = Initial /\ Compute

Next ==
  \E alphabet \in {TLCGet(ALPHABET)} :
  \E base \in {TLCGet(BASE)} :
  \E rows \in {TLCEval([j \in {k \in 1 .. Len(alphabet) : Offered(st, alphabet[k])} |->
                 Step(Me, st, alphabet[j])])} :
  \E effective \in {{j \in DOMAIN rows : \/ rows[j].st # st
                                         \/ rows[j].arm # {}}} :
    /\ PrintT(ToString(<<"STATE", StateT(st), Marks(st),
         {Changes(j, rows[j]) : j \in effective},
         {<<j, Outputs(rows[j])>> :
            j \in {k \in DOMAIN rows \ effective : Outputs(rows[k]) # base[k]}},
         {j \in (1 .. Len(alphabet)) \ DOMAIN rows : alphabet[j].kind # "expire"}>>))
    /\ \E j \in effective : st' = rows[j].st

TypeInv == StationTypeInv(Me, st)
==============================================================================
