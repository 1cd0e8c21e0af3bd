------------------------------ MODULE Refinement ------------------------------
(***************************************************************************)
(* System is a Coordination.  A phase becomes what it means to a driver;   *)
(* of a session only who and what was agreed is left.                      *)
(***************************************************************************)
EXTENDS System

Agreement(s, x) == <<x.session, IF x.role = "receiver" THEN s ELSE x.target,
                     x.proposal>>

Doing(s, x) ==
  [ act       |-> IF x.phase = "STANDALONE" THEN "alone"
                  ELSE IF x.phase = "ACTUATING" THEN "acting" ELSE "talking",
    role      |-> x.role,
    session   |-> x.session,
    agreement |-> IF x.phase = "ACTUATING" THEN Agreement(s, x) ELSE NoSession ]

Driving == [s \in Stations |-> Doing(s, st[s])]

\* What receivers have agreed to, among messages ms.
Agreements(ms) ==
  {<<m.session, m.src, m.proposal>> :
     m \in {k \in ms : k.type = "Acceptance" /\ k.accepted}}

\* What prescribers ask, among messages ms.
Instructions(ms) ==
  {<<m.session, m.dst, m.proposal>> :
     m \in {k \in ms : k.type = "Prescription"}}

\* The radio of System keeps every Acceptance, and a Prescription as long as
\* it can do anything.
Promise == INSTANCE Coordination WITH
  Drivers <- Stations, Nothing <- NoSession, doing <- Driving,
  asked <- Instructions(net), agreed <- Agreements(net)

\* R-1: System refines Coordination, safety (liveness: R-2 in Liveness.tla).
PromiseProp == Promise!Safe

THEOREM Spec => PromiseProp
==============================================================================
