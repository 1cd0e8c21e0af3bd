"""Messages with one edge-case value, and the reference's interpretation of them.

As station_behaviour.py, it is imported after the reference has been replaced, so it defines its own
bounds.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

from automcm_maintenance.code_mutation.lockstep import Answer, Changed
from automcm_spec.vocabulary.messages import MessageError, decode, encode

LIMIT = 2**53 - 1
LONG = 60
WAY = {"t0": 5, "points": [[0, 0, 0], [1000, 8333, 0]]}
COMMON: dict[str, Any] = {"v": 1, "src": 2, "dst": 1, "session": [2, 1], "seq": 1}
BASES: tuple[dict[str, Any], ...] = (
    {k: v for k, v in COMMON.items() if k != "dst"}
    | {"type": "Advertisement", "scenario": "merge", "details": {"lane": 2}, "planned": WAY},
    COMMON | {"type": "Intention", "planned": WAY},
    COMMON
    | {"type": "Prescription", "proposal": 1, "prescribed": WAY}
    | {"hold_ms": 0, "lease_ms": 1},
    COMMON | {"type": "Acceptance", "proposal": 1, "accepted": True, "selected": WAY},
    COMMON | {"type": "Acceptance", "proposal": 1, "accepted": False, "reason": "unsafe"},
    COMMON | {"type": "Acceptance", "proposal": 1, "accepted": False, "reason": "busy", "seq": 0},
    COMMON | {"type": "Fin"},
    COMMON | {"type": "Cancel", "reason": "abort"},
    COMMON | {"type": "Cancel", "reason": "closed", "seq": 0},
    COMMON | {"type": "Ack", "seq": 0, "of": {"type": "Fin", "seq": 1}},
    {"v": 1, "type": "CAM", "src": 2, "generation_ms": 1, "x_mm": 1, "y_mm": 1}
    | {"heading_mrad": 1, "speed_mm_s": 1, "marks": [[2, 1]]},
)


def _nested(depth: int, of: type) -> Any:
    value: Any = 1
    for _ in range(depth):
        value = [value] if of is list else {"a": value}
    return value


EDGE_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, 2, 3, -1, 1.0, 1.5, "", "x", "1", [], {}, [1], {"a": 1}),
    *(bound + n for bound in (LIMIT, -LIMIT, 2**32 - 1) for n in (-1, 0, 1)),
    *("unsafe", "undecided", "busy", "unknown_session", "closed", "timeout", "not_selected"),
    *("not_needed", "no_agreement", "cam_loss", "lease_expired", "abort", "odd"),
    *("Advertisement", "Intention", "Prescription", "Acceptance", "Fin", "Cancel", "Ack", "CAM"),
    *("é", "\ud800", "a" * 65_507, "a" * 65_508, "é" * 65_507),
    *({"a" * n: 1} for n in (65_507, 65_508)),
    *({"a": entry} for entry in (None, 1.5, True, "\ud800", LIMIT + 1, -LIMIT - 1, LIMIT, -LIMIT)),
    *(_nested(n, of) for n in (31, 32, 33) for of in (list, dict)),
    *({"a": _nested(n, list)} for n in (30, 31, 32)),
    *([[2, k + 1] for k in range(n)] for n in (0, 1, 254, 255, 256)),
    *([2, 0], [0, 1], [2, 1, 1], [2], [2**32, 1], [2, 2**53], [[0, 0]], [[0, 0, 0]]),
    WAY,
)


class Forms:
    """Each base message is a state; its edge-case values are the inputs."""

    states = BASES

    def fields(self, n: int, changed: Changed) -> Changed:
        """None: a message leaves no state."""
        return {}

    def answers(self, n: int, changed: Changed) -> Iterator[Answer]:
        """Each message with an edge case, and its interpretation."""
        for what, message in _messages(BASES[n]):
            yield Answer(what, _taken(message), None, n)


def _messages(base: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    yield "as it is", base
    yield "one more", base | {"more": 1}
    for path in _paths(base):
        yield f"without {path}", _with(base, path, ...)
        for entry in EDGE_VALUES:
            text = json.dumps(entry)
            shown = text if len(text) < LONG else f"{text[:LONG]}… ({len(text)} characters)"
            yield f"{path}: {shown}", _with(base, path, entry)


def _taken(message: Any) -> str:
    try:
        return encode(decode(json.dumps(message))).decode()
    except MessageError:
        return "refused"
    except Exception as error:  # a mutant may raise anything
        return type(error).__name__


def _paths(value: Any, *before: Any) -> Iterator[tuple[Any, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for name, each in items:
        yield (*before, name)
        if isinstance(each, dict | list):
            yield from _paths(each, *before, name)


def _with(value: Any, path: tuple[Any, ...], entry: Any) -> Any:
    """A copy with ``entry`` at this path; for ``...`` the path is removed."""
    *way, name = path
    whole = inner = deepcopy(value)
    for step in way:
        inner = inner[step]
    if entry is ...:
        del inner[name]
    else:
        inner[name] = entry
    return whole
