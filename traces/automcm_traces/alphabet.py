"""The inputs that a station of a log may get next, on the ids that the log knows."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from automcm_spec.conditions import EMPTY
from automcm_spec.station import Input, Message, OpenStation, Session
from automcm_traces.track import Track

Json = Any
SOMEBODY = -1
"""Stands for a station that nothing is known of."""
STRANGER = -2
"""Of ``OpenStation``."""


class _Neighbours(OpenStation):
    """OpenStation with a track's ids, limits and timers."""

    def __init__(self, track: Track, peers: Collection[int], sessions: set[Session]) -> None:
        own = frozenset(n for q, n in sessions if q == track.me)
        limits = track.max_rounds, *track.limits
        super().__init__(*limits, frozenset(peers), own, frozenset(), track.me, STRANGER)
        self._outbox, self._of_peers = track.state.outbox, sessions
        self.foreign: frozenset[Session] = EMPTY
        self.rounds = frozenset({max(track.proposal, 1), track.proposal + 1})
        self.beyond = track.proposal + 2
        self.timers = self.armed(track.me, track.state)

    def peer_ids(self, p: int) -> frozenset[Session]:
        """Those that are known of this peer."""
        return frozenset(s for s in self._of_peers if s[0] == p)

    def acks(self, p: int) -> frozenset[Message]:
        """Of each message that this peer must ack, and one that matches nothing (END-6)."""
        waiting = [e for e in self._outbox if e.to == p]
        of = {(e.session, (e.type, e.seq)) for e in waiting} | {((self.me, 1), ("Cancel", 0))}
        return frozenset(self.message("Ack", p, self.me, s, 0)._replace(of=of_) for s, of_ in of)


def alphabet(track: Track, about: Mapping[str, Json]) -> frozenset[Input]:
    """What may come next from the stations, and about the sessions, that the state or a message,
    timer or command names; and one newer session of each."""
    named = {about.get(name) for name in ("dst", "to", "target", "station")}
    peers = {p for p in named if isinstance(p, int)} | {track.peer, *track.recorded[:1]}
    peers = peers - {0, track.me} or {SOMEBODY}
    sessions = set(track.state.joined) | {e.session for e in track.outbox}
    sessions |= {(track.me, track.number + n) for n in (0, 1)}
    sessions |= {(p, track.joined.get(p, 0) + 1) for p in peers}
    return _Neighbours(track, peers, sessions).alphabet
