"""Edits of Station.tla that ``automcm trace explain`` and the kit follow as soon as the station is
compiled anew, without another line changed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from copied_tree import copied, python
from test_scenarios import REFERENCE, run


@dataclass(frozen=True)
class Edit:
    """A text of Station.tla, its replacement, and the result."""

    scenario: str
    old: str
    new: str
    rule: str = ""
    """By which the log of the scenario diverges; empty if it is still allowed."""
    event: str = ""
    """With which it does so."""
    by: int = 0
    """The station by which the reference fails the scenario with that event; 0 if it passes."""
    met: str = ""
    """A phase or a rule that coverage counts now."""
    played: str = ""
    """With which it fails, if that is another event."""


EDITS = {
    "a guard": Edit(
        "all arrives",
        'IF Bound(st) THEN Ignore(st, "ADV-4")',
        'IF Bound(st) \\/ st.number = 0 THEN Ignore(st, "ADV-4")',
        "ADV-4",
        "send Intention to 1001",
        by=2002,
    ),
    "the name of a phase": Edit(
        "all arrives",
        '"WAITING"',
        '"PATIENT"',
        by=2002,
        played="phase: expected PATIENT, got WAITING",
        met="PATIENT",
    ),
    "the id of a rule": Edit("all arrives", '"NEG-2"', '"NEG-12"', met="NEG-12"),
    "a reason": Edit(
        "three receivers",
        '"not_selected"',
        '"too_far"',
        "PRE-2",
        "send Cancel to 2002 (reason: expected too_far, got not_selected)",
        by=1001,
    ),
    "a limit": Edit(
        "refused twice",
        "RoundLeft(st) == st.proposal < MaxRounds",
        "RoundLeft(st) == st.proposal + 1 < MaxRounds",
        "NEG-7",
        "arm decide",
        by=1001,
        played="indication propose",
    ),
    "a new condition, by a new rule": Edit(
        "all arrives",
        "  ELSE LeaveWith(st, {Fin(",
        '  ELSE IF st.heard THEN Refuse(st, "ACT-6")\n  ELSE LeaveWith(st, {Fin(',
        "ACT-6",
        "send Fin to 2002",
        by=1001,
    ),
    "a new field": Edit(
        "two prescribers",
        "    backoff    |-> FALSE ]",
        "    used       |-> FALSE,\n    backoff    |-> FALSE ]",
        "ADV-1",
        "send Advertisement to all",
        by=1002,
    ),
    "when a timer is armed": Edit(
        "all arrives",
        'If(st.phase = "WAITING", {Timer("hold")})',
        'If(st.phase \\in {"INTENDING", "WAITING"}, {Timer("hold")})',
        "ADV-3",
        "receive Advertisement from 1001: effects are missing",
        by=2002,
        played="deadline:",
    ),
    "an indication": Edit(
        "all arrives", '<<"finished">>', '<<"done">>', "ACT-3", "indication finished", by=2002
    ),
    "what is answered": Edit(
        "each twice",
        "AckCopy(me, m) == {Ack(me, m)}",
        "AckCopy(me, m) == {}",
        "NEG-1",
        "send Ack to 1001",
        by=2002,
    ),
    "what is sent at the end": Edit(
        "CAMs cut",
        'OnCamLoss(me, st) == CancelPeer(me, st, "cam_loss", "ACT-2")',
        'OnCamLoss(me, st) == Effect(Leave(st), {}, <<"fallback", "cam_loss">>, "ACT-2")',
        "ACT-2",
        "send Cancel to 2002",
        by=1001,
    ),
}
FIELD = {
    "ELSE IF ~Room(st) THEN": 'ELSE IF st.used THEN Refuse(st, "ADV-1")\n  ELSE IF ~Room(st) THEN',
    "!.session = s, !.number = @ + 1]": "!.session = s, !.number = @ + 1, !.used = TRUE]",
}
"""What sets and asks the new field."""
QUICK = ("a guard",)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Logs of a scenario by the specification as it is."""

    @cache
    def played(scenario: str) -> Path:
        folder = tmp_path_factory.mktemp("logs")
        assert run(f"scenario {scenario}", REFERENCE, folder).verdict == "PASS"
        return folder

    return played


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.deep) for n in EDITS]
)
def test_an_edit_is_followed(name: str, logs: Any, tmp_path: Path) -> None:
    edit = EDITS[name]
    copied(tmp_path, "spec")
    path = tmp_path / "spec" / "tla" / "Station.tla"
    text = path.read_text()
    for old, new in {edit.old: edit.new, **(FIELD if name == "a new field" else {})}.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    script = str(Path(__file__).parents[1] / "edited_station.py")
    (tmp_path / "played").mkdir()
    given = f"scenario {edit.scenario}", str(logs(edit.scenario)), str(tmp_path / "played")
    found = json.loads(python(tmp_path, script, *given))
    verdicts = {(v["verdict"], v["rule"], v["event"]) for v in found["verdicts"]}
    if edit.rule:
        assert ("diverges", edit.rule, edit.event) in verdicts
    else:
        assert {verdict for verdict, _, _ in verdicts} == {"allowed"}
    verdict, what = found["played"]
    assert verdict == ("FAIL" if edit.by else "PASS")
    assert what.startswith(f"{edit.by}: {edit.played or edit.event}" if edit.by else "")
    assert edit.met in ["", *found["met"]]
