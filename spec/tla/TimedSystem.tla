----------------------------- MODULE TimedSystem -----------------------------
(***************************************************************************)
(* System with time.  The named timers get durations in ticks, a message   *)
(* takes at most Delay ticks, and CAMs are sent every CamInterval.  So the *)
(* orders of timers that System assumes need not be assumed: they follow   *)
(* (T-5), and S-1 to S-5 must hold without them.                           *)
(*                                                                         *)
(* Time passes only when nothing is due: a due timer fires at its instant, *)
(* before messages and commands of the same instant, and in the order of   *)
(* the table in docs/protocol.md.  All clocks run alike; Drift.tla lets    *)
(* one of them be slow.                                                    *)
(*                                                                         *)
(* What may go wrong is an Environment (Environments.tla), chosen at the   *)
(* start: whether the radio is perfect (every copy arrives within Delay)   *)
(* or lossy in each direction, what may be cut for good, which stations    *)
(* may abort or restart.  CAMs do not overtake each other (ASSUME), so a   *)
(* CAM that arrives is newer than the last one, unless one was forged      *)
(* (Forger.tla).                                                           *)
(*                                                                         *)
(* Of System it uses what a station may be asked, and the properties.  Of  *)
(* its variables, `net` is history here: the positive Acceptances that     *)
(* were sent.  What is on its way is `air`.                                *)
(***************************************************************************)
EXTENDS System, TLC

CONSTANTS
  ResendTime,    \* t_resend
  Sendings,      \* N: t_giveup is N * t_resend
  Delay,         \* a copy takes 0 .. Delay ticks
  CamInterval,   \* between two CAMs of a station
  CamLoss,       \* t_cam_loss
  Deciding,      \* t_decide
  Lease,         \* lease_ms
  Prompt,        \* an application answers at once, not within t_decide
  Environments   \* what may go wrong; see Environments.tla

ASSUME Lease >= CamLoss
ASSUME CamInterval > Delay
ASSUME 2 * Delay < ResendTime

Max(a, b) == IF a > b THEN a ELSE b
Min(a, b) == IF a < b THEN a ELSE b

GiveUpTime    == Sendings * ResendTime
AdvertiseTime == GiveUpTime
AnswerTime    == Deciding + GiveUpTime
HoldTime      == AdvertiseTime + Deciding + 2 * GiveUpTime
LifeTime      == 2 * GiveUpTime
\* Longer than an Advertisement can be heard (END-8), and than a prescriber
\* acts on the word of a receiver that has gone (ACT-6: CamLoss + Delay).
ActsOnTime     == CamLoss + Delay
QuarantineTime == Max(AdvertiseTime + LifeTime, ActsOnTime)

\* By how much a prescriber's lease is shorter than that of its target
\* (ACT-4): not at all, as clocks run alike here.
LeaseMargin == 0

VARIABLES
  env,     \* the Environment
  cut,     \* what may be cut is cut
  clock,   \* clock[s][t]: ticks until the armed timer t of s is due
  air,     \* copies on their way: [to, message, left, sure]
  next,    \* next[s]: ticks until the next CAM of s
  age,     \* age[s]: ticks s has been bound; while it is not, 0
  sends,   \* sends[s][e]: how often entry e was sent by its timer
  been,    \* history: <<session, s>>: sessions that s has ever joined
  hazard   \* ticks the hazard of T-2 has lasted

tvars == <<vars, env, cut, clock, air, next, age, sends, been, hazard>>
tview ==
  <<st, net, excused, env, cut, clock, air, next, age, sends, been, hazard>>

TInit ==
  /\ Init
  /\ env \in Environments
  /\ cut = FALSE
  /\ clock = [s \in Stations |-> <<>>]
  /\ air = {}
  /\ next \in [Stations -> 1 .. CamInterval]
  /\ age = [s \in Stations |-> 0]
  /\ sends = [s \in Stations |-> <<>>]
  /\ been = {}
  /\ hazard = 0

(***************************************************************************)
(* Timers                                                                  *)
(***************************************************************************)
DurationOf(s, t) ==
  CASE t[1] = "advertise"              -> AdvertiseTime
    [] t[1] = "resend"                 -> ResendTime
    [] t[1] = "giveup"                 -> GiveUpTime
    [] t[1] \in {"decide", "backoff"}  -> Deciding
    [] t[1] = "hold"                   -> HoldTime
    [] t[1] = "answer"                 -> AnswerTime
    [] t[1] = "cam"                    -> CamLoss
    [] t[1] = "lease"                  ->
         IF s \in Prescribers THEN Lease - LeaseMargin ELSE Lease
    [] t[1] = "quarantine"             -> QuarantineTime
    [] t[1] = "forget"                 ->
         Max(LifeTime, AdvertiseTime + LifeTime - age[s])

Duration(s, t) == DurationOf(s, t)

\* Those due at the same instant fire in this order.
Order(t) ==
  CASE t[1] = "advertise"  -> 1
    [] t[1] = "decide"     -> 3
    [] t[1] = "hold"       -> 4
    [] t[1] = "answer"     -> 5
    [] t[1] = "cam"        -> 6
    [] t[1] = "lease"      -> 7
    [] t[1] = "giveup"     -> 8
    [] t[1] = "resend"     -> IF t[2].type = "Advertisement" THEN 2 ELSE 9
    [] t[1] = "quarantine" -> 10
    [] t[1] = "forget"     -> 11
    [] t[1] = "backoff"    -> 12

Due(s)  == {t \in DOMAIN clock[s] : clock[s][t] = 0}
Settled == \A s \in Stations : Due(s) = {}

\* Timers armed anew beyond what Step says: none.
AlsoArmed(s, r) == {}

\* The timers that run after it: those of the station.
Running(s, i, r) == Armed(s, r.st)

Clock(s, i, r) ==
  LET after == Running(s, i, r)
      anew  == Expired(i) \cup r.again \cup AlsoArmed(s, r)
  IN [t \in after |-> IF t \in DOMAIN clock[s] /\ t \notin anew
                      THEN clock[s][t] ELSE Duration(s, t)]

Sends(s, i, r) ==
  [e \in r.st.outbox |->
     IF e \notin st[s].outbox THEN 1
     ELSE sends[s][e] + (IF <<"resend", e>> \in Expired(i) THEN 1 ELSE 0)]

(***************************************************************************)
(* The radio                                                               *)
(***************************************************************************)
Direction(s) == IF s \in Prescribers THEN "forward" ELSE "backward"
Cut(s)       == cut /\ Direction(s) \in env.cut

Addressees(m) == IF m.dst = Broadcast THEN Stations \ {m.src} ELSE {m.dst}

\* A copy is sure to arrive if the direction is perfect, or if it is the
\* last of the N that one of which gets through.
Sure(s, m, counts) ==
  \/ env.perfect[Direction(s)]
  \/ /\ env.one_passes
     /\ \E e \in DOMAIN counts : Copy(s, e) = m /\ counts[e] = Sendings

Copies(s, ms, counts) ==
  IF Cut(s) THEN {}
  ELSE UNION { { [to |-> t, message |-> m, left |-> Delay,
                  sure |-> Sure(s, m, counts)] : t \in Addressees(m) } :
               m \in {k \in ms : ~(k.type = "Cancel" /\ env.cancels_lost)} }

Cam(s) == [type |-> "CAM", src |-> s, dst |-> Broadcast, marks |-> Marks(st[s])]

\* A CAM without a mark counts for nobody, so it is left out.
SendsCam(s) == env.marks => Marks(st[s]) # {}

\* What a copy is to its addressee.
InputOf(c) ==
  IF c.message.type = "CAM"
  THEN [ kind |-> "cam", src |-> c.message.src, newer |-> TRUE,
         marks |-> c.message.marks ]
  ELSE [ kind |-> "receive", message |-> c.message,
         concerned |-> c.to \in Receivers ]

\* Without ACT-5 (env.marks FALSE) any CAM of the peer counts.  Without the
\* Cancel of ACT-2 (env.cancel FALSE) CAM loss is silent.
Effected(s, i) ==
  LET r == Decide(s, st[s], IF i.kind = "cam" /\ ~env.marks
                            THEN [i EXCEPT !.marks = {st[s].session}] ELSE i)
  IN
  IF i.kind = "expire" /\ i.timer[1] = "cam" /\ ~env.cancel
  THEN [r EXCEPT !.st = Leave(st[s]), !.out = {}] ELSE r

\* A copy that does nothing may as well be lost.
Useless(c) ==
  LET r == Effected(c.to, InputOf(c)) IN
  r.st = st[c.to] /\ r.out = {} /\ r.again = {}

\* An Ack of what is not in its addressee's outbox does nothing, now or ever.
Alive(copies, stations) ==
  {c \in copies : c.message.type = "Ack" =>
     \E e \in stations[c.to].outbox : AckMatches(e, c.message)}

(***************************************************************************)
(* Steps                                                                   *)
(***************************************************************************)
HazardNow ==
  \E s \in Stations :
    LET t == st[s].target IN
    /\ Acts(s, "prescriber")
    /\ ~(/\ Acts(t, "receiver") /\ st[t].session = st[s].session
         /\ st[t].proposal = st[s].proposal)

\* When to stop looking: never.
Goes == TRUE

TDo(s, i, taken) ==
  \E r \in {Effected(s, i)} :
  \E counts \in {Sends(s, i, r)} :
    /\ Goes
    /\ st' = [st EXCEPT ![s] = r.st]
    /\ clock' = [clock EXCEPT ![s] = Clock(s, i, r)]
    /\ sends' = [sends EXCEPT ![s] = counts]
    /\ air' = Alive((air \ taken)
                    \cup Copies(s, {Plain(m) : m \in r.out}, counts), st')
    /\ age' = [age EXCEPT ![s] = IF Bound(r.st) THEN @ ELSE 0]
    /\ net' = net \cup {Plain(m) : m \in {k \in r.out : /\ k.type = "Acceptance"
                                                        /\ k.accepted}}
    /\ excused' = IF Excuses(s, i) THEN excused \cup {<<st[s].session, s>>}
                  ELSE excused
    /\ been' = been \cup {<<x, s>> : x \in r.st.joined}
    /\ last' = [station |-> s, input |-> i, rule |-> r.rule]
    /\ UNCHANGED <<received, env, cut, next, hazard>>

FireDue(s) ==
  \E t \in {x \in Due(s) : \A y \in Due(s) : Order(x) <= Order(y)} :
    TDo(s, [kind |-> "expire", timer |-> t], {})

\* A copy arrives; what is taken out of the air is that copy, or nothing.
Arrives(c, taken) ==
  /\ Due(c.to) = {}
  /\ ~Useless(c)
  /\ TDo(c.to, InputOf(c), taken)

CamsInAir     == {c \in air : c.message.type = "CAM"}
MessagesInAir == air \ CamsInAir

HearCam   == \E c \in CamsInAir : Arrives(c, {c})
Deliver   == \E c \in MessagesInAir : Arrives(c, {c})
Duplicate == env.duplicates /\ \E c \in MessagesInAir : Arrives(c, {})

Obey(s) ==
  /\ Due(s) = {}
  /\ \E c \in Obeyed(s, env.commands) :
       /\ c.name = "abort" => s \in env.aborters
       /\ TDo(s, c, {})

TRestart(s) ==
  /\ s \in env.restarters
  /\ TDo(s, [kind |-> "restart"], {})

Event(name) == [station |-> Nobody, input |-> [kind |-> name], rule |-> "none"]

CutOff ==
  /\ Goes
  /\ env.cut # {} /\ ~cut /\ cut' = TRUE
  /\ air' = {c \in air : Direction(c.message.src) \notin env.cut}
  /\ last' = Event("cut")
  /\ UNCHANGED <<st, net, excused, received, env, clock, next, age, sends, been,
                 hazard>>

\* The application has been asked, or wants a maneuver.
Asked(s) ==
  LET x == st[s] IN
  \/ x.phase = "CHOOSING" \/ x.deciding
  \/ x.phase = "NEGOTIATING" /\ x.role = "receiver"
  \/ s \in Prescribers /\ ~Bound(x) /\ x.number < MaxSessions /\ ~x.backoff

\* Time passes; at the stations `slow` the clock stands still.
Pass(slow) ==
  /\ Settled
  /\ Prompt => \A s \in Stations : ~Asked(s)
  /\ \A c \in air : c.sure /\ c.left = 0 => Useless(c)
  /\ clock' = [s \in Stations |-> IF s \in slow THEN clock[s]
                 ELSE [t \in DOMAIN clock[s] |-> clock[s][t] - 1]]
  /\ next' = [s \in Stations |-> IF s \in slow THEN next[s]
                ELSE IF next[s] = 1 THEN CamInterval ELSE next[s] - 1]
  /\ air' = {[c EXCEPT !.left = @ - 1] : c \in {x \in air : x.left > 0}}
            \cup UNION { Copies(s, {Cam(s)}, <<>>) :
                           s \in {x \in Stations \ slow :
                                    next[x] = 1 /\ SendsCam(x)} }
  /\ age' = [s \in Stations |-> IF Bound(st[s]) THEN age[s] + 1 ELSE 0]
  /\ hazard' = IF HazardNow THEN hazard + 1 ELSE 0
  /\ last' = Event(IF slow = {} THEN "tick" ELSE "slow tick")
  /\ UNCHANGED <<st, net, excused, received, env, cut, sends, been>>

Tick == Goes /\ Pass({})

\* An action for each kind of input, and for what is none of a station.
TNext ==
  \/ \E s \in Stations : FireDue(s) \/ Obey(s) \/ TRestart(s)
  \/ HearCam \/ Deliver \/ Duplicate
  \/ CutOff
  \/ Tick

(***************************************************************************)
(* T-1: a session lasts at most so many ticks.  A receiver's last verdict  *)
(* leads to the lease, or to waiting once more.                            *)
(***************************************************************************)
RoundTime == Min(Lease, GiveUpTime + AnswerTime)
PrescriberTime ==
  AdvertiseTime + Deciding + (MaxRounds - 1) * (RoundTime + Deciding) + Lease
ReceiverTime ==
  GiveUpTime + MaxRounds * (HoldTime + Deciding) + Max(Lease, HoldTime)

DurationInv ==
  \A s \in Stations :
    age[s] <= IF st[s].role = "prescriber" THEN PrescriberTime ELSE ReceiverTime

(***************************************************************************)
(* T-3: a reliable message is sent at most N times by its timer.           *)
(***************************************************************************)
SendingsInv ==
  \A s \in Stations : \A e \in DOMAIN sends[s] : sends[s][e] <= Sendings

(***************************************************************************)
(* T-4: the prescriber's lease does not outlive its target's.              *)
(***************************************************************************)
LeaseInv ==
  \A s \in Stations :
    LET t == st[s].target IN
    /\ st[s].role = "prescriber" /\ t # Nobody /\ LeaseRuns(st[s])
    /\ Acts(t, "receiver") /\ st[t].session = st[s].session
    /\ st[t].proposal = st[s].proposal
    => clock[s][Timer("lease")] <= clock[t][Timer("lease")]

(***************************************************************************)
(* T-5: the orders of which the proof assumes all but that of the outbox   *)
(* (InOrder of Cutoff).  When a session is forgotten, or a quarantine      *)
(* ends, nobody advertises a session that the station has been in, or an   *)
(* older one, and no copy of its Advertisement is left; and nothing to its *)
(* prescriber is left in the outbox.  Nor does a prescriber act, or may    *)
(* still act, on the word of a station whose quarantine ends, but for what *)
(* is due in the same instant.                                             *)
(***************************************************************************)
Advertising(x) ==
  \/ \E p \in Stations : st[p].phase = "ADVERTISING" /\ st[p].session = x
  \/ \E c \in air : c.message.type = "Advertisement" /\ c.message.session = x

RelyOn(s) ==
  \E p \in Stations :
    /\ st[p].role = "prescriber" /\ st[p].target = s
    /\ \/ st[p].phase = "ACTUATING" /\ Due(p) = {}
       \/ /\ AwaitsAnswer(st[p])
          /\ \E c \in air : c.message = Acceptance(s, st[p].session, st[p].proposal)

OrdersInv ==
  \A s \in Stations : \A t \in Due(s) :
    /\ t[1] = "forget" =>
         /\ \A x \in st[s].joined : x[1] = t[2] =>
              \A n \in 1 .. x[2] : ~Advertising(<<x[1], n>>)
         /\ \A e \in st[s].outbox : e.session[1] # t[2]
    /\ t[1] = "quarantine" =>
         /\ \A x \in been : x[2] = s => ~Advertising(x[1])
         /\ ~RelyOn(s)

(***************************************************************************)
(* T-6: S-8 with real durations, where a receiver that has broken off is   *)
(* kept out by its quarantine alone.                                       *)
(***************************************************************************)
OneWordInv == ExclusiveInv

(***************************************************************************)
(* T-8: no CAM loss without a cause.  Where no CAM of the peer is lost, the *)
(* cam timer is due only when the peer has ceased to name the session.  It *)
(* holds iff CamLoss > CamInterval + Delay, which is not assumed.          *)
(***************************************************************************)
Heard(s) == /\ env.perfect[Direction(Peer(st[s]))]
            /\ Direction(Peer(st[s])) \notin env.cut

CamLossInv ==
  \A s \in Stations :
    Timer("cam") \in Due(s) /\ Heard(s) =>
      st[s].session \notin Marks(st[Peer(st[s])])

\* S-5 at the end of an instant: at its beginning both leases may be due.
SettledHazardInv == Settled => NoHazardInv

TSpec == TInit /\ [][TNext]_tvars

THEOREM TSpec => [](TypeInv /\ AcceptedInv /\ AgreementInv /\ SettledHazardInv)
THEOREM TSpec => [](DurationInv /\ SendingsInv /\ LeaseInv /\ OrdersInv)
THEOREM CamLoss > CamInterval + Delay => (TSpec => []CamLossInv)
THEOREM TSpec => OneSessionProp /\ CommitmentProp
==============================================================================
