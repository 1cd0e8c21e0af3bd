"""Edits of Station.tla that ``automcm trace explain`` and the kit follow as soon as the station is
compiled anew, without another line changed."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from copied_tree import copied, python
from test_scenarios import REFERENCE, run

from automcm_maintenance.code_mutation import faults

FAULTS = faults.load("edited_station")
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
    "name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.deep) for n in FAULTS]
)
def test_an_edit_is_followed(name: str, logs: Any, tmp_path: Path) -> None:
    copied(tmp_path, "spec")
    FAULTS[name].write(tmp_path)
    wanted = FAULTS[name].notice
    rule, event, by = wanted.get("rule", ""), wanted.get("event", ""), wanted.get("by", 0)
    script = str(Path(__file__).parents[1] / "edited_station.py")
    (tmp_path / "played").mkdir()
    scenario = wanted["scenario"]
    given = f"scenario {scenario}", str(logs(scenario)), str(tmp_path / "played")
    found = json.loads(python(tmp_path, script, *given))
    verdicts = {(v["verdict"], v["rule"], v["event"]) for v in found["verdicts"]}
    if rule:
        assert ("diverges", rule, event) in verdicts
    else:
        assert {verdict for verdict, _, _ in verdicts} == {"allowed"}
    verdict, what = found["played"]
    assert verdict == ("FAIL" if by else "PASS")
    assert what.startswith(f"{by}: {wanted.get('played', event)}" if by else "")
    assert wanted.get("met", "") in ["", *found["met"]]
