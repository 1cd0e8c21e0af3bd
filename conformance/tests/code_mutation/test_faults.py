"""The catalogues of faults: each entry is checked when it is read, and put in and taken back."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from automcm.core import advertising, negotiating
from automcm.core.outcome import foreign
from automcm.core.rules import RULES
from automcm_maintenance.code_mutation import faults
from automcm_maintenance.code_mutation.faults import CATALOGUES, Edit, Fault, FaultError

FOREIGN = Edit("automcm.core.outcome:foreign", "i.message.session != st.session", "False")


@pytest.mark.parametrize("path", sorted(CATALOGUES.glob("*.toml")), ids=lambda path: path.stem)
def test_each_text_is_found(path: Path) -> None:
    assert faults.load(path.stem)


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (Edit(FOREIGN.place, "no such text", ""), "foreign has 0 times 'no such text', not once"),
        (Edit("automcm.core.outcome", "me: Me", ""), "not once"),
        (Edit(FOREIGN.place, FOREIGN.old, FOREIGN.old), "has 1 times"),
        (Edit("automcm.core.outcome:native", "a", "b"), "there is no native"),
        (Edit("automcm.core.outset", "a", "b"), "there is no module automcm.core.outset"),
    ],
)
def test_an_entry_that_names_nothing_fails(edit: Edit, says: str) -> None:
    with pytest.raises(FaultError, match=re.escape(says)):
        Fault("x", (edit,)).texts()


def test_a_fault_is_in_each_place_that_uses_the_function_and_is_taken_back() -> None:
    rows = [row.when for row in RULES["receive Cancel"] if row.when is foreign]
    used = [advertising.foreign, negotiating.foreign, *rows]
    right = foreign.__code__
    with faults.put(Fault("x", (FOREIGN,))):
        assert len(used) == 3 and all("session" not in each.__code__.co_names for each in used)
    assert foreign.__code__ is right


def test_what_is_not_in_a_function_needs_a_process() -> None:
    for old, new in (("BROADCAST = ", "BROADCAST = 1 + "), ("LIMIT = 2**53", "LIMIT = 2**52")):
        edit = Edit("automcm_spec.vocabulary.messages", old, new)
        with (
            pytest.raises(FaultError, match="changes more than functions"),
            faults.put(Fault("x", (edit,))),
        ):
            pass


def test_a_program_has_the_fault() -> None:
    command = faults.load("adapters")["sends_no_cam"].command(
        "adapters", "automcm.adapters.adapter_lines"
    )
    hello = b'{"cmd":"hello","protocol":1}\n'
    done = subprocess.run(command, input=hello, capture_output=True, check=True)
    assert b'"name":"automcm reference"' in done.stdout
