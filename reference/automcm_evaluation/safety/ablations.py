"""Ablations: the running station without one mechanism of the protocol.

docs/protocol.md lists the mechanisms and docs/models.md has a counterexample for each.  An
ablation is an edit of the station (conformance/fault_catalogue/ablations.toml), or another
parameter; the code of the service is unchanged.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.code_mutation.faults import Fault
from automcm_spec.vocabulary.parameters import Parameters

PARAMETERS = Parameters(clock_drift=0)
"""The clocks here have no drift, and a margin would hide a wrong lease (ACT-4)."""


@dataclass(frozen=True, slots=True)
class Ablation:
    """An ablation disables ``rule``.

    ``breaks`` is the property that then fails in model checking; ``model`` has the counterexample
    (docs/models.md).
    """

    name: str
    rule: str
    breaks: str
    model: str
    text: str
    parameters: Parameters = PARAMETERS
    unseen: str = ""
    """The reason why random faults may not show the effect."""
    fault: Fault | None = None

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Take the mechanism away from all stations of this process."""
        if self.fault is None:
            yield
            return
        with faults.put(self.fault):
            yield


def _of(fault: Fault) -> Ablation:
    n = fault.notice
    timeout = {"t_timeout": n["t_timeout"]} if "t_timeout" in n else {}
    return Ablation(
        fault.name,
        n["rule"],
        n["property"],
        n["model"],
        fault.story,
        replace(PARAMETERS, **timeout),
        n.get("unseen", ""),
        fault if fault.edits else None,
    )


WHOLE = Ablation("whole protocol", "", "", "", "nothing is taken away")
ABLATIONS = tuple(map(_of, faults.load("ablations").values()))
BY_NAME = {ablation.name: ablation for ablation in (WHOLE, *ABLATIONS)}
