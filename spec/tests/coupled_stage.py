"""Edits of Station.tla that couple its sessions, or the participants of one.

The lemmas must notice each (test_independence).
"""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.code_mutation.faults import Fault
from automcm_spec.support.paths import TLA

COUPLED = faults.load("coupled")
DEPENDENT = faults.load("dependent")
"""Edits that do more with ids and numbers than to compare them."""


def edited(fault: Fault, folder: Path) -> Path:
    """A copy of the modules in ``folder``, with the edit."""
    tla = Path(copytree(TLA, folder / "spec" / "tla"))
    fault.write(folder)
    return tla
