------------------------------ MODULE Inductive ------------------------------
(***************************************************************************)
(* Why S-1 ... S-8 hold: an invariant that implies them, and that every    *)
(* step keeps, from every state in which it holds, reachable or not.       *)
(*                                                                         *)
(* `automcm spec prove` proves both from this text, for any number of      *)
(* stations, sessions, rounds and messages (docs/verification.md).  TLC    *)
(* checks that the states reached in small models have it.                 *)
(*                                                                         *)
(* It is about the system without its reductions (Reduced = FALSE), with   *)
(* the orders of T-4 and T-5 alone (InOrder of Cutoff).                    *)
(***************************************************************************)
EXTENDS Cutoff

NextInOrder ==
  \E s \in Stations :
    \/ RestartInOrder(s) \/ ExpireInOrder(s)
    \/ ReceiveInOrder(s) \/ CommandInOrder(s)

SpecInOrder == CInit /\ [][NextInOrder]_cvars

Opened(x) == x[1] \in Stations /\ 1 <= x[2] /\ x[2] <= st[x[1]].number

(***************************************************************************)
(* ADV-1: numbers only grow, so a session that anything names was opened.  *)
(***************************************************************************)
OpenedInv ==
  /\ \A s \in Stations : /\ st[s].number \in Nat
                         /\ \A x \in st[s].joined : Opened(x) /\ x[1] # s
  /\ \A m \in net : Opened(m.session)

(***************************************************************************)
(* Each role has its phases (docs/protocol.md, section 4).                 *)
(***************************************************************************)
RoleInv ==
  \A s \in Stations :
    /\ st[s].role = "receiver" =>
         st[s].phase \in {"INTENDING", "WAITING", "NEGOTIATING", "ACTUATING"}
    /\ st[s].role = "prescriber" => st[s].phase \notin {"INTENDING", "WAITING"}

(***************************************************************************)
(* ADV-8: of each prescriber, only the newest session is remembered.       *)
(***************************************************************************)
NewestInv ==
  \A s \in Stations : \A x, y \in st[s].joined : x[1] = y[1] => x = y

(***************************************************************************)
(* END-5: between whom each type of message goes, and its other fields.    *)
(***************************************************************************)
FormInv ==
  \A m \in net :
    LET x == m.session
        p == x[1]
        k == m.proposal
    IN /\ m.src \in Stations /\ m.dst # m.src
       /\ m.type # "Advertisement" => m.dst \in Stations
       /\ CASE m.type = "Advertisement" -> m = Advertisement(p, x)
            [] m.type = "Intention"     -> m = Intention(m.src, x)
            [] m.type = "Prescription"  -> /\ m = Prescription(p, m.dst, x, k)
                                           /\ 1 <= k /\ k <= MaxRounds
            [] m.type = "Acceptance"    ->
                 /\ m.dst = p
                 /\ m.accepted => m = Acceptance(m.src, x, k)
                 /\ ~m.accepted /\ m.seq # 0 =>
                      m = Plain(Refusal(m.src, x, k, "unsafe"))
            [] m.type = "Fin"           -> m = Fin(p, m.dst, x)
            [] m.type = "Cancel"        ->
                 /\ p \in {m.src, m.dst}
                 /\ m.seq # 0 => m = Plain(Cancel(m.src, m.dst, x, "abort"))
            [] m.type = "Ack"           -> TRUE

(***************************************************************************)
(* REL-1: what is in the outbox has been sent.                             *)
(***************************************************************************)
OutboxInv ==
  \A s \in Stations : \A e \in st[s].outbox : Plain(Copy(s, e)) \in net

(***************************************************************************)
(* REL-1: what is sent reliably; END-1: all but Fin and Cancel ends with   *)
(* the session; PRE-4: one Prescription at a time.                         *)
(***************************************************************************)
OwnEntriesInv ==
  \A s \in Stations : \A e \in st[s].outbox :
    /\ e.type \in {"Intention", "Prescription", "Acceptance", "Fin", "Cancel"}
    /\ e.type \notin {"Fin", "Cancel"} => e.session = st[s].session
    /\ e.type = "Intention" => e = Entry(Intention(s, st[s].session))
    /\ e.type = "Prescription" =>
         e = Entry(Prescription(s, st[s].target, st[s].session, st[s].proposal))

(***************************************************************************)
(* ADV-2: who advertises has sent its Advertisement, and it is not dead.   *)
(***************************************************************************)
AdvertisedInv ==
  \A p \in Stations : st[p].phase = "ADVERTISING" =>
    Advertisement(p, st[p].session) \in net

(***************************************************************************)
(* END-8, ACT-6: a station in quarantine is bound to nothing.              *)
(***************************************************************************)
QuarantineInv == \A s \in Stations : st[s].quarantine => ~Bound(st[s])

(***************************************************************************)
(* ADV-8, END-8: station r is out of session x, and there is no way back.  *)
(***************************************************************************)
Joinable(r, x) ==
  /\ Advertisement(x[1], x) \in net
  /\ NewerThanJoined(st[r], x)
  /\ ~Quarantined(st[r])

Out(r, x) == st[r].session # x /\ ~Joinable(r, x)

(***************************************************************************)
(* ADV-5, PRE-2: recorded, and prescribed to, is who has intended.         *)
(***************************************************************************)
RecordedInv ==
  \A p \in Stations : st[p].role = "prescriber" =>
    /\ \A q \in st[p].recorded : Intention(q, st[p].session) \in net
    /\ st[p].target # Nobody =>
         /\ 1 <= st[p].proposal
         /\ st[p].deciding => RoundLeft(st[p])
         /\ Prescription(p, st[p].target, st[p].session, st[p].proposal) \in net

(***************************************************************************)
(* NEG-7: one target in a session, and no proposal beyond the last one.    *)
(***************************************************************************)
PrescribedInv ==
  \A m \in net : m.type = "Prescription" =>
    LET p == m.src IN
    /\ Intention(m.dst, m.session) \in net
    /\ In(st[p], m.session) => /\ st[p].target = m.dst
                               /\ m.proposal <= st[p].proposal
    /\ \A n \in net : n.type = "Prescription" /\ n.session = m.session =>
                        n.dst = m.dst

(***************************************************************************)
(* END-1, PRE-2: a prescriber cancels who takes no part any more.          *)
(***************************************************************************)
CancelledInv ==
  \A m \in net :
    LET p == m.session[1] IN
    m.type \in {"Fin", "Cancel"} /\ m.src = p /\ In(st[p], m.session) =>
      /\ m.dst \notin st[p].recorded \cup {st[p].target}
      /\ st[p].phase = "ADVERTISING" => m.dst \in st[p].withdrawn

(***************************************************************************)
(* NEG-1, NEG-2: what a receiver is in follows from what it has sent and   *)
(* received.                                                               *)
(***************************************************************************)
ReceiverInv ==
  \A r \in Stations : st[r].role = "receiver" =>
    LET x == st[r].session
        k == st[r].proposal
    IN /\ Intention(r, x) \in net
       /\ st[r].phase \in {"NEGOTIATING", "ACTUATING"} => k # 0
       /\ k # 0 => Prescription(x[1], r, x, k) \in net
       /\ st[r].phase = "ACTUATING" => Acceptance(r, x, k) \in net

(***************************************************************************)
(* NEG-2: who has accepted a proposal is committed to it, or is out.       *)
(***************************************************************************)
Committed(r, x, k) ==
  /\ Acts(r, "receiver")
  /\ st[r].session = x /\ st[r].proposal = k

CommittedInv ==
  \A m \in net : m.type = "Acceptance" /\ m.accepted =>
    /\ Prescription(m.dst, m.src, m.session, m.proposal) \in net
    /\ Committed(m.src, m.session, m.proposal) \/ Out(m.src, m.session)

(***************************************************************************)
(* NEG-3: who has refused a proposal does not accept it.                   *)
(***************************************************************************)
RefusedInv ==
  \A m \in net : m.type = "Acceptance" /\ ~m.accepted /\ m.seq # 0 =>
    LET r == m.src
        x == m.session
        k == m.proposal
    IN /\ Acceptance(r, x, k) \notin net
       /\ \/ In(st[r], x) /\ k < st[r].proposal
          \/ In(st[r], x) /\ k = st[r].proposal /\ st[r].phase = "WAITING"
          \/ Out(r, x)

(***************************************************************************)
(* END-6: an Ack says that a message was received.                         *)
(***************************************************************************)
AckedInv ==
  /\ \A m \in received : m \in net /\ m.type # "Advertisement"
  /\ \A m \in net : m.type = "Ack" /\ m.of[2] # 0 =>
       \E n \in received : /\ n.src = m.dst /\ n.dst = m.src
                          /\ n.session = m.session /\ <<n.type, n.seq>> = m.of

(***************************************************************************)
(* NEG-6: who has received an Acceptance does not wait for it.             *)
(***************************************************************************)
HeededInv == \A m \in received : ~Awaited(m.src, m)

(***************************************************************************)
(* T-5: what a station remembers, is in, or has answered to, it has been   *)
(* in.  So when its quarantine ends, no Advertisement of it is left.       *)
(***************************************************************************)
BeenInv ==
  \A s \in Stations :
    /\ \A x \in st[s].joined : <<x, s>> \in been
    /\ st[s].role = "receiver" => <<st[s].session, s>> \in been
    /\ \A m \in net : m.type = "Acceptance" /\ m.src = s /\ m.seq # 0 =>
                       <<m.session, s>> \in been

(***************************************************************************)
(* NEG-6: S-3, with the Acceptance itself.                                 *)
(***************************************************************************)
ActsOnInv ==
  \A p \in Stations : Acts(p, "prescriber") =>
    Acceptance(st[p].target, st[p].session, st[p].proposal) \in net

(***************************************************************************)
(* ACT-4, ACT-6: whom a prescriber relies on is committed, or has broken   *)
(* off and is in quarantine.                                               *)
(***************************************************************************)
Relies(p) ==
  /\ st[p].role = "prescriber"
  /\ st[p].phase = "ACTUATING" \/ AwaitsAnswer(st[p])
  /\ Acceptance(st[p].target, st[p].session, st[p].proposal) \in net

ReliedInv ==
  \A p \in Stations : Relies(p) =>
    LET t == st[p].target IN
    \/ Committed(t, st[p].session, st[p].proposal)
    \/ st[t].quarantine /\ <<st[p].session, t>> \in excused

(***************************************************************************)
(* S-8, from the moment at which the Acceptance is sent.                   *)
(***************************************************************************)
OneReliesInv ==
  \A p, q \in Stations : Relies(p) /\ Relies(q) /\ p # q =>
    st[p].target # st[q].target

(***************************************************************************)
(* All of it.                                                              *)
(***************************************************************************)
Inv ==
  /\ TypeInv
  /\ OpenedInv
  /\ RoleInv
  /\ NewestInv
  /\ FormInv
  /\ OutboxInv
  /\ OwnEntriesInv
  /\ AdvertisedInv
  /\ QuarantineInv
  /\ RecordedInv
  /\ PrescribedInv
  /\ CancelledInv
  /\ ReceiverInv
  /\ CommittedInv
  /\ RefusedInv
  /\ AckedInv
  /\ HeededInv
  /\ BeenInv
  /\ ActsOnInv
  /\ ReliedInv
  /\ OneReliesInv

THEOREM ~Reduced => (CInit => Inv)
THEOREM ~Reduced => (Inv /\ [NextInOrder]_cvars => Inv')
THEOREM Inv => AcceptedInv /\ AgreementInv /\ NoHazardInv /\ ExclusiveInv

\* For a must-fail model: a station joins again what it has left (ADV-8).
AlwaysNewer(x, s) == TRUE
==============================================================================
