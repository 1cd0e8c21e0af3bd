"""The distinct states that the radio's encoding saves, beside two naive encodings.

The models are the same: 1 prescriber, 1 receiver, 2 sessions, 2 proposals; S-1 to S-5 must hold as
far as seen.  A naive encoding that does not finish in time gives a lower bound of its states, which
is no less than a bar: then more seconds decide.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from automcm_maintenance.benches.plugin import Figure, beside
from automcm_spec.model_checking import tlc
from automcm_spec.support.paths import BENCH, TLA

NAIVE = {
    "consumed_set": "a set; receiving takes out, anything may be lost",
    "bag": "a bag of at most two copies; receiving takes out, anything may be lost",
}
SECONDS = re.compile(r"^(\s*Seconds = )\d+$", re.MULTILINE)
BAR = 1 / 20
"""The naive encodings must have so many times the states."""


def states(module: str, name: str, folder: Path, seconds: float) -> tuple[int, bool]:
    """The distinct states of a cfg of spec/bench, and whether TLC finished."""
    progress: list[tlc.Progress] = []
    cfg = folder / f"{name}.cfg"
    text = (BENCH / cfg.name).read_text(encoding="utf-8")
    cfg.write_text(SECONDS.sub(rf"\g<1>{round(seconds)}", text), encoding="utf-8")
    found = tlc.run(module, cfg, tla_dir=TLA, on_progress=progress.append)
    assert found.outcome == "holds", f"{name}: {found.property or 'a property'} is violated"
    # TLC also prints "No error has been found" when the time limit stops it, but states are left.
    return found.distinct_states, bool(progress) and progress[-1].queue == 0


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> int:
    """The states with a set that never shrinks, reduced."""
    found, finished = states("System", "set", tmp_path_factory.mktemp("set"), 0)
    assert finished, "TLC did not finish with the specification's own encoding"
    return found


@pytest.mark.parametrize("name", NAIVE)
def bench_naive(name: str, tmp_path: Path, figure: Figure, request: pytest.FixtureRequest) -> None:
    """A naive encoding."""
    seconds = float(request.config.getoption("--benchmark-max-time"))
    figure(states("Naive", name, tmp_path, seconds)[0], "states")


@pytest.mark.parametrize("name", NAIVE)
@beside("naive", BAR)
def bench_set(name: str, ours: int, figure: Figure) -> None:
    """The specification's encoding: a set that never shrinks, reduced (System.tla)."""
    figure(ours, "states")
