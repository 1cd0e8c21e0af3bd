"""Stations that break one thing each (conformance/fault_catalogue/adapters.toml)."""

from __future__ import annotations

import sys

from automcm_maintenance.code_mutation import faults

ADAPTER = "automcm.adapters.adapter_lines"
FAULTS = faults.load("adapters")
BREAKS = {name: fault.notice for name, fault in FAULTS.items() if "scenario" in fault.notice}
CAUSES = {name: fault.notice for name, fault in FAULTS.items() if "operator" in fault.notice}
REFERENCE = [sys.executable, "-m", ADAPTER]
"""It starts faster than the command does."""


def broken(name: str, *arguments: object) -> list[str]:
    """The command that starts a station."""
    return FAULTS[name].command("adapters", ADAPTER, *arguments)
