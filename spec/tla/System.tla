-------------------------------- MODULE System --------------------------------
(***************************************************************************)
(* Several stations and the radio, closed and untimed.                     *)
(*                                                                         *)
(* Any armed timer may expire at any moment, so everything that a clock    *)
(* could bring about can happen here, and more.  Only these orders of      *)
(* timers in DIFFERENT stations are assumed (MayExpire):                   *)
(*  - T-4: a receiver's lease does not end while its prescriber's runs;    *)
(*  - a receiver forgets a session, or ends its quarantine, only when the  *)
(*    Advertisements it may have heard before are no longer being sent and *)
(*    no copy of them is left (t_advertise + t_life: END-8, ADV-8).  For   *)
(*    simplicity nobody at all advertises then, and all such copies die;   *)
(*    this leaves out that a newer session is open at that moment;         *)
(*  - nor does a quarantine end while a prescriber acts, or still may, on  *)
(*    what the station agreed to before (ACT-6).                           *)
(* Cutoff, and the proof of Inductive, assume T-4 and T-5 alone.           *)
(*                                                                         *)
(* Reduced = TRUE leaves out behaviours that others simulate.  The net     *)
(* never shrinks and more messages in it never disable anything, so a      *)
(* state with more messages simulates the same state with fewer:           *)
(*  - an answer that changes nothing at its sender is sent at once;        *)
(*  - a Fin, Cancel or Acceptance is given up at once: in the outbox it    *)
(*    could only add copies of a message that is in the net for good, and  *)
(*    keep back a Cancel(closed);                                          *)
(*  - so is an Intention, which makes its sender WAITING: that can do all  *)
(*    that INTENDING can, and let the hold timer expire besides;           *)
(*  - every Ack is lost.  Its effect is that of give-up; and a prescriber  *)
(*    that is NEGOTIATING because of one does nothing that it could not do *)
(*    in PRESCRIBING (an answer in time, none in time, the lease);         *)
(*  - a back-off ends at once;                                             *)
(*  - a message that can do nothing any more is taken away: it is for a    *)
(*    session that its addressee has left and cannot join again, and what  *)
(*    is answered to it is in the net already, or is one of these.         *)
(* S-6 is about Acks, so it is checked with Reduced = FALSE, and with it   *)
(* all the others once more.                                               *)
(***************************************************************************)
EXTENDS Network

CONSTANTS
  Stations,      \* ids of the stations, from 1
  Prescribers,   \* those that may open sessions
  Receivers,     \* those that may join one
  Restarters,    \* those that may restart
  MaxSessions,   \* sessions a prescriber may open
  Forgetting,    \* whether quarantine and forget may expire
  Reduced        \* see above; `received` is kept only if FALSE

ASSUME LimitsSuffice
ASSUME Prescribers \cup Receivers \cup Restarters \subseteq Stations

VARIABLES
  st,        \* st[s]: station s
  net,       \* the radio
  excused,   \* history: <<session, receiver>> that aborted, lost CAMs, restarted
  received,  \* history: reliable messages their addressee has received
  last       \* history: what happened in the last step.  No guard reads it
             \* and the VIEW hides it; action properties look at last'.

vars == <<st, net, excused, received, last>>

\* What TLC takes for a state.  It hides nothing that a property reads: an
\* invariant reads no `last`, and an action property reads last' only, which TLC
\* checks on every step, whether the state after it is new or not.
view == <<st, net, excused, received>>

Init ==
  /\ st = [s \in Stations |-> Initial]
  /\ net = {}
  /\ excused = {}
  /\ received = {}
  /\ last = [station |-> Nobody, input |-> [kind |-> "start"], rule |-> "none"]

(***************************************************************************)
(* Inputs of station s                                                     *)
(***************************************************************************)
Receptions(s) ==
  { [kind |-> "receive", message |-> m, concerned |-> s \in Receivers] :
      m \in MessagesTo(net, s) }

Cmd(name, session, proposal, target) ==
  [ kind |-> "command", name |-> name, session |-> session,
    proposal |-> proposal, target |-> target ]

\* An application may ask for anything at any time; what is out of place is
\* refused, and a refused command is no step.
Commands(s) ==
  LET x == st[s] IN
  If(s \in Prescribers /\ x.number < MaxSessions,
     {Cmd("request", NoSession, 0, Nobody)})
  \cup If(Bound(x),
     {Cmd("prescribe", x.session, NextProposal(x.proposal), p) : p \in Stations}
     \cup {Cmd(name, x.session, x.proposal, Nobody) : name \in {"accept", "refuse"}}
     \cup {Cmd(name, x.session, 0, Nobody) :
             name \in {"close", "proceed", "complete", "abort"}})

\* Those of these names that do something: where a refused one would be a step,
\* it is left out.
Obeyed(s, names) ==
  {c \in Commands(s) : c.name \in names /\ Decide(s, st[s], c).st # st[s]}

\* T-4
LeaseOutlived(s) ==
  st[s].role = "receiver" =>
    LET p == st[st[s].session[1]] IN
    ~(/\ p.session = st[s].session /\ p.target = s
      /\ p.proposal = st[s].proposal /\ LeaseRuns(p))

\* The Advertisements of p (of everybody: p = Nobody) are history.
Advertised(p) == {m \in net : /\ m.type = "Advertisement"
                              /\ p \in {m.src, Nobody}}
Advertises(p) == \E q \in Stations : /\ p \in {q, Nobody}
                                     /\ st[q].phase = "ADVERTISING"

\* A prescriber acts on the word of s, or still may: the Acceptance is in the
\* net (ACT-6).
Relied(s) ==
  \E p \in Stations :
    /\ st[p].role = "prescriber" /\ st[p].target = s
    /\ \/ st[p].phase = "ACTUATING"
       \/ /\ AwaitsAnswer(st[p])
          /\ Acceptance(s, st[p].session, st[p].proposal) \in net

MayExpire(s, t) ==
  CASE t[1] = "lease"      -> LeaseOutlived(s)
    [] t[1] = "forget"     -> /\ Forgetting /\ ~Advertises(t[2])
                              /\ \A e \in st[s].outbox : e.session[1] # t[2]
    [] t[1] = "quarantine" -> Forgetting /\ ~Advertises(Nobody) /\ ~Relied(s)
    [] OTHER               -> TRUE

\* What has died out when the timer expires.
Dies(i) ==
  IF i.kind # "expire" THEN {}
  ELSE CASE i.timer[1] = "forget"     -> Advertised(i.timer[2])
         [] i.timer[1] = "quarantine" -> Advertised(Nobody)
         [] OTHER                     -> {}

Expiries(s) ==
  { [kind |-> "expire", timer |-> t] :
      t \in {x \in Armed(s, st[s]) : MayExpire(s, x)} }

(***************************************************************************)
(* Steps                                                                   *)
(***************************************************************************)
\* The only three things that excuse a hazard (S-5): the receiver itself
\* aborts, loses CAMs or restarts.
Excuses(s, i) ==
  /\ st[s].role = "receiver"
  /\ \/ i.kind = "restart"
     \/ i.kind = "command" /\ i.name = "abort"
     \/ i.kind = "expire" /\ i.timer[1] = "cam"

Received(i) ==
  IF ~Reduced /\ i.kind = "receive" /\ i.message.seq # 0
     /\ i.message.type # "Advertisement"
  THEN {i.message} ELSE {}

\* The reductions.
GivenUp(x) ==
  IF Reduced
  THEN [x EXCEPT !.outbox = {e \in @ : e.type = "Prescription"},
                 !.phase = IF @ = "INTENDING" THEN "WAITING" ELSE @,
                 !.backoff = FALSE]
  ELSE x

Heeded(ms) == {Plain(m) : m \in {k \in ms : ~Reduced \/ k.type # "Ack"}}

\* What station s answers to messages ms without changing.  (A Fin or Cancel
\* is answered by an Ack, which is not heeded.)
Answers(s, x, ms) ==
  UNION { IF r.st = x THEN Heeded(r.out) ELSE {} :
            r \in { Decide(s, x, [ kind |-> "receive", message |-> m,
                                   concerned |-> FALSE ]) :
                      m \in {k \in MessagesTo(ms, s) :
                               k.type \in {"Intention", "Prescription",
                                           "Acceptance"}} } }

AllAnswers(s, x, new, all) ==
  IF Reduced
  THEN Answers(s, x[s], all) \cup UNION {Answers(t, x[t], new) : t \in Stations}
  ELSE {}

\* (The Acceptances that were sent stay: S-3 and Coordination look at them.)
Dead(x, m) ==
  LET p == m.session[1]
      r == m.dst
  IN \/ /\ r = p /\ x[p].session # m.session /\ m.session[2] <= x[p].number
        /\ ~(m.type = "Acceptance" /\ m.accepted)
     \/ /\ r \notin {p, Broadcast} /\ x[r].session # m.session
        /\ ~NewerThanJoined(x[r], m.session)
        /\ \/ m.type \in {"Fin", "Cancel"}
           \/ m.type = "Prescription" /\ x[p].session # m.session

Living(x, ms) == IF Reduced THEN {m \in ms : ~Dead(x, m)} ELSE ms

\* Reduced, all that is answered without a change is in the net already: such
\* an input does nothing.  (view' # view in Moves says the same, later.)
Idle(s, r) ==
  Reduced /\ r.st = st[s] /\ Living(st, Heeded(r.out)) \subseteq net

\* view' # view is a guard: an input that does nothing is no step.  Without it
\* nothing but `last` would change, and each refused command and each copy of a
\* message would be one more step of stuttering.
Moves(s, i, dying) ==
  \E r \in {x \in {Decide(s, st[s], i)} : ~Idle(s, x)} :
  \E x \in {[st EXCEPT ![s] = GivenUp(r.st)]} :
  \E n \in {Sent(Died(net, dying), Heeded(r.out))} :
    /\ st' = x
    /\ net' = Living(x, Sent(n, AllAnswers(s, x, n \ net, n)))
    /\ excused' = IF Excuses(s, i) THEN excused \cup {<<st[s].session, s>>}
                  ELSE excused
    /\ received' = received \cup Received(i)
    /\ view' # view

Happened(s, i) ==
  last' = [station |-> s, input |-> i, rule |-> Decide(s, st[s], i).rule]

Do(s, i) == Moves(s, i, Dies(i)) /\ Happened(s, i)

\* An action for each kind of input, so that TLC names it in a counterexample
\* and counts each one in its coverage; last' has the input itself.
Restart(s) == s \in Restarters /\ Do(s, [kind |-> "restart"])
Expire(s)  == \E i \in Expiries(s)   : Do(s, i)
Receive(s) == \E i \in Receptions(s) : Do(s, i)
Command(s) == \E i \in Commands(s)   : Do(s, i)

Next ==
  \E s \in Stations : Restart(s) \/ Expire(s) \/ Receive(s) \/ Command(s)

Spec == Init /\ [][Next]_vars

(***************************************************************************)
(* Helpers of the properties                                               *)
(***************************************************************************)
Acts(s, role) == st[s].phase = "ACTUATING" /\ st[s].role = role

TypeInv == \A s \in Stations : StationTypeInv(s, st[s])

(***************************************************************************)
(* S-1: bound to one session at a time, changed only through STANDALONE.   *)
(***************************************************************************)
OneSessionProp ==
  [][ \A s \in Stations :
        Bound(st[s]) /\ Bound(st'[s]) => st'[s].session = st[s].session ]_vars

(***************************************************************************)
(* S-2: a commitment is never replaced, and ends only by Fin, Cancel, CAM  *)
(* loss, abort, lease or restart of its own session.                       *)
(***************************************************************************)
EndsCommitment(x, i) ==
  CASE i.kind = "restart" -> TRUE
    [] i.kind = "command" -> i.name = "abort"
    [] i.kind = "expire"  -> i.timer[1] \in {"cam", "lease"}
    [] i.kind = "receive" -> /\ i.message.type \in {"Fin", "Cancel"}
                             /\ i.message.src = x.session[1]
                             /\ i.message.session = x.session
    [] OTHER              -> FALSE

CommitmentProp ==
  [][ \A s \in Stations : Acts(s, "receiver") =>
        \/ /\ st'[s].phase = "ACTUATING" /\ st'[s].role = "receiver"
           /\ st'[s].session = st[s].session
           /\ st'[s].proposal = st[s].proposal
        \/ /\ st'[s].phase = "STANDALONE"
           /\ last'.station = s /\ EndsCommitment(st[s], last'.input) ]_vars

(***************************************************************************)
(* S-3: a prescriber acts on an Acceptance for exactly its session and     *)
(* proposal, which its target really sent.                                 *)
(***************************************************************************)
AcceptedInv ==
  \A s \in Stations : Acts(s, "prescriber") =>
    \E m \in net : /\ m.type = "Acceptance" /\ m.accepted
                   /\ m.src = st[s].target /\ m.dst = s
                   /\ m.session = st[s].session
                   /\ m.proposal = st[s].proposal

(***************************************************************************)
(* S-4: two that act in one session hold the same proposal, and one of     *)
(* them is its prescriber.                                                 *)
(***************************************************************************)
AgreementInv ==
  \A s, t \in Stations :
    /\ s # t /\ Acts(t, "receiver") /\ st[s].phase = "ACTUATING"
    /\ st[s].session = st[t].session
    => /\ st[s].role = "prescriber" /\ st[s].target = t
       /\ st[s].proposal = st[t].proposal

(***************************************************************************)
(* S-5: while the prescriber acts, its target is committed to that session *)
(* and proposal, unless the target itself broke off.  It does not say that *)
(* the prescriber ever learns of it (T-2), nor that CAMs tell the truth.   *)
(***************************************************************************)
NoHazardInv ==
  \A s \in Stations :
    LET t == st[s].target IN
    Acts(s, "prescriber") /\ <<st[s].session, t>> \notin excused =>
      /\ Acts(t, "receiver")
      /\ st[t].session = st[s].session
      /\ st[t].proposal = st[s].proposal

(***************************************************************************)
(* S-8: while a prescriber acts on the word of a receiver, nobody else     *)
(* does, and the receiver is not the prescriber of a maneuver itself,      *)
(* whatever the radio and the receiver do.                                 *)
(***************************************************************************)
ExclusiveInv ==
  \A s, t \in Stations :
    s # t /\ Acts(s, "prescriber") /\ Acts(t, "prescriber") =>
      st[s].target \notin {t, st[t].target}

(***************************************************************************)
(* S-6: an outbox entry that ends by an Ack had been received.             *)
(***************************************************************************)
AckedProp ==
  [][ LET s == last'.station IN
      /\ ~Reduced
      /\ last'.input.kind = "receive"
      /\ last'.input.message.type = "Ack"
      => \A e \in st[s].outbox \ st'[s].outbox : Copy(s, e) \in received ]_vars

(***************************************************************************)
(* S-7: a message of another session has no effect on the own one.         *)
(***************************************************************************)
Own(x) == [ x EXCEPT !.outbox = {e \in @ : e.session = x.session} ]

NoCrossEffectProp ==
  [][ LET s == last'.station IN
      /\ last'.input.kind = "receive"
      /\ Bound(st[s])
      /\ last'.input.message.session # st[s].session
      => Own(st'[s]) = Own(st[s]) ]_vars

(***************************************************************************)
(* What is claimed.  TLC checks it for the models in spec/models.          *)
(***************************************************************************)
THEOREM Spec => [](TypeInv /\ AcceptedInv /\ AgreementInv /\ NoHazardInv)
THEOREM Spec => OneSessionProp /\ CommitmentProp /\ NoCrossEffectProp
THEOREM ~Reduced => (Spec => AckedProp)
=============================================================================
