"""Folds the copies of a repeated message: 20 rows of one Advertisement become one, marked x20.
Datagrams that are rejected for the same reason fold alike.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

from automcm_spec.log_format.event_text import summary
from automcm_spec.log_format.log import Event, Receive, Send, TimerArm, TimerEnd
from automcm_traces.system.matching import content

Item = TypeVar("Item")


class Key(NamedTuple):
    """Items with equal keys fold, unless something else comes between them."""

    message: Hashable
    """The message; None for what accompanies any message, such as a timer that is armed again."""
    part: Hashable
    """What happens to it, and where: sent by a station, received by another."""
    changes: bool = False
    """Whether the phase changes here: earlier items do not fold with this and later ones."""


@dataclass(slots=True)
class Fold(Generic[Item]):
    """An item, or the first of several that differ only in time."""

    first: Item
    times: int = 1
    copies: list[Item] = field(default_factory=list)
    """All items but the first, if ``folded`` keeps them."""

    @property
    def mark(self) -> str:
        """Such as ``\u00d720``; empty for a single item."""
        return f"\u00d7{self.times}" if self.times > 1 else ""


def folded(
    items: Iterable[Item], key: Callable[[Item], Key | None], keep: bool = False
) -> Iterator[Fold[Item]]:
    """The items in the order of the first of each fold; with ``keep``, each fold has its copies.

    A fold ends where another message comes, an item without a key, such as a command, or one that
    changes a phase: that one is never hidden in a fold.
    """
    open_: dict[Key, Fold[Item]] = {}
    message: Hashable = None
    for item in items:
        found = key(item)
        other = found is None or found.changes or found.message not in (None, message)
        if other or message is None:
            yield from open_.values()
            open_, message = {}, None if found is None else found.message
        if found is None:
            yield Fold(item)
            continue
        fold = open_.setdefault(found._replace(changes=False), Fold(item, 0))
        fold.times += 1
        if keep and fold.times > 1:
            fold.copies.append(item)
    yield from open_.values()


class OfCams:
    """Finds CAMs, and the timers that they re-arm, among the events of stations in order."""

    def __init__(self) -> None:
        self._after: set[int] = set()

    def has(self, station: int, event: Event) -> bool:
        """Whether the next event of a station is one of them."""
        watched = event.is_cam_timer and not event.is_expiry
        found = event.is_cam or (station in self._after and watched)
        (self._after.add if found else self._after.discard)(station)
        return found


def key_of(station: int, event: Event, fate: Hashable = None, changes: bool = False) -> Key | None:
    """The key of an event in a station's log. CAMs, commands, indications and restarts have none.

    Copies are equal messages with the same ``fate``. ``changes``: the phase changes here.
    """
    if isinstance(event, TimerArm | TimerEnd):
        return Key(None, (station, event.op, repr(event.timer)), changes)
    if isinstance(event, Receive) and event.rejected is not None:
        return Key(summary(event), (station, event.ev, fate), changes)
    if not isinstance(event, Send | Receive) or event.message is None or event.is_cam:
        return None
    return Key(content(event.message), (station, event.ev, fate), changes)
