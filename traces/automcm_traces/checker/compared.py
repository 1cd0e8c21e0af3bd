"""Which fields of a log are compared with the specification: those of ``COMPARED``, no others.

They are all that ``Station.tla`` decides, but for ``rule`` of an input, which explains and does
nothing. ``rule`` of an indication is part of what the application gets.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, get_args

from automcm_spec.vocabulary import application
from automcm_spec.vocabulary.messages import Fields, Message, same, to_dict
from automcm_spec.vocabulary.station import State
from automcm_traces.checker.track import CONTENT, InputStep

COMPARED: Final[Mapping[str, tuple[str, ...]]] = {
    "send": (
        *("type", "src", "dst", "session", "seq", "proposal", "accepted", "reason", "of"),
        *CONTENT,
    ),
    "send CAM": ("src", "marks"),
    "timer": ("op", "timer", "deadline"),
    "indication": (
        *("name", "rule", "session", "proposal", "reason", "stations", "intentions"),
        *("prescription", "prescribed", "acceptance", "selected", "lease_left_ms"),
    ),
    "every event": ("phase", "role"),
}
"""For each kind of event that a station causes, the fields compared where they are present.

A copy repeats every field of its message. Of ``intentions`` the senders are compared.
"""
CARRIED = ("reason", "prescribed", "selected")
"""The fields that an indication takes from the received message."""
_OWN: Final = {
    model.model_fields["name"].default: {"rule", *model.model_fields, *model.model_computed_fields}
    for model in get_args(application.Indication)
}
"""The fields of each indication; others mean nothing."""


def told(name: str, given: Fields) -> dict[str, object]:
    """The content of an indication that is compared, with the senders of ``intentions``."""
    names = [one for one in COMPARED["indication"][1:] if one in _OWN.get(name, ())]
    found = {one: given[one] for one in names if one in given}
    match found.get("intentions"):
        case list(intentions):
            senders = [m.get("src") if isinstance(m, dict) else m for m in intentions]
            found["intentions"] = senders
            if None in senders:  # a form of the implementation's own
                del found["intentions"]
    return found


def wrongly_told(
    name: str, given: Fields, step: InputStep, before: State, lease_ms: int | None
) -> dict[str, tuple[object, object]]:
    """The fields of an indication of a step that differ: what was expected, and what was found.

    ``before`` is the state before the step, ``lease_ms`` the deadline of the lease, if known.
    """
    wanted: dict[str, object] = {
        "rule": step.rule,
        "session": list(before.session),
        "proposal": step.after.proposal + (name == "propose"),
        "stations": sorted(step.after.recorded),
        "intentions": sorted(step.after.recorded, key=repr),
    }
    received = to_dict(step.given) if isinstance(step.given, Message) else {}
    wanted |= {"prescription": received, "acceptance": received} if received else {}
    wanted |= {one: received[one] for one in CARRIED if one in received}
    if step.indication[1:] not in ((), ("as_sent",)):
        wanted["reason"] = step.indication[1]
    if lease_ms is not None and step.event is not None:
        wanted["lease_left_ms"] = lease_ms - step.t_ms
    found = told(name, given)
    if "intentions" in found and isinstance(found["intentions"], list):
        found["intentions"] = sorted(found["intentions"], key=repr)
    return {
        one: (wanted[one], value)
        for one, value in found.items()
        if one in wanted and not same(wanted[one], value)
    }
