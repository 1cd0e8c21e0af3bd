"""Events as compact arrays for a page: repeated values are stored once.

An object becomes ``[shape, value, …]``, where ``shape`` is the index of its list of keys. A list
becomes ``[-1, item, …]``. ``viewer/data.js`` decodes them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

Json = Any
PLAIN = frozenset({int, str, bool})
"""Types that are stored as they are: without a call, which matters for every field of a log."""


@dataclass(slots=True)
class PackedTable:
    """Values in order of first use; each use refers to one by its distance from the end."""

    values: list[Json] = field(default_factory=list)
    _places: dict[str, int] = field(default_factory=dict)

    def back(self, value: Json) -> int:
        """The distance of a text or a list from the end of the table; 0 if it was appended."""
        end = len(self.values)
        return end - self.place(value)

    def place(self, value: Json) -> int:
        """The index of a text or a list, from 0. A new one is appended."""
        key = value if isinstance(value, str) else json.dumps(value)
        place = self._places.setdefault(key, len(self.values))
        if place == len(self.values):
            self.values.append(value)
        return place


@dataclass(slots=True)
class Shapes:
    """The key lists of all packed objects, with their indices."""

    keys: dict[tuple[str, ...], int] = field(default_factory=dict)

    def pack(self, value: Json) -> Json:
        """``value`` in packed form; numbers, texts and booleans stay."""
        if isinstance(value, dict):
            place = self.keys.setdefault(tuple(value), len(self.keys))
            return [place, *[v if type(v) in PLAIN else self.pack(v) for v in value.values()]]
        if isinstance(value, list | tuple):
            return [-1, *[v if type(v) in PLAIN else self.pack(v) for v in value]]
        return value


def compact(value: Json) -> str:
    """JSON without spaces, in ASCII, that cannot end a ``<script>``."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")
