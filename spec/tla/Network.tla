------------------------------- MODULE Network -------------------------------
(***************************************************************************)
(* The radio, for safety: a set of messages that never shrinks.            *)
(* A message that is never taken from the set is lost; one that is taken   *)
(* twice is duplicated; any order is possible; a retransmission adds       *)
(* nothing.  So every behaviour of a radio that loses, duplicates, delays  *)
(* and reorders is a behaviour of this set.  What it does NOT show: that a *)
(* message ever arrives.  Liveness needs another network.                  *)
(***************************************************************************)
EXTENDS Station

\* The content of a reliable message does not matter to the protocol.
\* Without it an original and a copy of it are one element of the set.
Plain(m) ==
  IF m.reason \in {"none", "busy", "unknown_session", "closed"} THEN m
  ELSE [m EXCEPT !.reason = "as_sent"]

Sent(net, ms)       == net \cup ms
MessagesTo(net, s)  == {m \in net : m.dst \in {s, Broadcast} /\ m.src # s}
\* The copies of ms die out (they have reached the end of their life).
Died(net, ms)       == net \ ms
==============================================================================
