-------------------------- MODULE LivenessAblations --------------------------
(***************************************************************************)
(* One mechanism taken away at a time, where only liveness shows what it   *)
(* is for.  (A timer is taken away by the constant Missing.)               *)
(***************************************************************************)
EXTENDS Liveness

\* A copy of what was taken already is not acked again.
NoAckCopy(me, m) == {}

\* A finished prescriber's CAM no longer names the session.
MarkWhileBound(x) == IF Bound(x) THEN {x.session} ELSE {}

\* Cancel(closed) although the Fin is still being sent.
AlwaysClosed(me, x, m, rule) == Effect(x, {Closed(me, m)}, Nothing, rule)

\* No last round.  That proposals go on for ever is shown by counting them
\* in a circle of MaxRounds, so that the model stays finite.
AnotherRound(x)     == TRUE
Circular(k)         == (k % MaxRounds) + 1
NotNext(k, l)       == k # Circular(l)
\* A receiver takes one proposal in a session: after a refusal every other
\* is a copy to it.
OneProposal(k, l) == l # 0

\* The window may close before anybody is recorded.
ClosesEmpty(x) == TRUE

\* The commands that are enough to show it.
OnlyRefusing        == {"request", "prescribe", "refuse"}
OnlyAgreeing        == {"request", "prescribe", "accept"}
OnlyAborting        == {"request", "abort"}
==============================================================================
