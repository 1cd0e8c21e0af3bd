"""Everything that is wrong in one line of a log. A reader stops at the first problem.

Some problems hide others from the models of ``log``: a null, a float, a wrong ``rec``, ``ev``,
``op`` or timer name. So these are replaced by values that the format allows, and the line is
checked again.
"""

from __future__ import annotations

import math
from typing import Any, Final, get_args

from pydantic import TypeAdapter, ValidationError

from automcm_traces.format.log import (
    RECORD,
    SCHEMA,
    EventKind,
    UnknownEvent,
    command_problems,
    not_sorted,
    receive_problems,
)
from automcm_traces.format.problems import join, problems_of, unfit

Json = Any
KINDS: Final = get_args(EventKind)
_UNKNOWN: Final = TypeAdapter(UnknownEvent)


def line_problems(
    value: dict[str, Json], me: object
) -> tuple[list[tuple[str, str]], dict[str, Json]]:
    """Each wrong field of a line (a path such as ``message.seq``) and its problem, in the order of
    the line; and the line with the supposed ``rec``, ``ev``, ``op`` and timer name. ``me`` is the
    station of the log."""
    odd: dict[str, str] = {}
    line: Json = plain(value, odd)
    found: list[tuple[str, str]] = []
    supposed: set[str] = set()
    while True:
        wrong = _wrong(line)
        found += [one for one in wrong if one not in found]
        tag = next((path for path, _ in wrong if path in _SUPPOSED), "")
        if not tag or tag in supposed or not _suppose(line, tag, {*value}, me):
            break
        supposed.add(tag)
    found += [one for one in _between(line) if one not in found]
    found = [_as_null(odd, *one) for one in found]
    paths = {path for path, problem in found if not problem.startswith("must be at ")}
    found += [(path, problem) for path, problem in odd.items() if path not in paths]
    order = {name: n for n, name in enumerate(value)}
    found.sort(key=lambda one: order.get(_first(one[0]), len(order)))
    return found, value | {name: line[name] for name in _TAGS if name in line}


def plain(
    value: Json, odd: dict[str, str], path: str = "", name: str = "", *, listed: bool = False
) -> Json:
    """A copy without nulls and floats. ``odd`` gets the path and the problem of each; of those in
    one list only the first, with the number of the others. ``listed``: ``value`` is in a list."""
    match value:
        case dict():
            items = {k: plain(v, odd, join(path, k), k, listed=listed) for k, v in value.items()}
            return {k: v for k, v in items.items() if value[k] is not None}
        case list():
            inside = odd if listed else {}
            copy = [plain(v, inside, f"{path}[{n}]", listed=True) for n, v in enumerate(value)]
            if inside and not listed:
                (first, problem), *others = inside.items()
                more = f" (and {len(others)} more in this list)" if others else ""
                odd[first] = problem + more
            return copy
        case None | float():
            odd[path] = unfit(value, name)
            return int(value) if value is not None and math.isfinite(value) else 0
    return value


def _wrong(line: Json) -> list[tuple[str, str]]:
    ev = line.get("ev")
    unknown = line.get("rec") == "event" and isinstance(ev, str) and ev not in KINDS
    try:
        if unknown:
            _UNKNOWN.validate_python(line)
        else:
            RECORD.validate_python(line)
    except ValidationError as error:
        return problems_of(error)
    return []


_TAGS: Final = ("rec", "ev", "op", "timer")
_SUPPOSED: Final = ("rec", "ev", "op", "timer.name", "schema")


def _suppose(line: Json, field: str, names: set[str], me: object) -> bool:
    """Replace a wrong field by the value that the names of the other fields suggest. Returns
    whether there is one."""
    match field:
        case "schema":
            line["schema"] = SCHEMA
        case "rec" if names & {"lost_records", "reason"}:
            line["rec"] = "end"
        case "rec" if names & {"schema", "run", "station", "implementation", "complete"}:
            line["rec"] = "header"
        case "rec":
            line["rec"] = "event"
        case "ev":
            line["ev"] = _kind(line, names, me)
        case "op":
            line["op"] = "arm" if "deadline" in names else "stop"
        case "timer.name":
            timer = line["timer"]
            station = "forget" if "station" in timer else "cam"
            line["timer"] = timer | {"name": "resend" if "message" in timer else station}
        case _:
            return False
    return True


def _kind(line: Json, names: set[str], me: object) -> EventKind:
    if names & {"timer", "op", "deadline"}:
        return "timer"
    if not names & {"message", "tx", "raw", "planned"}:
        kinds: tuple[EventKind, ...] = ("command", "indication")
        return next((kind for kind in kinds if kind in names), "restart")
    message, tx = line.get("message"), line.get("tx")
    src = message.get("src") if isinstance(message, dict) else str(tx).split(":")[0]
    return "send" if str(src) == str(me) and not names & {"raw", "planned"} else "receive"


def _between(line: Json) -> list[tuple[str, str]]:
    """The problems between fields, which the models look for only if the fields are right."""
    if line.get("rec") == "header" and isinstance(kinds := line.get("complete"), list):
        known = tuple(kind for kind in kinds if kind in KINDS)
        return [("complete", problem) for problem in not_sorted(known)]
    match line.get("ev"):
        case "receive":
            message = line.get("message")
            if message is None or (isinstance(message, dict) and "type" in message):
                return list(
                    receive_problems(
                        message, *(line.get(n) for n in ("raw", "planned", "rejected"))
                    )
                )
        case "command" if isinstance(command := line.get("command"), dict):
            return [(join("command", path), what) for path, what in command_problems(command)]
    return []


def _as_null(odd: dict[str, str], path: str, problem: str) -> tuple[str, str]:
    """A field that is missing because it was null."""
    if problem.startswith("missing") and path in odd:
        return path, f"null is not allowed, and the field is required{problem[7:]}"
    return path, problem


def _first(path: str) -> str:
    return path.split(".")[0].split("[")[0]
