"""Ablations: the running station without one mechanism of the protocol.

docs/protocol.md lists the mechanisms and docs/models.md has a counterexample for each.  An
ablation is an edit of the station (conformance/fault_catalogue/ablations.toml), or another
parameter; the code of the service is unchanged.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.code_mutation.faults import Fault
from automcm_spec.vocabulary.parameters import Parameters

PARAMETERS = Parameters(clock_drift=0)
"""The clocks here have no drift, and a margin would hide a wrong lease (ACT-4)."""


@dataclass(frozen=True)
class Ablation:
    """An ablation disables ``rule``.

    ``breaks`` is the property that then fails in model checking; ``model`` has the counterexample
    (docs/models.md).
    """

    name: str
    text: str
    fault: Fault | None = None
    rule: str = ""
    breaks: str = ""
    model: str = ""
    unseen: str = ""
    """The reason why random faults may not show the effect."""
    t_timeout: int = PARAMETERS.t_timeout

    @property
    def parameters(self) -> Parameters:
        """Those of all stations."""
        return replace(PARAMETERS, t_timeout=self.t_timeout)

    def applied(self) -> AbstractContextManager[None]:
        """Take the mechanism away from all stations of this process."""
        return faults.put(self.fault) if self.fault and self.fault.edits else nullcontext()


WHOLE = Ablation("whole protocol", "nothing is taken away")
ABLATIONS = tuple(
    Ablation(f.name, f.story, f, **f.notice) for f in faults.load("ablations").values()
)
BY_NAME = {ablation.name: ablation for ablation in (WHOLE, *ABLATIONS)}
