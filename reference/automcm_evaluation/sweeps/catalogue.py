"""The experiments by their names."""

from __future__ import annotations

from importlib import import_module

from automcm_evaluation.framework.experiment import Experiment, ExperimentError

NAMES = ("bandwidth", "arrival", "comfort", "loss", "safety", "radio", "traffic")
"""Those of docs/evaluation."""
MODULES = {name: f"{name}.{name}" for name in NAMES} | {
    "traffic": "traffic_experiment.traffic_experiment",
    "traffic-sweep": "traffic_experiment.traffic_sweep",
}


def experiment(name: str) -> Experiment:
    """The experiment with that name.  Raises ExperimentError."""
    if name not in MODULES:
        raise ExperimentError(f"there is no experiment {name!r}; there are: {', '.join(MODULES)}")
    found: Experiment = import_module(f"automcm_evaluation.{MODULES[name]}").EXPERIMENT
    return found
