"""Folds the copies of a repeated message: 20 rows of one Advertisement become one, marked x20.
Datagrams that are rejected for the same reason fold alike.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from automcm_spec.log_format.event_text import summary
from automcm_spec.log_format.log import Event, Receive, Send, TimerArm, TimerEnd
from automcm_traces.system.log_merge import content

Item = TypeVar("Item")


class Key(NamedTuple):
    """Items with equal keys fold, unless something else comes between them."""

    message: Hashable
    """The message; None for what accompanies any message, such as a timer that is armed again."""
    part: Hashable
    """What happens to it, and where: sent by a station, received by another."""


@dataclass(slots=True)
class Fold(Generic[Item]):
    """An item, or the first and the last of several that differ only in time."""

    first: Item
    last: Item
    times: int = 1

    @property
    def mark(self) -> str:
        """Such as ``\u00d720``; empty for a single item."""
        return f"\u00d7{self.times}" if self.times > 1 else ""


def folded(items: Iterable[Item], key: Callable[[Item], Key | None]) -> Iterator[Fold[Item]]:
    """The items in the order of the first of each fold.

    A fold ends where another message comes, or an item without a key, such as a command.
    """
    open_: dict[Key, Fold[Item]] = {}
    message: Hashable = None
    for item in items:
        found = key(item)
        other = found is None or (found.message is not None and found.message != message)
        if other or message is None:
            yield from open_.values()
            open_, message = {}, None if found is None else found.message
        if found is None:
            yield Fold(item, item)
        elif found in open_:
            open_[found].last = item
            open_[found].times += 1
        else:
            open_[found] = Fold(item, item)
    yield from open_.values()


def key_of(station: int, event: Event, fate: Hashable = None) -> Key | None:
    """The key of an event in a station's log. CAMs, commands, indications and restarts have none.

    Copies are equal messages with the same ``fate``.
    """
    if isinstance(event, TimerArm | TimerEnd):
        return Key(None, (station, event.op, repr(event.timer)))
    if isinstance(event, Receive) and event.rejected is not None:
        return Key(summary(event), (station, event.ev, fate))
    if not isinstance(event, Send | Receive) or event.message is None:
        return None
    if event.is_cam:
        return None
    return Key(content(event.message), (station, event.ev, fate))
