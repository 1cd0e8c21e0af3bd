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

    def back(self, value: Json, key: str | None = None) -> int:
        """0 if ``value`` is new and was appended, else its distance from the end of the table.

        ``key`` identifies a value; without it, ``value`` is its own key.
        """
        key = value if key is None else key
        place = self._places.get(key)
        if place is not None:
            return len(self.values) - place
        self._places[key] = len(self.values)
        self.values.append(value)
        return 0

    def place(self, value: Json) -> int:
        """The index of a text or a list, from 0."""
        back = self.back(value, value if isinstance(value, str) else json.dumps(value))
        return len(self.values) - (back or 1)


@dataclass(slots=True)
class Shapes:
    """The key lists of all packed objects."""

    keys: list[list[str]] = field(default_factory=list)
    _places: dict[tuple[str, ...], int] = field(default_factory=dict)

    def pack(self, value: Json) -> Json:
        """``value`` in packed form; numbers, texts and booleans stay."""
        if isinstance(value, dict):
            names = tuple(value)
            place = self._places.get(names)
            if place is None:
                place = self._places[names] = len(self.keys)
                self.keys.append(list(names))
            return [place, *[v if type(v) in PLAIN else self.pack(v) for v in value.values()]]
        if isinstance(value, list | tuple):
            return [-1, *[v if type(v) in PLAIN else self.pack(v) for v in value]]
        return value


def compact(value: Json) -> str:
    """JSON without spaces, in ASCII, that cannot end a ``<script>``."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")
