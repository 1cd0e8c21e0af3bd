----------------------------- MODULE Environments -----------------------------
(***************************************************************************)
(* What may go wrong in TimedSystem, fault class by fault class, and the   *)
(* bound T-2 on the hazard in each: docs/verification.md has the theorem.  *)
(***************************************************************************)
EXTENDS TimedSystem, Sequences

Fault(name, forward, backward, broken, cancels_lost, one_passes, aborts, restarts) ==
  [ name |-> name, perfect |-> [forward |-> forward, backward |-> backward],
    cut |-> broken, cancels_lost |-> cancels_lost, one_passes |-> one_passes,
    aborters |-> IF aborts THEN Receivers ELSE {},
    restarters |-> IF restarts THEN Receivers ELSE {},
    duplicates |-> FALSE,
    commands |-> {"request", "prescribe", "accept", "abort"},
    cancel |-> TRUE, marks |-> TRUE ]

BOTH == {"forward", "backward"}

Faults ==
  { Fault("both cut",                   TRUE,  TRUE,  BOTH, FALSE, FALSE, FALSE, FALSE),
    Fault("forward cut",                TRUE,  TRUE,  {"forward"}, FALSE, FALSE, FALSE, FALSE),
    Fault("forward cut, backward lossy", TRUE, FALSE, {"forward"}, FALSE, FALSE, FALSE, FALSE),
    Fault("forward cut, one copy passes", TRUE, FALSE, {"forward"}, FALSE, TRUE, FALSE, FALSE),
    Fault("backward cut",               TRUE,  TRUE,  {"backward"}, FALSE, FALSE, FALSE, FALSE),
    Fault("backward cut, forward lossy", FALSE, TRUE, {"backward"}, FALSE, FALSE, FALSE, FALSE),
    Fault("abort",                      TRUE,  TRUE,  {}, FALSE, FALSE, TRUE,  FALSE),
    Fault("abort, Cancels lost",        TRUE,  TRUE,  {}, TRUE,  FALSE, TRUE,  FALSE),
    Fault("abort, one copy passes",     TRUE,  FALSE, {}, FALSE, TRUE,  TRUE,  FALSE),
    Fault("abort, lossy",               FALSE, FALSE, {}, FALSE, FALSE, TRUE,  FALSE),
    Fault("restart",                    TRUE,  TRUE,  {}, FALSE, FALSE, FALSE, TRUE),
    Fault("restart, lossy",             FALSE, FALSE, {}, FALSE, FALSE, FALSE, TRUE) }

\* The target may leave at once, not only after CAM loss.
AtOnce(e) == e.aborters # {} \/ e.restarters # {}

Variant(f, cancel, marks) == [f EXCEPT !.cancel = cancel, !.marks = marks]

Label(e) == e.name \o (IF e.cancel THEN "" ELSE ", silent")
                   \o (IF e.marks THEN "" ELSE ", plain CAMs")

AllFaults == {Variant(f, c, m) : f \in Faults, c \in BOOLEAN, m \in BOOLEAN}
\* Where the target aborts or restarts, the Cancel on CAM loss is beside the
\* point; these are left out.
FaultClasses == {e \in AllFaults : e.cancel \/ ~AtOnce(e)}
PlainFaults  == {Variant(f, TRUE, FALSE) : f \in Faults}
SilentFaults == {Variant(f, FALSE, TRUE) : f \in Faults}

\* Everything at once.
Worst == { [ Fault("anything", FALSE, FALSE, {}, FALSE, FALSE, TRUE, FALSE)
               EXCEPT !.duplicates = TRUE,
                      !.aborters = Stations, !.restarters = Restarters,
                      !.commands = {"request", "close", "prescribe", "proceed",
                                    "accept", "refuse", "complete", "abort"} ] }

\* Every CAM is heard, and only Cancels are lost: T-8 has its say.
AllHeard == { [ Fault("all heard", TRUE, TRUE, {}, TRUE, FALSE, TRUE, TRUE)
                  EXCEPT !.aborters = Stations, !.restarters = Stations,
                         !.commands = @ \cup {"complete"}] }

(***************************************************************************)
(* T-2: the hazard lasts at most BoundOf(e) ticks, and in each fault       *)
(* class it can last as long.                                              *)
(*   left   what is left of the lease when the target leaves: it leaves at *)
(*          once, or after CamLoss                                         *)
(*   told   when the target's Cancel has arrived                           *)
(*   missed when no CAM with the mark has been heard for CamLoss           *)
(***************************************************************************)
Told(e)  == e.aborters # {} \/ (e.restarters = {} /\ e.cancel)

BoundOf(e) ==
  LET left   == IF AtOnce(e) THEN Lease ELSE Lease - CamLoss
      told   == IF ~Told(e) THEN left
                ELSE IF e.one_passes THEN GiveUpTime - ResendTime + Delay
                ELSE IF /\ e.perfect["backward"] /\ "backward" \notin e.cut
                        /\ ~e.cancels_lost
                     THEN Delay ELSE left
      \* Plain CAMs go on till the direction is cut; and that is before the
      \* Cancel has arrived, if there is one.
      missed == IF e.marks \/ ("backward" \in e.cut /\ Told(e))
                THEN Delay + CamLoss ELSE left
  IN CASE e.cut = BOTH -> Min(left, CamInterval + Delay)
       [] e.cut = {"backward"} /\ e.perfect["forward"] -> 0
       [] OTHER -> Min(left, Min(told, missed))

\* What is claimed; an ablation claims what only the whole protocol keeps,
\* or one tick less.
Claimed(e)      == BoundOf(e)
ClaimedWhole(e) == BoundOf(Variant(e, TRUE, TRUE))
OneLess(e)      == BoundOf(e) - 1

HazardInv == hazard <= Claimed(env)

THEOREM TSpec => []HazardInv

\* Printed once when a fault class has reached its bound (a register of TLC;
\* one worker only).
REACHED == 7
EInit   == TLCSet(REACHED, {}) /\ TInit
ESpec   == EInit /\ [][TNext]_tvars
TightInv ==
  hazard > 0 /\ hazard = Claimed(env) /\ Label(env) \notin TLCGet(REACHED) =>
    /\ PrintT(ToString(<<"REACHED", Label(env)>>))
    /\ TLCSet(REACHED, TLCGet(REACHED) \cup {Label(env)})

\* The hazard cannot come back once the prescriber has left for good.
PrescriberGoes ==
  \E s \in Prescribers : Bound(st[s]) \/ st[s].number < MaxSessions

\* How long the window is does not matter to T-2, so nobody need close it.
ShortWindow == 1
WorstUnclosed == {[e EXCEPT !.commands = @ \ {"close"}] : e \in Worst}

\* For models of one fault class.
LossyAborts  == {e \in Faults : e.name = "abort, lossy"}
Restarts     == {e \in Faults : e.name = "restart"}
PlainAborts  == {e \in PlainFaults : e.name = "abort, Cancels lost"}
MarkedAborts == {e \in Faults : e.name = "abort, Cancels lost"}
SilentCut    == {e \in SilentFaults : e.name = "forward cut"}

\* ACT-4 taken away: the prescriber counts its lease from the Acceptance.
LeaseFromAcceptance(s, r) ==
  IF r.rule = "NEG-6" /\ r.st.phase = "ACTUATING" /\ st[s].phase # "ACTUATING"
  THEN {Timer("lease")} ELSE {}

\* ACT-6 is about receivers that break off and are not heard.
LeavesUnheard ==
  {e \in Faults : e.name \in {"abort, Cancels lost", "abort, lossy",
                              "forward cut, backward lossy", "restart, lossy"}}

\* A quarantine that is over while a prescriber may still act.
TooShort == ActsOnTime - 1

\* CAMs without a mark are sent too, and must count for nobody (ACT-5).
AlwaysSends(s) == TRUE

\* A timer taken away is never due.
NeverHold(s, t)   == IF t[1] = "hold" THEN 1000 ELSE DurationOf(s, t)
NeverGiveUp(s, t) == IF t[1] = "giveup" THEN 1000 ELSE DurationOf(s, t)

\* What was sent last may still be in the outbox then.
ShortLife == GiveUpTime - 1

\* A session that was left is forgotten at once.
ForgetAtOnce(s, t) == IF t[1] = "forget" THEN 1 ELSE DurationOf(s, t)
==============================================================================
