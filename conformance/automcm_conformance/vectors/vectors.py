"""Test vectors for the trajectory kernels and for signed messages (docs/vectors.md): read them,
check an implementation.

The inputs in ``conformance/vectors/*.json`` are written by hand, the expected outputs are not: in a
clone, automcm_maintenance.exact_vectors fills them in.  The vectors for signed messages are made,
with what is expected, by conformance/tests/secured_vectors.py.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from automcm_conformance.adapter.kit_paths import VECTORS

Json = Any
Call = Callable[[str, Json], Json]
"""An implementation: returns the outputs of a kernel for these inputs.

For an invalid input it returns ``{"error": {"name": ..., "index": ...}}``; the index is optional.
It raises NotImplementedError for one of SECURED without signed messages, with the reason.
"""

SCHEMA = "vectors-1.schema.json"
ROUNDING = 1e-9
"""What rounding may add to the errors of KIN-2, m and m/s."""
SECURED = ("certificate", "envelope")
"""For signed messages (docs/secured.md), which are optional."""
KERNELS = (
    *("convert", "thin", "collide", "extents", "discover", "prescribe", "verify", "success"),
    "clock",
    *SECURED,
)


class _Motion(BaseModel, strict=True):
    """Places over time; the sample times are free, and so is the motion before and after."""

    t: list[FiniteFloat]
    xy: list[Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]]


@dataclass(frozen=True, slots=True)
class Case:
    """A vector, with the properties that its file states for all vectors."""

    id: str
    kernel: str
    rule: str
    purpose: str
    bug: str
    inputs: Json
    expected: Json
    tolerance: dict[str, float]


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a vector."""

    case: Case
    problem: str
    """The first difference; empty if there is none."""
    got: Json = None
    not_supported: str = ""
    """Why the implementation has no answer; empty if it has one."""

    @property
    def ok(self) -> bool:
        """Whether the answer is correct, or not required."""
        return not self.problem


def paths() -> list[Path]:
    """The files, one for each kernel, in the order of the rules."""
    return [VECTORS / f"{kernel}.json" for kernel in KERNELS]


def load(path: Path) -> list[Case]:
    """The vectors of a file, which has the form of SCHEMA.  Raises OSError."""
    file = json.loads(path.read_text(encoding="utf-8"))
    return [
        Case(
            **{name: vector[name] for name in ("id", "purpose", "inputs", "expected")},
            bug=file["bugs"][vector["bug"]],
            **{name: file[name] for name in ("kernel", "rule", "tolerance")},
        )
        for vector in file["vectors"]
    ]


def check(call: Call, cases: Iterable[Case]) -> list[Result]:
    """Check an implementation with the vectors.  An exception that it raises is a problem, except
    NotImplementedError for one of SECURED."""
    results = []
    for case in cases:
        try:
            got = call(case.kernel, json.loads(json.dumps(case.inputs)))
            results.append(Result(case, difference(case, got), got))
        except Exception as error:
            if isinstance(error, NotImplementedError) and case.kernel in SECURED:
                results.append(Result(case, "", not_supported=str(error) or "not implemented"))
            else:
                results.append(Result(case, f"raised {type(error).__name__}: {error}"))
    return results


def difference(case: Case, got: Json) -> str:
    """The first difference between the expected and the actual outputs; empty if there is none."""
    expected = case.expected
    if "error" in expected:
        named = {name: expected["error"].get(name) for name in ("name", "index")}
        answer = got.get("error") if isinstance(got, dict) else None
        if not isinstance(answer, dict):
            return f"error: expected for {_named(named)}, got none"
        answer = {name: answer.get(name) for name in ("name", "index")}
        return "" if named == answer else f"error: expected {_named(named)}, got {_named(answer)}"
    if isinstance(got, dict) and "error" in got:
        return f"error: expected none, got {got['error']}"
    if case.kernel == "thin":
        return _thins(case.inputs, expected, got)
    if case.kernel == "prescribe":
        return _moves(expected, got, case.tolerance)
    return _differs("", expected, got, case.tolerance, 0)


def _named(error: Json) -> str:
    return str(error["name"]) + ("" if error["index"] is None else f"[{error['index']}]")


def _differs(
    place: str, expected: Json, got: Json, tolerances: dict[str, float], tolerance: float
) -> str:
    if isinstance(expected, dict):
        if not isinstance(got, dict) or expected.keys() != got.keys():
            names = sorted(got) if isinstance(got, dict) else got
            return f"{place or 'outputs'}: expected {sorted(expected)}, got {names}"
        pairs = [
            (f"{place}.{name}".lstrip("."), expected[name], got[name], tolerances.get(name, 0))
            for name in expected
        ]
    elif isinstance(expected, list):
        if not isinstance(got, list) or len(expected) != len(got):
            size = len(got) if isinstance(got, list) else got
            return f"{place}: expected {len(expected)} entries, got {size}"
        pairs = [
            (f"{place}[{n}]", *both, tolerance)
            for n, both in enumerate(zip(expected, got, strict=True))
        ]
    elif isinstance(expected, float) and type(got) in (int, float):
        return "" if abs(expected - got) <= tolerance else _unequal(place, expected, got)
    else:
        same = type(expected) is type(got) and expected == got
        return "" if same else _unequal(place, expected, got)
    return next(filter(None, (_differs(p, e, g, tolerances, t) for p, e, g, t in pairs)), "")


def _unequal(place: str, expected: Json, got: Json) -> str:
    return f"{place}: expected {expected}, got {got}"


def _thins(inputs: Json, expected: Json, got: Json) -> str:
    """Compare kept points: the ends stay, their number and the errors are bounded, the others are
    free."""
    kept = got.get("kept") if isinstance(got, dict) else None
    if not isinstance(kept, list) or any(type(n) is not int for n in kept):
        return f"kept: expected indices, got {kept}"
    if kept != sorted(set(kept)):
        return f"kept: expected ascending indices, got {kept}"
    t, xy = inputs["t"], inputs["xy"]
    missing = sorted({0, len(t) - 1} - set(kept))
    if missing or not 0 <= kept[0] <= kept[-1] < len(t):
        return f"kept: {missing} must be kept" if missing else f"kept: not indices: {kept}"
    if len(kept) > expected["at_most"]:
        return f"kept: expected at most {expected['at_most']} points, got {len(kept)}"
    if expected["position"] is None:
        return ""
    for a, b in pairwise(kept):
        even = math.dist(xy[a], xy[b]) / (t[b] - t[a])
        for n in range(a, b):
            there = _at([t[a], t[b]], [xy[a], xy[b]], t[n])
            errors = {
                "position": math.dist(xy[n], there),
                "speed": abs(math.dist(xy[n], xy[n + 1]) / (t[n + 1] - t[n]) - even),
            }
            for name, error in errors.items():
                if error > expected[name] + ROUNDING:
                    return f"kept: at index {n} the {name} differs by {error}"
    return ""


def _moves(expected: Json, got: Json, tolerances: dict[str, float]) -> str:
    """Compare places at equal times; the sample times are free."""
    try:
        motion = _Motion.model_validate(got)
    except ValidationError as error:
        return f"outputs: not a motion: {error}"
    t, begin, end = motion.t, expected["t"][0], expected["t"][-1]
    if not t or len(t) != len(motion.xy) or t != sorted(set(t)):
        return "t: expected ascending times, as many as places"
    if t[0] > begin + tolerances["t"] or t[-1] < end - tolerances["t"]:
        return f"t: expected times from {begin} to {end}, got {t[0]} to {t[-1]}"
    for when in sorted({*expected["t"], *(each for each in t if begin <= each <= end)}):
        wanted, there = _at(expected["t"], expected["xy"], when), _at(t, motion.xy, when)
        if any(not abs(w - g) <= tolerances["xy"] for w, g in zip(wanted, there, strict=True)):
            return f"xy: expected {wanted} at {when} s, got {there}"
    return ""


def _at(t: Sequence[float], xy: Sequence[Sequence[float]], when: float) -> list[float]:
    n = min(max(bisect_right(t, when) - 1, 0), len(t) - 1)
    if n == len(t) - 1 or when <= t[n]:
        return list(xy[n])
    share = (when - t[n]) / (t[n + 1] - t[n])
    return [a + share * (b - a) for a, b in zip(xy[n], xy[n + 1], strict=True)]
