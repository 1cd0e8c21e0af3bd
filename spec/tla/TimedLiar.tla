------------------------------- MODULE TimedLiar -------------------------------
(***************************************************************************)
(* TimedSystem with the station of Liar, which here sends CAMs too: they   *)
(* name whatever session their addressee is in.  Such a CAM must not count *)
(* as heard (ACT-5), or the prescriber would act on for as long as the     *)
(* other station is pleased to send them.                                  *)
(***************************************************************************)
EXTENDS Environments, Liar

CamLie(s) ==
  [kind |-> "cam", src |-> Liar, newer |-> TRUE, marks |-> {st[s].session}]

\* A lie that does nothing is no step.
Works(s, i) ==
  LET r == Effected(s, i) IN r.st # st[s] \/ r.again # {}

TellLie(s) ==
  /\ Due(s) = {}
  /\ \E i \in Lie(s) \cup {CamLie(s)} : Works(s, i) /\ TDo(s, i, {})

TimedLiarNext == TNext \/ \E s \in Honest : TellLie(s)

TimedLiarSpec == EInit /\ [][TimedLiarNext]_tvars

THEOREM TimedLiarSpec => []HazardInv

\* Only CAMs.
NoLie(s) == {}
==============================================================================
