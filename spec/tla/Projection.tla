------------------------------ MODULE Projection ------------------------------
(***************************************************************************)
(* The sessions X of any number of stations, some of them liars, are a     *)
(* behaviour of Cutoff: each step is one of its steps, or changes nothing  *)
(* there.  X is one session, or two of different prescribers (S-8).        *)
(*                                                                         *)
(* The projection keeps the prescribers of X and the receivers in Q, what  *)
(* these stations have to do with X (Part of Independence), and the        *)
(* messages between them.  Everybody else is left out.  A prescriber that  *)
(* has turned to a receiver outside Q, or has recorded only such, is gone  *)
(* for those in Q: it has released them, and answers them as if it had     *)
(* left.  (So S-3 to S-5 are looked up where Q has its target.)            *)
(***************************************************************************)
EXTENDS Attacker, Cutoff

(***************************************************************************)
(* Of the reductions of System, the outboxes and the Acks are left out     *)
(* (Reduced), but an answer is a step, and no message is taken away: what  *)
(* System does at once for one session may take others along.              *)
(***************************************************************************)
AnswersLater(s, x, new, all) == {}
AllLiving(x, ms)             == ms

(***************************************************************************)
(* Several stations: System in the order of T-5 alone, with the liars of   *)
(* Attacker.                                                               *)
(***************************************************************************)
ForgeInOrder(s) == \E i \in Forgeries(s) : Did(s, i)

ManyNext ==
  \E s \in Honest :
    \/ RestartInOrder(s) \/ ExpireInOrder(s)
    \/ ReceiveInOrder(s) \/ CommandInOrder(s) \/ ForgeInOrder(s)

ManySpec == CInit /\ [][ManyNext]_cvars

(***************************************************************************)
(* The projection                                                          *)
(***************************************************************************)
Owners(X)       == {x[1] : x \in X}
Everybody(X, Q) == Owners(X) \cup Q

\* Each prescriber has one session; its number is 1 there.
As(x) == <<x[1], 1>>

Among(X, Q, s, t, x) == /\ x \in X
                        /\ {s, t} \subseteq Q \cup {x[1], Broadcast}

\* Others alone have answered, or it has turned to another.
OthersOnly(a, Q) == a.phase = "CHOOSING" /\ a.recorded \cap Q = {}
Turned(a, Q)     == a.target \notin Q \cup {Nobody}

Concerns(s, a, X, Q) ==
  /\ a.session \in X
  /\ IF a.role = "prescriber" THEN ~OthersOnly(a, Q) /\ ~Turned(a, Q) ELSE s \in Q

Began(a, s, X)  == {x \in X : x[1] = s /\ x[2] <= a.number}
Joined(a, s, X) ==
  {x \in X : x[1] # s /\ \E j \in a.joined : j[1] = x[1] /\ j[2] >= x[2]}

\* The last own session has ended without participants (END-7), as those of Q
\* see it.
BacksOff(a, s, X, Q) ==
  /\ ~Reduced
  /\ \/ a.session \in X /\ OthersOnly(a, Q)
     \/ a.backoff /\ <<s, a.number>> \in X

Projected(s, a, X, Q) ==
  [ IF Concerns(s, a, X, Q) THEN a ELSE Initial EXCEPT
      !.session    = IF Concerns(s, a, X, Q) THEN As(a.session) ELSE NoSession,
      !.recorded   = @ \cap Q,
      !.withdrawn  = @ \cap Q,
      !.number     = Cardinality(Began(a, s, X)),
      !.joined     = IF s \in Q THEN {As(x) : x \in Joined(a, s, X)} ELSE {},
      !.outbox     = {[e EXCEPT !.session = As(@)] :
                        e \in {f \in a.outbox : Among(X, Q, s, f.to, f.session)}},
      !.quarantine = a.quarantine,
      !.backoff    = BacksOff(a, s, X, Q) ]

Renamed(ms, X, Q) ==
  {[m EXCEPT !.session = As(@)] :
     m \in {k \in ms : Among(X, Q, k.src, k.dst, k.session)}}

RenamedPairs(pairs, X, Q) ==
  {<<As(e[1]), e[2]>> : e \in {f \in pairs : Among(X, Q, f[2], f[2], f[1])}}

ProjectedStations(X, Q) ==
  [s \in Everybody(X, Q) |-> Projected(s, st[s], X, Q)]

Onto(X, Q) == INSTANCE Cutoff WITH
  Stations <- Everybody(X, Q),
  Prescribers <- Owners(X),
  Receivers <- Q,
  Restarters <- Restarters \cap Everybody(X, Q),
  MaxSessions <- 1,
  MaxParticipants <- 3,
  MemoryLimit <- 4,
  st <- ProjectedStations(X, Q),
  net <- Renamed(net, X, Q),
  excused <- RenamedPairs(excused, X, Q),
  received <- Renamed(received, X, Q),
  been <- RenamedPairs(been, X, Q)

(***************************************************************************)
(* What is claimed                                                         *)
(***************************************************************************)
\* Each session with one or two of its receivers; two sessions with one.
Some(low, high) ==
  {Q \in SUBSET (Honest \cap Receivers) : Cardinality(Q) \in low .. high}
Opened == (Prescribers \cap Honest) \X (1 .. MaxSessions)

OneSession  == {{x} : x \in Opened} \X Some(1, 2)
TwoSessions ==
  {X \in SUBSET Opened : Cardinality(X) = 2 /\ Cardinality(Owners(X)) = 2} \X Some(1, 1)

Views == OneSession \cup TwoSessions

\* P-1
ProjectionProp ==
  /\ \A v \in Views : Onto(v[1], v[2])!CInit
  /\ [][ \A v \in Views : Onto(v[1], v[2])!CutoffStep({last'.station}) ]_cvars

THEOREM ManySpec => ProjectionProp

(***************************************************************************)
(* Must-fail models                                                        *)
(***************************************************************************)
\* Cutoff without what happens elsewhere.
NotElsewhere(s) == FALSE
NoneElsewhere   == FALSE

\* A message counts for every session of its prescriber (END-4).
AnyOfPrescriber(s, t) == s[1] = t[1]

\* A prescriber that has turned to another receiver is still there.
NeverTurned(a, Q) == FALSE
==============================================================================
