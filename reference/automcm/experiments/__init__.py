"""The paper's evaluation as seeded sweeps (section VI), and what the paper does not have.

Each experiment is a module of its own with an ``EXPERIMENT``; ``sweep`` runs its cells, ``report``
makes of them what is written down.
"""

from __future__ import annotations

from importlib import import_module

from automcm.experiments.experiment import Experiment, ExperimentError

NAMES = ("bandwidth", "arrival", "comfort", "loss", "safety")


def experiment(name: str) -> Experiment:
    """The experiment of that name.  Raises ExperimentError."""
    if name not in NAMES:
        raise ExperimentError(f"there is no experiment {name!r}; there are: {', '.join(NAMES)}")
    found: Experiment = import_module(f"automcm.experiments.{name}").EXPERIMENT
    return found
