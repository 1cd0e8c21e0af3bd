-------------------------------- MODULE Cutoff --------------------------------
(***************************************************************************)
(* What any number of stations come down to: the stations of one session,  *)
(* or of two for S-8, in any company (docs/verification.md, "Any number of *)
(* stations").  Projection.tla checks it.                                  *)
(*                                                                         *)
(* It is System with two differences.                                      *)
(*  - The orders of quarantine and forget(p) are those of T-5 and no more: *)
(*    they concern the sessions that the station has been in (for p: those *)
(*    up to the newest), not every Advertisement; and a prescriber may     *)
(*    still wait for an answer when the quarantine of its target ends, if  *)
(*    no copy of the Acceptance is left.  What the outbox holds does not   *)
(*    matter.                                                              *)
(*  - A station may be elsewhere: what it does in other sessions puts it   *)
(*    in quarantine, bars a session to it, or keeps it busy.  The rest of  *)
(*    the interface of Independence needs no step: an Advertisement that   *)
(*    is ignored is lost, and a request that is refused is not made.       *)
(***************************************************************************)
EXTENDS System

VARIABLE been  \* history: <<session, s>>: sessions that s has ever joined

cvars == <<vars, been>>
cview == <<view, been>>

CInit == Init /\ been = {}

(***************************************************************************)
(* T-5 alone                                                               *)
(***************************************************************************)
\* Session x is over, and no copy of its Advertisement is left, when timer t
\* of s expires.
Over(s, t, x) ==
  CASE t[1] = "forget"     -> \E j \in st[s].joined : /\ j[1] = t[2] /\ j[1] = x[1]
                                                      /\ j[2] >= x[2]
    [] t[1] = "quarantine" -> <<x, s>> \in been
    [] OTHER               -> FALSE

\* m is the Acceptance of s that its addressee still waits for (ACT-6).
Awaited(s, m) ==
  /\ m.type = "Acceptance" /\ m.accepted /\ m.src = s
  /\ LET p == st[m.dst] IN
     /\ p.role = "prescriber" /\ AwaitsAnswer(p) /\ p.target = s
     /\ p.session = m.session /\ p.proposal = m.proposal

ActsOnWordOf(s) == \E p \in Stations : Acts(p, "prescriber") /\ st[p].target = s

InOrder(s, t) ==
  /\ t[1] = "lease" => LeaseOutlived(s)
  /\ t[1] \in {"forget", "quarantine"} =>
       Forgetting /\ \A p \in Stations :
                       st[p].phase = "ADVERTISING" => ~Over(s, t, st[p].session)
  /\ t[1] = "quarantine" => ~ActsOnWordOf(s)

\* No copy of these is left then.
DiesInOrder(s, i) ==
  IF i.kind # "expire" THEN {}
  ELSE {m \in net : \/ m.type = "Advertisement" /\ Over(s, i.timer, m.session)
                    \/ i.timer[1] = "quarantine" /\ Awaited(s, m)}

(***************************************************************************)
(* Steps.  Those of the projection say nothing of last.                    *)
(***************************************************************************)
Restarts(s)        == If(s \in Restarters, {[kind |-> "restart"]})
ExpiriesInOrder(s) ==
  {[kind |-> "expire", timer |-> t] : t \in {x \in Armed(s, st[s]) : InOrder(s, x)}}

Takes(s, i) ==
  /\ Moves(s, i, DiesInOrder(s, i))
  /\ been' = been \cup If(st'[s].role = "receiver", {<<st'[s].session, s>>})

Becomes(s, x) ==
  /\ ~Bound(st[s]) /\ x # st[s]
  /\ st' = [st EXCEPT ![s] = x]
  /\ net' = Living(st', net)
  /\ UNCHANGED <<excused, received, been>>

\* ACT-6: it breaks off a commitment in another session.
BreaksOff(s) == Becomes(s, [st[s] EXCEPT !.quarantine = TRUE])

\* ADV-8: it joins a session of p that is newer than the last of p here.
JoinsNewer(s) ==
  /\ s \in Receivers
  /\ \E p \in Prescribers \ {s} :
       /\ st[p].number = MaxSessions /\ st[p].role # "prescriber"
       /\ Becomes(s, [st[s] EXCEPT !.joined = {j \in @ : j[1] # p}
                                              \cup {<<p, MaxSessions>>}])

\* NEG-4: bound to another session, it says so.
SaysBusy(s) ==
  \E m \in {k \in MessagesTo(net, s) : k.type = "Prescription"} :
    /\ ~Bound(st[s])
    /\ net' = Living(st, Sent(net, {RefusalAnswer(s, m, "busy")}))
    /\ net' # net
    /\ UNCHANGED <<st, excused, received, been>>

\* No copy is left of Advertisements that are no longer sent: a receiver that
\* is left out here forgets them, or ends its quarantine (T-5).
DiesOut ==
  \E P \in SUBSET {p \in Prescribers : st[p].phase # "ADVERTISING"} :
    /\ net' = net \ {m \in net : m.type = "Advertisement" /\ m.src \in P}
    /\ net' # net
    /\ UNCHANGED <<st, excused, received, been>>

\* A step of the projection, of one of stations S.
CutoffStep(S) ==
  \/ UNCHANGED cview
  \/ \E s \in S \cap Stations :
       \/ \E i \in Restarts(s)        : Takes(s, i)
       \/ \E i \in ExpiriesInOrder(s) : Takes(s, i)
       \/ \E i \in Receptions(s)      : Takes(s, i)
       \/ \E i \in Commands(s)        : Takes(s, i)
       \/ BreaksOff(s)
       \/ JoinsNewer(s)
       \/ SaysBusy(s)
  \/ DiesOut

\* The same as a model.
Did(s, i) == Takes(s, i) /\ Happened(s, i)

RestartInOrder(s) == \E i \in Restarts(s)        : Did(s, i)
ExpireInOrder(s)  == \E i \in ExpiriesInOrder(s) : Did(s, i)
ReceiveInOrder(s) == \E i \in Receptions(s)      : Did(s, i)
CommandInOrder(s) == \E i \in Commands(s)        : Did(s, i)


Outside(name, s) ==
  last' = [station |-> s, input |-> [kind |-> name], rule |-> "none"]

QuarantineElsewhere(s) == BreaksOff(s) /\ Outside("quarantine elsewhere", s)
JoinNewerElsewhere(s)  == JoinsNewer(s) /\ Outside("newer session joined", s)
SayBusyElsewhere(s)    == SaysBusy(s) /\ Outside("busy elsewhere", s)
DieOut                 == DiesOut /\ Outside("copies die out", Nobody)

CutoffNext ==
  \/ \E s \in Stations :
       \/ RestartInOrder(s) \/ ExpireInOrder(s)
       \/ ReceiveInOrder(s) \/ CommandInOrder(s)
       \/ QuarantineElsewhere(s) \/ JoinNewerElsewhere(s)
       \/ SayBusyElsewhere(s)
  \/ DieOut

CutoffSpec == CInit /\ [][CutoffNext]_cvars

THEOREM CutoffSpec => [](TypeInv /\ AcceptedInv /\ AgreementInv)
THEOREM CutoffSpec => [](NoHazardInv /\ ExclusiveInv)
THEOREM CutoffSpec => OneSessionProp /\ CommitmentProp /\ NoCrossEffectProp

(***************************************************************************)
(* Must-fail models                                                        *)
(***************************************************************************)
\* Without T-5: quarantine and forget end whenever they like, and nothing dies
\* out.
LeaseOrderAlone(s, t) == t[1] = "lease" => LeaseOutlived(s)
NeverOver(s, t, x)    == FALSE
==============================================================================
