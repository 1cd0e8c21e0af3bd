"""Why a rule has nothing in a column of docs/rule-coverage.md (citations.py)."""

from __future__ import annotations

from automcm_spec.model_checking import models

_STEP = "a step of the session, not a protection of it: `probe_station` must reach it"
_NOTHING = "changes nothing at the station: the comparison gives every state every such input"
_LIMIT = "a limit of memory: it is met in the graph `tight`, and the closed models stay below it"
_TRAJECTORY = "about trajectories, of which the specification has none"
_EARLY = "ends a session before anything is agreed: no shortest counterexample needs it"
_IDLE = "changes nothing at the station: no shortest counterexample has such a step"

KINEMATIC = tuple(f"KIN-{n}" for n in range(1, 8))
PROPERTIES = tuple(id_ for id_ in models.PROPERTIES if id_ != "TypeInv")
_OF_ONE = ("S-9", "S-10", "S-11", "S-12", "S-13", "S-14", "S-15", "S-16")
_OF_SEVERAL = tuple(id_ for id_ in PROPERTIES if id_ not in _OF_ONE)
VECTORLESS = "no kernel: vectors are of KIN-1 to KIN-7"

WHY: list[tuple[str, tuple[str, ...], str]] = [
    ("specification", ("ACT-1", *KINEMATIC), _TRAJECTORY),
    (
        "must fail",
        (
            *("ADV-1", "ADV-2", "ADV-3", "PRE-1", "PRE-3", "NEG-2", "NEG-8"),
            *("END-1", "END-2", "END-7"),
        ),
        _STEP,
    ),
    ("must fail", ("ADV-4", "NEG-5", "CMD-1", "MSG-1"), _NOTHING),
    ("must fail", ("ACT-1", *KINEMATIC), _TRAJECTORY),
    ("code", _OF_SEVERAL, "kept by several stations together, by no code of one"),
    ("code", _OF_ONE, "kept by all handlers of a station together, by none alone"),
    ("case", ("ACT-1",), "the application's: no message and no timer shows it"),
    ("case", KINEMATIC, "the vectors are the cases of the kernels"),
    ("case", PROPERTIES, "a case is about one rule of one station"),
    ("counterexample", ("PRE-3", "PRE-5", "NEG-8", "END-7"), _EARLY),
    ("counterexample", ("END-4", "CMD-1", "MSG-1", "ACT-6"), _IDLE),
    ("counterexample", ("MEM-1",), _LIMIT),
    ("counterexample", ("ACT-1", *KINEMATIC), _TRAJECTORY),
    (
        "test",
        ("L-2", "L-3", "R-1", "R-2", *_OF_ONE, "T-7"),
        "checked by TLC alone; its must-fail model shows that the check can fail",
    ),
]
"""Column, rules, and the reason why they have nothing there.  Only KIN has vectors (VECTORLESS)."""
