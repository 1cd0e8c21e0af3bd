-------------------------------- MODULE Forger --------------------------------
(***************************************************************************)
(* TimedSystem with a stranger who forges one CAM: in a station's session, *)
(* under the id of its peer, generated Ahead ticks from now.  Till then    *)
(* the peer's own CAMs are not newer (ACT-5).  T-8 holds all the same if   *)
(* CamLoss > CamInterval + Delay + Ahead; without a bound on Ahead, the    *)
(* forged CAM ends the session.                                            *)
(*                                                                         *)
(* The first CAM that counts is the peer's own here, and has arrived at    *)
(* once.                                                                   *)
(***************************************************************************)
EXTENDS Environments, Integers

CONSTANT Ahead   \* how far a CAM may be ahead

VARIABLE lead    \* lead[s]: ticks until the forged CAM's generation time, or Past

Past == -(Delay + 1)   \* no CAM on its way is older

fview == <<tview, lead>>

\* A CAM on its way was generated Delay - left ticks ago.
Newer(c) == lead[c.to] + Delay - c.left < 0

CamInput(c) ==
  [ kind |-> "cam", src |-> c.message.src, newer |-> Newer(c),
    marks |-> c.message.marks ]

InputWithLead(c) ==
  IF c.message.type = "CAM" THEN CamInput(c)
  ELSE [ kind |-> "receive", message |-> c.message,
         concerned |-> c.to \in Receivers ]

Forge(s) ==
  /\ Due(s) = {} /\ st[s].heard /\ \A t \in Stations : lead[t] = Past
  /\ TDo(s, [ kind |-> "cam", src |-> Peer(st[s]), newer |-> TRUE,
              marks |-> {st[s].session} ], {})
  /\ lead' = [lead EXCEPT ![s] = Ahead]

Nearer == [s \in Stations |-> Max(Past, lead[s] - 1)]

\* The actions of TNext.
SameLead        == UNCHANGED lead
ThenFireDue(s)  == FireDue(s)  /\ SameLead
ThenObey(s)     == Obey(s)     /\ SameLead
ThenTRestart(s) == TRestart(s) /\ SameLead
ThenHearCam     == HearCam     /\ SameLead
ThenDeliver     == Deliver     /\ SameLead
ThenDuplicate   == Duplicate   /\ SameLead
ThenCutOff      == CutOff      /\ SameLead
NearerTick      == Tick        /\ lead' = Nearer

ForgerNext ==
  \/ \E s \in Stations :
       ThenFireDue(s) \/ ThenObey(s) \/ ThenTRestart(s) \/ Forge(s)
  \/ ThenHearCam \/ ThenDeliver \/ ThenDuplicate
  \/ ThenCutOff
  \/ NearerTick

ForgerSpec == EInit /\ lead = [s \in Stations |-> Past]
              /\ [][ForgerNext]_<<tvars, lead>>

THEOREM CamLoss > CamInterval + Delay + Ahead => (ForgerSpec => []CamLossInv)

\* Nothing else goes wrong.
Faultless == { [ Fault("none", TRUE, TRUE, {}, FALSE, FALSE, FALSE, FALSE)
                   EXCEPT !.commands = @ \cup {"complete"} ] }

\* Without the bound.
Unbounded == CamLoss
==============================================================================
