"""Every wrong field of one line of a log, by the validation of ``log``, which the reader uses too.

The reader names one null or float, which hides other errors from the models; here, all are named.
"""

from __future__ import annotations

import json
import math
from typing import Any

from pydantic import ValidationError

from automcm_spec.log_format.log import EVENT_KINDS, RECORD, UNKNOWN
from automcm_spec.log_format.problems import join, problems_of, unfit

Json = Any


def line_problems(value: dict[str, Json]) -> list[tuple[str, str]]:
    """Each wrong field of a line (a path such as ``message.seq``) and its problem, in the order of
    the line."""
    odd: dict[str, str] = {}
    found = [_as_null(odd, *one) for one in _wrong(plain(value, odd))]
    paths = {path for path, problem in found if not problem.startswith("must be at ")}
    found += [(path, problem) for path, problem in odd.items() if path not in paths]
    order = {name: n for n, name in enumerate(value)}
    found.sort(key=lambda one: order.get(_first(one[0]), len(order)))
    return found


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
    unknown = line.get("rec") == "event" and isinstance(ev, str) and ev not in EVENT_KINDS
    try:
        (UNKNOWN if unknown else RECORD).validate_json(json.dumps(line))
    except ValidationError as error:
        return problems_of(error)
    return []


def _as_null(odd: dict[str, str], path: str, problem: str) -> tuple[str, str]:
    """A field that is missing because it was null."""
    if problem.startswith("missing") and path in odd:
        return path, f"null is not allowed, and the field is required{problem[7:]}"
    return path, problem


def _first(path: str) -> str:
    return path.split(".")[0].split("[")[0]
