"""The reasons for empty cells of docs/rule-coverage.md (citations.py)."""

from __future__ import annotations

from automcm_spec.model_checking import models

_STEP = "a step of the session, not a protection: `station_properties` must reach it"
_NOTHING = "no effect on the station: the comparison gives every such input to every state"
_TRAJECTORY = "about trajectories, which the specification does not contain"
_APPLICATION = "a rule of the application, not of the station: the simulated drives check it"
_EARLY = "ends a session before an agreement: no shortest counterexample needs it"
_IDLE = "no effect on the station: no shortest counterexample has such a step"

KINEMATIC = tuple(f"KIN-{n}" for n in range(1, 8))
APPLICATION = {
    "APP-1": "an application knows everybody heard or seen, whether they answered or not",
    "APP-2": "it proceeds or prescribes only if everybody known is clear or follows the target",
    "APP-3": "when a vehicle is clear: gap, margin, braking",
    "APP-4": "it looks again before it moves over",
    "APP-5": "it looks on while it moves over, up to the point of no return",
    "APP-6": "a station whose clock is out of step counts as one that did not answer",
}
"""Rules of an application, not of the station, in one line each."""
PROPERTIES = tuple(id_ for id_ in models.PROPERTIES if id_ != "TypeInv")
_OF_ONE = tuple(id_ for id_ in PROPERTIES if id_[0] in "SN" and id_ not in models.SAFETY)
_OF_SEVERAL = tuple(id_ for id_ in PROPERTIES if id_ not in _OF_ONE)
_ABOVE = ("specification", "must fail", "case", "log tools", "counterexample")
WITHOUT_VECTORS = tuple(rule for rule in APPLICATION if rule != "APP-6")
VECTORLESS = "not a kernel rule: vectors exist for KIN-1 to KIN-7 and APP-6"

WHY: list[tuple[str, tuple[str, ...], str]] = [
    ("specification", ("ACT-1", *KINEMATIC), _TRAJECTORY),
    (
        "must fail",
        ("ADV-1", "ADV-2", "PRE-1", "PRE-3", "NEG-2", "NEG-8"),
        _STEP,
    ),
    ("must fail", ("CMD-1", "MSG-1"), _NOTHING),
    ("must fail", ("ACT-1", *KINEMATIC), _TRAJECTORY),
    ("code", _OF_SEVERAL, "a property of several stations together, not of one station's code"),
    ("code", _OF_ONE, "a property of all handlers of a station together, not of a single one"),
    ("case", ("ACT-1",), "up to the application: no message and no timer shows it"),
    ("case", KINEMATIC, "the vectors are the cases of the kernels"),
    ("case", PROPERTIES, "a case is about one rule of one station"),
    ("log tools", ("ACT-1", *KINEMATIC), _TRAJECTORY),
    (
        "log tools",
        (
            "I-1",
            *_OF_ONE,
            *(f"L-{n}" for n in range(1, 5)),
            "P-1",
            "R-1",
            "R-2",
            "T-6",
            "T-7",
            "T-8",
            "T-9",
        ),
        "checked by TLC; the log tools judge S-1 to S-8 and T-1 to T-5",
    ),
    ("counterexample", ("PRE-3", "PRE-5", "NEG-8"), _EARLY),
    ("counterexample", ("END-4", "CMD-1", "MSG-1", "ACT-6"), _IDLE),
    ("counterexample", ("ACT-1", *KINEMATIC), _TRAJECTORY),
    (
        "test",
        ("L-2", "L-3", "P-1", "R-1", "R-2", *_OF_ONE, "T-7"),
        "only checked by TLC; its must-fail model shows that the check can fail",
    ),
    *((column, tuple(APPLICATION), _APPLICATION) for column in _ABOVE),
]
"""Column, rules, and the reason for their empty cells; for vectors see VECTORLESS."""
