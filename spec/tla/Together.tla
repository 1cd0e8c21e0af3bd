------------------------------- MODULE Together -------------------------------
(***************************************************************************)
(* With a perfect radio, those who belong together leave together.  A      *)
(* station that leaves a session tells everybody whom that concerns, by a  *)
(* Fin, a Cancel, or Cancel(closed) as an answer to an Intention that came *)
(* too late: so nobody stays in a session whose other side has left it for *)
(* longer than a copy takes there and back.                                *)
(***************************************************************************)
EXTENDS Environments

VARIABLE apart  \* apart[s]: ticks for which s has been left alone

TogetherView == <<tview, apart>>

\* Nothing is lost; everybody may abort.
Perfect ==
  { [ Fault("none", TRUE, TRUE, {}, FALSE, FALSE, TRUE, FALSE)
        EXCEPT !.aborters = Stations,
               !.commands = {"request", "prescribe", "proceed", "accept",
                             "refuse", "complete", "abort"} ] }

\* In a session that its other side is not in, or no longer.
Alone(s) ==
  /\ Bound(st[s])
  /\ Peer(st[s]) # Nobody
  /\ st[Peer(st[s])].session # st[s].session

TogetherInit == EInit /\ apart = [s \in Stations |-> 0]

TogetherNext ==
  /\ TNext
  /\ apart' = [s \in Stations |->
                 IF ~Alone(s)' THEN 0
                 ELSE IF last'.input.kind = "tick" THEN apart[s] + 1
                 ELSE apart[s]]

(***************************************************************************)
(* T-7: within twice the delay.                                            *)
(***************************************************************************)
TogetherInv == \A s \in Stations : apart[s] <= 2 * Delay

TogetherSpec == TogetherInit /\ [][TogetherNext]_<<tvars, apart>>

THEOREM TogetherSpec => []TogetherInv

\* A prescriber releases nobody whom it has not chosen.
KeepsTheOthers(me, x, to, why) ==
  IF why = "not_selected" THEN {}
  ELSE {Cancel(me, p, x.session, why) : p \in to}
==============================================================================
