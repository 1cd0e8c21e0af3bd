"""What a station of a log may get: the alphabet of OpenStation.tla on the ids of the log."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from typing import Any

from automcm_spec.station import Expire, Input, OpenStation, Restart, Session, State
from automcm_traces.track import UNBOUND, Track

Json = Any
SOMEBODY = -1
"""Stands for a station that nothing is known of."""
STRANGER = -2
"""Of OpenStation; no id of a log."""


class Alphabet(OpenStation):
    """OpenStation.tla on these ids and limits.  No session is a stranger's."""

    def __init__(
        self,
        limits: tuple[int, int, int, int],
        me: int,
        peers: Collection[int],
        sessions: Collection[Session],
        proposals: Collection[int],
    ) -> None:
        own = frozenset(n for q, n in sessions if q == me)
        super().__init__(*limits, frozenset(peers), own, frozenset(), me, STRANGER)
        self._named = frozenset(sessions) - {UNBOUND}
        self._proposals = frozenset(proposals)

    @cached_property
    def rounds(self) -> frozenset[int]:
        """The proposals that matter."""
        return self._proposals

    @cached_property
    def beyond(self) -> int:
        """One that does not: a log may hold proposals above max_rounds."""
        return max(self._proposals, default=0) + 1

    @cached_property
    def foreign(self) -> frozenset[Session]:
        """No session of a stranger."""
        return frozenset()

    def peer_ids(self, p: int) -> frozenset[Session]:
        """The sessions of a peer that are named."""
        return frozenset(s for s in self._named if s[0] == p)

    @cached_property
    def proper(self) -> tuple[Input, ...]:
        """What keeps the protocol, but for expiries, in a fixed order."""
        found: set[Input] = {*self.commands, Restart("restart")}
        for p in self.peers:
            found |= self.heard(self.from_peer(p), True) | self.heard(self.acks(p), False)
            found |= self.cams(p)
        return tuple(sorted(found, key=repr))

    @cached_property
    def broken(self) -> tuple[Input, ...]:
        """What breaks it (END-5), in a fixed order."""
        found = (m for p in self.peers for m in self.heard(self.improper(p), True))
        return tuple(sorted(found, key=repr))

    def expiries(self, st: State) -> Iterator[Input]:
        """Of the timers that are armed."""
        return (Expire("expire", timer) for timer in sorted(self.armed(self.me, st)))


def alphabet(track: Track, about: Mapping[str, Json]) -> list[Input]:
    """What may come next from the stations, and about the sessions, that the state or a message,
    timer or command names; and one newer session of each."""
    named = {about.get(name) for name in ("dst", "to", "target", "station")}
    peers = {p for p in named if isinstance(p, int)} | {track.peer, *track.recorded[:1]}
    peers = peers - {0, track.me} or {SOMEBODY}
    sessions = set(track.state.joined) | {e.session for e in track.outbox}
    sessions |= {(track.me, track.number + n) for n in (0, 1)}
    sessions |= {(p, track.joined.get(p, 0) + 1) for p in peers}
    proposals = {max(track.proposal, 1), track.proposal + 1, *(e.k for e in track.outbox)}
    limits = track.max_rounds, *track.limits
    found = Alphabet(limits, track.me, peers, sessions, proposals)
    return [*found.expiries(track.state), *found.proper, *found.broken]
