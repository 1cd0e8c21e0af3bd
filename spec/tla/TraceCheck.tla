------------------------------ MODULE TraceCheck ------------------------------
(***************************************************************************)
(* Logs of single stations, held against Station.tla: the independent      *)
(* judge in the tests of "automcm trace explain".  Each behaviour follows  *)
(* one log, line by line.                                                  *)
(* Where no line can be taken any more, it prints DIVERGES with the line;  *)
(* at the end of the log it prints ALLOWED.                                *)
(*                                                                         *)
(* Logs is written by traces/tests/tlc_engine.py.  There stations          *)
(* are small numbers, times begin at 1, and contents are numbers too: the  *)
(* same content, the same number.                                          *)
(*                                                                         *)
(* What Station.tla leaves out is checked here: the counter behind seq, a  *)
(* copy byte for byte, what an Ack names, the content given by a command,  *)
(* the number of a new session, deadlines, and which CAM is newer.         *)
(*                                                                         *)
(* If a log promises every kind of event, there is one behaviour for it.   *)
(* Kinds that it does not promise (commands, timers, restarts) are guessed:*)
(* the log is allowed if one of its behaviours reaches the end.            *)
(***************************************************************************)
EXTENDS Station, Integers, Sequences, TLC

CONSTANT Logs

VARIABLES
  log,    \* which log
  at,     \* its next event
  st,     \* the station
  step,   \* the last input, and what still has to follow it
  box,    \* the messages behind the entries of the outbox
  armed,  \* timers and their deadlines
  count,  \* seq of the last new message in the session
  lease,  \* how long the lease timer of the current Prescription lasts, or Untold
  heard,  \* generation time of the last CAM that counted
  anchor  \* when the first CAM that counted was generated and received

vars == <<log, at, st, step, box, armed, count, lease, heard, anchor>>

(***************************************************************************)
(* Logs                                                                    *)
(***************************************************************************)
Untold == -1    \* a duration that the header does not tell

\* A message: that of Station.tla with its real seq, the number of its bytes,
\* the numbers of its contents, its lease, and whether it is well formed.
M(type, src, dst, session, seq, proposal, accepted, reason, of,
  body, content, ms, formed) ==
  [ type |-> type, src |-> src, dst |-> dst, session |-> session, seq |-> seq,
    proposal |-> proposal, accepted |-> accepted, reason |-> reason, of |-> of,
    body |-> body, content |-> content, lease |-> ms, formed |-> formed ]

\* A timer as a log names it; seq is the real one.
T(name, type, to, session, seq, station) ==
  [ name |-> name, type |-> type, to |-> to, session |-> session, seq |-> seq,
    station |-> station ]

\* Events.  m and timer are places in the tables of the log.
Event(kind, line, t)           == [kind |-> kind, line |-> line, t |-> t]
Received(line, t, m, concerned, given) ==
  [ kind |-> "receive", line |-> line, t |-> t, m |-> m,
    concerned |-> concerned, given |-> given ]
Malformed(line, t, must)       ==     \* must: it is reported for certain
  [kind |-> "malformed", line |-> line, t |-> t, must |-> must]
CamReceived(line, t, src, marks, generation) ==
  [ kind |-> "cam", line |-> line, t |-> t, src |-> src, marks |-> marks,
    generation |-> generation ]
Commanded(line, t, name, session, proposal, target, given, ms, opens) ==
  [ kind |-> "command", line |-> line, t |-> t, name |-> name,
    session |-> session, proposal |-> proposal, target |-> target,
    given |-> given, lease |-> ms, opens |-> opens ]
Sent(line, t, m)               == [kind |-> "send", line |-> line, t |-> t, m |-> m]
CamSent(line, t, src, marks)   ==
  [kind |-> "beacon", line |-> line, t |-> t, src |-> src, marks |-> marks]
Armed_(line, t, timer, lasts)  ==
  [kind |-> "arm", line |-> line, t |-> t, timer |-> timer, lasts |-> lasts]
Stopped(line, t, timer)        ==
  [kind |-> "stop", line |-> line, t |-> t, timer |-> timer]
Expires(line, t, timer)        ==
  [kind |-> "expire", line |-> line, t |-> t, timer |-> timer]
Told(line, t, name, fields)    ==     \* fields: those that are compared
  [kind |-> "told", line |-> line, t |-> t, name |-> name, fields |-> fields]

\* The logs are kept in a register: each definition that names the constant
\* would have TLC look through all of them once more.
LOGS == 1

This        == TLCGet(LOGS)[log]
Me          == This.me
Promised(k) == k \in This.complete

(***************************************************************************)
(* The step that goes on                                                   *)
(***************************************************************************)
NoMessage == M("none", Nobody, Nobody, NoSession, 0, 0, FALSE, "none",
               <<"none", 0>>, 0, <<>>, Untold, TRUE)

\* got is the message received, session that before the step.
NoStep ==
  [ line |-> 0, t |-> 0, session |-> NoSession, rule |-> "", out |-> {},
    arm |-> {}, stop |-> {}, free |-> {}, told |-> Nothing, must |-> FALSE,
    given |-> <<>>, got |-> NoMessage ]

Missing ==
  \/ step.out # {}
  \/ Promised("timer") /\ (step.arm # {} \/ step.stop # {})
  \/ step.must /\ step.told # Nothing

\* The messages behind the station's outbox, and its Advertisement.
Kept ==
  {b \in box : \/ b.entry \in st.outbox
               \/ /\ b.entry.type = "Advertisement"
                  /\ st.phase = "ADVERTISING" /\ b.entry.session = st.session}

Behind(messages, type, to, session, seq) ==
  {b \in messages : /\ b.entry.type = type /\ b.entry.to = to
                    /\ b.entry.session = session /\ b.seq = seq}

\* A timer of the log as Station.tla has it.
Named(n) ==
  IF n.name \in {"resend", "giveup"}
  THEN LET found == Behind(box, n.type, n.to, n.session, n.seq) IN
       IF found = {} THEN <<"unknown">>
                     ELSE <<n.name, (CHOOSE b \in found : TRUE).entry>>
  ELSE IF n.name = "forget" THEN Forget(n.station)
  ELSE Timer(n.name)

Duration(timer, ms) == IF timer[1] = "lease" THEN ms ELSE This.lasts[timer[1]]

Due(timer, t, ms) ==
  LET lasts == Duration(timer, ms) IN
  [ timer |-> timer, due |-> IF lasts = Untold THEN t ELSE t + lasts,
    sure |-> lasts # Untold ]

Without(timers) == {a \in armed : a.timer \notin timers}

\* The timers after a step: they are told by the lines that follow, or else
\* by the step itself.
Runs(r, t, ms, expired) ==
  IF Promised("timer") THEN Without(expired)
  ELSE Without(expired \cup r.arm \cup r.stop)
       \cup {Due(timer, t, ms) : timer \in r.arm}

\* Due timers expire by deadline, then in the order of the table of
\* docs/protocol.md, section 3, then by the age of their messages.
Rank(timer) ==
  IF timer[1] = "resend" /\ timer[2].type = "Advertisement"
  THEN This.rank.advertised ELSE This.rank[timer[1]]

Age(timer) ==
  LET behind == IF timer[1] \in {"resend", "giveup"}
                THEN {b \in box : b.entry = timer[2]} ELSE {}
  IN IF behind = {} THEN 0 ELSE (CHOOSE b \in behind : TRUE).at

Earlier(a, b) ==
  \/ a.due < b.due
  \/ /\ a.due = b.due
     /\ \/ Rank(a.timer) < Rank(b.timer)
        \/ Rank(a.timer) = Rank(b.timer) /\ Age(a.timer) < Age(b.timer)

\* The timers that should have expired before the event: those due long
\* before.  If timers are complete, also those due at the instant of a message
\* or command, or due before the timer that expires.
Missed(e) ==
  LET due == {a \in armed : a.sure /\ a.due <= e.t}
      instant == /\ e.kind \in {"receive", "cam", "command"}
                 /\ \E a \in due : a.due = e.t
      turn(a) == /\ e.kind = "expire"
                 /\ \E b \in due : b.timer = Named(This.timers[e.timer])
                                  /\ Earlier(a, b)
  IN {a \in due : \/ e.t > a.due + This.late
                  \/ Promised("timer") /\ (instant \/ turn(a))}

(***************************************************************************)
(* Verdicts                                                                *)
(***************************************************************************)
EntryT(e)   == <<e.type, e.to, e.session, e.seq, e.accepted>>
MessageT(m) == <<m.type, m.dst, m.session, m.seq, m.proposal, m.accepted,
                 m.reason>>
TimerT(t)   == IF Len(t) = 1 \/ t[1] = "forget" THEN t
               ELSE <<t[1], EntryT(t[2])>>

Wanted(s) ==
  << {MessageT(m) : m \in s.out}, {TimerT(t) : t \in s.arm},
     {TimerT(t) : t \in s.stop}, IF s.must THEN s.told ELSE Nothing >>

Verdict(what, line, rule, wanted) ==
  PrintT(ToString(<<what, log, line, rule, wanted>>)) /\ FALSE

Diverges(line)  == Verdict("DIVERGES", line, step.rule, Wanted(step))

\* The rule is that by which the timer expires.
ByTimer(line, timer, wanted) ==
  Verdict("DIVERGES", line, Step(Me, st, [kind |-> "expire", timer |-> timer]).rule,
          <<{TimerT(t) : t \in wanted}>>)
Overdue(line, late) ==
  LET first == (CHOOSE a \in late : ~ \E b \in late : Earlier(b, a)).timer
  IN ByTimer(line, first, {first})
NotArmed(line, n) ==  \* only the type of the message matters
  LET e == [ type |-> n.type, to |-> Nobody, session |-> NoSession, seq |-> 0,
             accepted |-> FALSE ]
  IN ByTimer(line, IF n.name \in {"resend", "giveup"} THEN <<n.name, e>> ELSE Named(n),
             {a.timer : a \in armed})

(***************************************************************************)
(* Inputs                                                                  *)
(***************************************************************************)
Begin(line, t, r, must, given, got) ==
  /\ st' = r.st
  /\ step' = [ line |-> line, t |-> t, session |-> st.session, rule |-> r.rule,
               out |-> r.out, arm |-> r.arm, stop |-> r.stop, free |-> {},
               told |-> r.told, must |-> must, given |-> given, got |-> got ]
  /\ box' = Kept
  /\ count' = IF Bound(st) THEN count ELSE 0

\* Between two steps: nothing follows.
Rest ==
  /\ step' = NoStep /\ box' = Kept
  /\ UNCHANGED <<st, armed, count, lease, heard, anchor>>

\* What an Ack names, as Station.tla numbers it: what is not in the outbox has
\* the number of an answer, which counts for nothing (END-6).
Acked(m) ==
  LET found == Behind(Kept, m.of[1], m.src, m.session, m.of[2])
  IN <<m.of[1], IF found = {} THEN 0 ELSE (CHOOSE b \in found : TRUE).entry.seq>>

Heard(m) ==
  [ type |-> m.type, src |-> m.src, dst |-> m.dst, session |-> m.session,
    seq |-> IF m.seq = 0 THEN 0
            ELSE IF m.type \in {"Prescription", "Acceptance"} THEN m.proposal
            ELSE 1,
    proposal |-> m.proposal, accepted |-> m.accepted, reason |-> m.reason,
    of |-> IF m.type = "Ack" THEN Acked(m) ELSE <<"none", 0>> ]

OnReceive(e) ==
  LET m == This.messages[e.m]
      r == Step(Me, st, [ kind |-> "receive", message |-> Heard(m),
                          concerned |-> e.concerned ])
      ms == IF /\ m.type = "Prescription" /\ r.st.phase = "NEGOTIATING"
               /\ st.phase # "NEGOTIATING" THEN m.lease ELSE lease
  IN /\ Begin(e.line, e.t, r, Promised("indication"), e.given, m)
     /\ lease' = ms /\ armed' = Runs(r, e.t, ms, {}) /\ UNCHANGED <<heard, anchor>>

\* END-5: bytes that are no message.  One that names another station may be
\* dropped silently.
OnMalformed(e) ==
  /\ step' = [NoStep EXCEPT !.line = e.line, !.rule = "END-5",
                !.told = <<"discarded">>,
                !.must = e.must /\ Promised("indication")]
  /\ box' = Kept /\ UNCHANGED <<st, armed, count, lease, heard, anchor>>

\* Divided first, since the product may exceed TLC's integers.
PerCent(p, ms) == p * (ms \div 100) + (p * (ms % 100) + 99) \div 100

\* ACT-5: newer than the last CAM that counted, and not too far ahead of the
\* first one.
Newer(e) ==
  LET elapsed == e.t - anchor.t IN
  \/ ~st.heard
  \/ /\ e.generation > heard
     /\ e.generation - anchor.generation - elapsed - This.slack
          <= PerCent(This.drift, elapsed)

OnCamReceived(e) ==                                            \* ACT-5
  LET r == Step(Me, st, [ kind |-> "cam", src |-> e.src, marks |-> e.marks,
                          newer |-> Newer(e) ])
  IN /\ Begin(e.line, e.t, r, FALSE, <<>>, NoMessage)
     /\ armed' = Runs(r, e.t, lease, {}) /\ UNCHANGED lease
     /\ heard' = IF Timer("cam") \in r.arm THEN e.generation ELSE heard
     /\ anchor' = IF Timer("cam") \in r.arm /\ ~st.heard
                 THEN [generation |-> e.generation, t |-> e.t] ELSE anchor

\* A new session may have any number above the last one: opens is that of the
\* Advertisement that follows, or 0.
Numbered(number) == IF number > st.number THEN [st EXCEPT !.number = number - 1]
                                          ELSE st

Command(name, session, proposal, target) ==
  [ kind |-> "command", name |-> name, session |-> session,
    proposal |-> proposal, target |-> target ]

Obeys(c, opens) ==
  LET r == Step(Me, Numbered(opens), c)
  IN IF c.name = "request" /\ r.told # <<"refused">> THEN r ELSE Step(Me, st, c)

OnCommanded(e) ==
  LET r == Obeys(Command(e.name, e.session, e.proposal, e.target), e.opens)
      ms == IF e.name = "prescribe" /\ r.out # {} THEN e.lease ELSE lease
  IN /\ Begin(e.line, e.t, r, Promised("indication"), e.given, NoMessage)
     /\ lease' = ms /\ armed' = Runs(r, e.t, ms, {}) /\ UNCHANGED <<heard, anchor>>

Expire(line, t, timer) ==
  LET r == Step(Me, st, [kind |-> "expire", timer |-> timer])
  IN /\ Begin(line, t, r, Promised("indication"), <<>>, NoMessage)
     /\ armed' = Runs(r, t, lease, {timer}) /\ UNCHANGED <<lease, heard, anchor>>

OnExpires(e) ==
  LET timer == Named(This.timers[e.timer]) IN
  IF \E a \in armed : a.timer = timer /\ a.due <= e.t
  THEN Expire(e.line, e.t, timer)
  ELSE NotArmed(e.line, This.timers[e.timer])

\* END-8: all timers stop, whether the log says so or not.
Restarted(line, t) ==
  LET r == Step(Me, st, [kind |-> "restart"]) IN
  /\ st' = r.st
  /\ step' = [NoStep EXCEPT !.line = line, !.rule = r.rule, !.arm = r.arm,
                !.free = {a.timer : a \in armed}]
  /\ armed' = IF Promised("timer") THEN {}
              ELSE {Due(timer, t, lease) : timer \in r.arm}
  /\ count' = 0 /\ UNCHANGED <<box, lease, heard, anchor>>

OnCamSent(e) ==                                                \* ACT-5
  IF e.src = Me /\ e.marks = Marks(st) THEN Rest
  ELSE Verdict("DIVERGES", e.line, "ACT-5", <<Marks(st)>>)

(***************************************************************************)
(* What follows an input                                                   *)
(***************************************************************************)
Carries(type) ==
  CASE type = "Advertisement" -> {"scenario", "details", "planned"}
    [] type = "Intention"     -> {"planned"}
    [] type = "Prescription"  -> {"prescribed", "hold_ms", "lease_ms"}
    [] type = "Acceptance"    -> {"selected"}
    [] OTHER                  -> {}

AsGiven(m) ==
  \A f \in Carries(m.type) \cap DOMAIN step.given :
    f \in DOMAIN m.content /\ m.content[f] = step.given[f]

\* Whether the message m of the log is the message x of the specification.
Fits(x, m) ==
  LET first == {b \in box : b.entry = Entry(x)} IN
  /\ m.formed
  /\ m.type = x.type /\ m.src = Me /\ m.dst = x.dst /\ m.session = x.session
  /\ m.proposal = x.proposal /\ m.accepted = x.accepted
  /\ IF first # {} THEN \E b \in first : m.body = b.body      \* a copy
     ELSE /\ m.reason = x.reason
          /\ m.of = IF x.type = "Ack" THEN <<step.got.type, step.got.seq>> ELSE <<"none", 0>>
          /\ m.seq = IF x.seq = 0 THEN 0 ELSE count + 1       \* END-6
          /\ AsGiven(m)

OnSent(e) ==
  LET m == This.messages[e.m]
      fits == {x \in step.out : Fits(x, m)}
  IN IF fits = {} THEN Diverges(e.line)
     ELSE LET x == CHOOSE y \in fits : TRUE
              new == x.seq # 0 /\ ~ \E b \in box : b.entry = Entry(x)
          IN /\ step' = [step EXCEPT !.out = @ \ {x}]
             /\ box' = IF new THEN box \cup {[ entry |-> Entry(x),
                                               seq |-> m.seq, body |-> m.body,
                                               at |-> at ]}
                              ELSE box
             /\ count' = IF new THEN m.seq ELSE count
             /\ lease' = IF new /\ m.type = "Prescription" THEN m.lease
                                                           ELSE lease
             /\ UNCHANGED <<st, armed, heard, anchor>>

OnArmed(e) ==
  LET timer == Named(This.timers[e.timer])
      lasts == Duration(timer, lease)
  IN IF timer \in step.arm /\ lasts \in {Untold, e.lasts}
     THEN /\ step' = [step EXCEPT !.arm = @ \ {timer}]
          /\ armed' = Without({timer}) \cup
                      {[timer |-> timer, due |-> e.t + e.lasts, sure |-> TRUE]}
          /\ UNCHANGED <<st, box, count, lease, heard, anchor>>
     ELSE Diverges(e.line)

OnStopped(e) ==
  LET timer == Named(This.timers[e.timer]) IN
  IF timer \in step.stop \cup step.free
  THEN /\ step' = [step EXCEPT !.stop = @ \ {timer}, !.free = @ \ {timer}]
       /\ armed' = IF timer \in step.stop THEN Without({timer}) ELSE armed
       /\ UNCHANGED <<st, box, count, lease, heard, anchor>>
  ELSE Diverges(e.line)

AsTold(f, value) ==
  CASE f = "rule"          -> value = step.rule
    [] f = "session"       -> value = step.session
    [] f = "proposal"      ->
         value = IF step.told[1] = "propose" THEN st.proposal + 1 ELSE st.proposal
    [] f = "reason"        ->
         value = IF Len(step.told) = 2 THEN step.told[2] ELSE step.got.reason
    [] f \in {"stations", "intentions"}     -> value = st.recorded
    [] f \in {"prescription", "acceptance"} -> value = step.got.body
    [] f = "lease_left_ms" ->
         \A a \in armed : /\ a.timer = Timer("lease") /\ a.sure
                          /\ a.due < This.largest  \* else it may be a larger one
                          => value = a.due - step.t
    [] OTHER               ->    \* a trajectory
         f \in DOMAIN step.got.content /\ value = step.got.content[f]

OnTold(e) ==
  IF /\ step.told[1] = e.name /\ step.told # Nothing
     /\ \A f \in DOMAIN e.fields : AsTold(f, e.fields[f])
  THEN /\ step' = [step EXCEPT !.told = Nothing]
       /\ UNCHANGED <<st, box, armed, count, lease, heard, anchor>>
  ELSE Diverges(e.line)

(***************************************************************************)
(* What a log may leave out                                                *)
(***************************************************************************)
Guesses ==
  {Command("request", NoSession, 0, Nobody)}
  \cup {Command("prescribe", st.session, NextProposal(st.proposal), p) :
          p \in st.recorded \cup {st.target}}
  \cup {Command(name, st.session, st.proposal, Nobody) :
          name \in {"accept", "refuse", "close", "proceed", "complete", "abort"}}

\* The number of the Advertisement that comes next, or 0.
Opens(e) == IF e.kind = "send" /\ This.messages[e.m].type = "Advertisement"
            THEN This.messages[e.m].session[2] ELSE 0

Refused(e) == e.kind = "told" /\ e.name = "refused"

Unlogged(e) ==
  /\ ~Missing /\ UNCHANGED <<log, at>>
  /\ \/ /\ ~Promised("timer")
        /\ \E a \in armed :
             /\ a.due <= e.t
             /\ Expire(e.line, IF a.sure /\ e.kind # "send" THEN a.due ELSE e.t,
                       a.timer)
     \/ /\ ~Promised("command")
        /\ \E c \in Guesses : \E r \in {Obeys(c, Opens(e))} :
             /\ (r.told = <<"refused">>) = Refused(e)
             /\ Begin(e.line, e.t, r, Promised("indication"), <<>>, NoMessage)
             /\ armed' = Runs(r, e.t, Untold, {})
             /\ lease' = IF c.name = "prescribe" THEN Untold ELSE lease
             /\ UNCHANGED <<heard, anchor>>
     \/ ~Promised("restart") /\ Restarted(e.line, e.t)

(***************************************************************************)
(* The next line                                                           *)
(***************************************************************************)
Effects == {"send", "arm", "stop", "told"}

Follows(e) ==
  CASE e.kind = "send" -> OnSent(e)
    [] e.kind = "arm"  -> OnArmed(e)
    [] e.kind = "stop" -> OnStopped(e)
    [] e.kind = "told" -> OnTold(e)

Input(e) ==
  CASE e.kind = "receive"   -> OnReceive(e)
    [] e.kind = "malformed" -> OnMalformed(e)
    [] e.kind = "cam"       -> OnCamReceived(e)
    [] e.kind = "command"   -> OnCommanded(e)
    [] e.kind = "expire"    -> OnExpires(e)

\* A restart loses what was due.
Line(e) ==
  IF e.kind \in Effects THEN Follows(e)
  ELSE IF Missing THEN Diverges(step.line)
  ELSE IF e.kind = "restart" THEN Restarted(e.line, e.t)
  ELSE IF Missed(e) # {} THEN Overdue(e.line, Missed(e))
  ELSE IF e.kind = "beacon" THEN OnCamSent(e)
  ELSE Input(e)

\* Where a line says phase and role, they are those after the step.
AsSaid(e) ==
  \/ This.says[at] = 0
  \/ LET said == This.said[This.says[at]] IN
     IF said[1] \in {"", st'.phase} /\ said[2] \in {"", st'.role} THEN TRUE
     ELSE Verdict("DIVERGES", e.line, step'.rule, <<st'.phase, st'.role>>)

\* Without its end a log may lack what followed the last input.
AtEnd == IF This.ended /\ Missing THEN Diverges(step.line)
                                  ELSE Verdict("ALLOWED", 0, "", <<>>)

Init ==
  /\ TLCSet(LOGS, Logs)
  /\ log \in DOMAIN Logs /\ at = 1
  /\ st = Initial /\ step = NoStep /\ box = {} /\ armed = {}
  /\ count = 0 /\ lease = Untold /\ heard = 0
  /\ anchor = [generation |-> 0, t |-> 0]

Next ==
  IF at > Len(This.events) THEN AtEnd /\ UNCHANGED vars
  ELSE \E e \in {This.events[at]} :
         \/ Line(e) /\ at' = at + 1 /\ UNCHANGED log /\ AsSaid(e)
         \/ Unlogged(e)
==============================================================================
