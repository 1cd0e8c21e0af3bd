"""Decides whether a mutant is equivalent to the reference on the graphs (lockstep.py)."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from automcm_maintenance.code_mutation.lockstep import Difference
from automcm_maintenance.code_mutation.mutated_process import GRAMMAR
from automcm_maintenance.code_mutation.source_mutants import (
    REFERENCE,
    SourceMutant,
    path_of,
)
from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.verify import kept_stages
from automcm_spec.graph import oracle
from automcm_spec.graph.oracle_generation import GRAPHS
from automcm_spec.support import children

WALKS = (
    ("forms", 0),
    *(("tight", n) for n in range(3)),
    *(("one-peer", n) for n in range(3)),
    ("two-peers", 0),
)
"""Graphs and variants, the fast ones first."""
WALK = "accepted_forms", "equivalence", "lockstep", "mutated_process", "station_behaviour"
FILES = (
    *(Path(__file__).with_name(f"{name}.py") for name in WALK),
    Path(__file__).parents[1] / "verify" / "spec_mapping.py",
    *sorted(path_of("messages").parent.glob("*.py")),
    Path(oracle.__file__),
)
"""What a comparison depends on, besides the reference and the graphs."""
SECONDS = 7_200
"""Limit of real time for one walk."""


class EquivalenceError(Exception):
    """A walk that did not finish; the text is the end of its standard error."""


def first_difference(
    mutant: SourceMutant, source: Path, walks: Iterable[tuple[str, int]], folder: Path
) -> Difference | None:
    """Where a mutant first behaves differently on these graphs, or None.

    ``source`` is the file of the mutated module; ``folder`` keeps the reference's answers.  Raises
    EquivalenceError, OSError.
    """
    of = REFERENCE, *FILES, *(graph.path for graph in GRAPHS.values())
    key = kept_stages.key(ROOT, *(str(path.relative_to(ROOT)) for path in of))
    folder.mkdir(parents=True, exist_ok=True)
    for graph, variant in walks:
        if graph == "forms" and mutant.module not in GRAMMAR:
            continue
        kept = folder / f"{key[:16]}-{graph}-{variant}.sqlite"
        found = json.loads(_child(mutant.module, str(source), graph, str(variant), str(kept)))
        if found is not None:
            return Difference(**found)
    return None


def _child(*arguments: str) -> str:
    command = [sys.executable, "-m", "automcm_maintenance.code_mutation.mutated_process"]
    try:
        done = subprocess.run(
            children.ending_with_parent([*command, *arguments]),
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )
    except subprocess.TimeoutExpired as error:
        raise EquivalenceError(f"no end after {SECONDS} s") from error
    if done.returncode:
        raise EquivalenceError(f"exit code {done.returncode}: {done.stderr.strip()[-500:]}")
    return done.stdout
