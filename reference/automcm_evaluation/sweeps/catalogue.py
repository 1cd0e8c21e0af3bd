"""The experiments by their names."""

from __future__ import annotations

from importlib import import_module

from automcm_evaluation.framework.experiment import Experiment, ExperimentError

NAMES = ("bandwidth", "arrival", "comfort", "loss", "safety", "radio")


def experiment(name: str) -> Experiment:
    """The experiment with that name.  Raises ExperimentError."""
    if name not in NAMES:
        raise ExperimentError(f"there is no experiment {name!r}; there are: {', '.join(NAMES)}")
    found: Experiment = import_module(f"automcm_evaluation.{name}.{name}").EXPERIMENT
    return found
