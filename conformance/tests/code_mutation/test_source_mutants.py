"""Each check can fail: ten changes to the reference, and as many edits of the specification.

A change is applied to a copy.  The comparison must name the rule that was touched; of the
specification's edits it must find a difference (neither the hash nor drift counts).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.verify.graph_comparison import walk
from automcm_maintenance.verify.spec_mapping import Reference
from automcm_spec.graph import oracle_generation
from automcm_spec.graph.oracle import dump, parse
from automcm_spec.support.paths import TLA

ROOT = Path(__file__).resolve().parents[3]
REFERENCE = ROOT / "reference" / "automcm"

WALK = """
from automcm_maintenance.verify.spec_mapping import Reference
from automcm_maintenance.code_mutation import faults
from automcm_maintenance.verify.graph_comparison import walk
from automcm_spec.graph import oracle, oracle_generation
graph = oracle.load(oracle_generation.ONE_PEER.path)
found = walk(graph, Reference(graph.constants), stop_at_first=True).divergences
print(found[0].rule if found else "no difference")
"""

CODE, SPEC = faults.load("reference"), faults.load("specification")


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "what",
    [pytest.param(w, marks=[pytest.mark.deep] * (w == "one proposal too many")) for w in CODE],
)
def test_a_change_to_the_reference_is_named(what: str, tmp_path: Path) -> None:
    shutil.copytree(REFERENCE, tmp_path / "reference" / "automcm")
    CODE[what].write(tmp_path)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "reference")}
    answer = subprocess.run(
        [sys.executable, "-c", WALK], env=environment, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == CODE[what].notice["rule"]


TINY = oracle_generation.Graph("tiny", (2,), 1, 1, 2, 3, 1)


def differences(tla: Path) -> int:
    """How much the reference differs from the specification in a folder, where it first does."""
    try:
        data, _ = oracle_generation.build(TINY, tla=tla, workers=1, short=True)
    except ValueError as error:  # the type invariant
        assert "TypeInv" in str(error)
        return 1
    oracle = parse(dump(data), "tiny")
    return walk(oracle, Reference(oracle.constants), stop_at_first=True).differences


@pytest.mark.slow
def test_unchanged_there_is_no_difference() -> None:
    assert differences(TLA) == 0


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "what", [pytest.param(w, marks=[pytest.mark.deep] * (n % 3 > 0)) for n, w in enumerate(SPEC)]
)
def test_an_edit_of_the_specification_is_noticed(what: str, tmp_path: Path) -> None:
    shutil.copytree(TLA, tmp_path / "spec" / "tla")
    SPEC[what].write(tmp_path)
    assert differences(tmp_path / "spec" / "tla") > 0
