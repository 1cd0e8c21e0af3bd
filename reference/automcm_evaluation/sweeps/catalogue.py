"""The experiments by their names."""

from __future__ import annotations

from importlib import import_module

from automcm_evaluation.framework.experiment import Experiment, ExperimentError

NAMES = ("bandwidth", "arrival", "comfort", "loss", "safety", "radio", "traffic")
MODULES = {"traffic": "traffic_experiment"}
"""Where it is not the name: ``traffic`` is the package of the traffic itself."""


def experiment(name: str) -> Experiment:
    """The experiment with that name.  Raises ExperimentError."""
    if name not in NAMES:
        raise ExperimentError(f"there is no experiment {name!r}; there are: {', '.join(NAMES)}")
    module = MODULES.get(name, name)
    found: Experiment = import_module(f"automcm_evaluation.{module}.{module}").EXPERIMENT
    return found
