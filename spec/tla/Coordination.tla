---------------------------- MODULE Coordination ----------------------------
(***************************************************************************)
(* What the service promises two drivers, with no message in it.           *)
(*                                                                         *)
(* A driver drives alone, or talks about one maneuver (a session), or acts *)
(* on it.  Whoever acts has first talked.  The one that is asked (the      *)
(* receiver) agrees only to what the other asks of it, and acts from that  *)
(* moment; the one that asks (the prescriber) acts only on what the other  *)
(* has agreed to.  In one session there is one agreement at most, so there *)
(* are never two instructions.  Whatever happens, each one drives alone    *)
(* again in the end.                                                       *)
(*                                                                         *)
(* It does not promise that the other is still acting: S-5 and T-2 say how *)
(* far that can fail.  Nor that a request comes to anything: that is L-2.  *)
(***************************************************************************)
CONSTANTS Drivers, Nothing

VARIABLES
  doing,    \* doing[d]: [act, role, session, agreement]
  asked,    \* what is asked: <<session, receiver, proposal>>
  agreed    \* agreements ever made, likewise

Acts  == {"alone", "talking", "acting"}
Alone == [act |-> "alone", role |-> "none", session |-> Nothing,
          agreement |-> Nothing]

Init == doing = [d \in Drivers |-> Alone] /\ asked = {} /\ agreed = {}

\* Nothing new is asked.  (What has become pointless may be forgotten.)
NothingAsked == asked' \subseteq asked

\* Begin to talk: the prescriber opens a new session of its own, a receiver
\* enters that of another.
Talk(d) ==
  /\ doing[d] = Alone
  /\ doing'[d].act = "talking" /\ doing'[d].agreement = Nothing
  /\ (doing'[d].role = "prescriber") = (doing'[d].session[1] = d)
  /\ doing'[d].role = "prescriber" =>
       ~ \E a \in asked \cup agreed : a[1] = doing'[d].session
  /\ NothingAsked /\ agreed' = agreed

\* The prescriber asks a receiver for something.
Ask(d) ==
  /\ doing[d].act = "talking" /\ doing[d].role = "prescriber"
  /\ \A a \in asked' \ asked : a[1] = doing[d].session
  /\ doing'[d] = doing[d] /\ agreed' = agreed

\* The receiver agrees, and acts.
Agree(d) ==
  /\ doing[d].act = "talking" /\ doing[d].role = "receiver"
  /\ ~ \E a \in agreed : a[1] = doing[d].session
  /\ \E a \in asked :
       /\ a[1] = doing[d].session /\ a[2] = d
       /\ agreed' = agreed \cup {a}
       /\ doing'[d] = [doing[d] EXCEPT !.act = "acting", !.agreement = a]
  /\ NothingAsked

\* The prescriber acts on what was agreed.
Execute(d) ==
  /\ doing[d].act = "talking" /\ doing[d].role = "prescriber"
  /\ \E a \in agreed :
       /\ a[1] = doing[d].session
       /\ doing'[d] = [doing[d] EXCEPT !.act = "acting", !.agreement = a]
  /\ NothingAsked /\ agreed' = agreed

\* Finish or abandon.
End(d) ==
  /\ doing[d] # Alone /\ doing'[d] = Alone
  /\ NothingAsked /\ agreed' = agreed

Next ==
  \E d \in Drivers :
    /\ \A e \in Drivers \ {d} : doing'[e] = doing[e]
    /\ Talk(d) \/ Ask(d) \/ Agree(d) \/ Execute(d) \/ End(d)

vars == <<doing, asked, agreed>>
Safe == Init /\ [][Next]_vars
Ends == \A d \in Drivers : doing[d].act # "alone" ~> doing[d].act = "alone"
Spec == Safe /\ Ends
=============================================================================
