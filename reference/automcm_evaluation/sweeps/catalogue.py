"""The experiments by their names."""

from __future__ import annotations

from collections import ChainMap
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from automcm_evaluation.framework.experiment import Experiment, ExperimentError

NAMES = ("bandwidth", "arrival", "comfort", "loss", "safety", "radio", "traffic")
"""Those of docs/evaluation."""
MODULES = {name: f"{name}.{name}" for name in NAMES} | {
    "traffic": "traffic_experiment.traffic_experiment",
    "traffic-sweep": "traffic_experiment.traffic_sweep",
}
"""Each has TITLE, Settings, ``cells`` and ``run``; beside it ``*_tables`` have ``summary`` and
``names``, and ``*_figures`` have ``plots``."""


def experiment(name: str) -> Experiment:
    """The experiment with that name.  Raises ExperimentError."""
    if name not in MODULES:
        raise ExperimentError(f"there is no experiment {name!r}; there are: {', '.join(MODULES)}")
    module = f"automcm_evaluation.{MODULES[name]}"
    beside = [f"{module.removesuffix('_experiment')}_{part}" for part in ("tables", "figures")]
    parts = [import_module(each) for each in [module, *filter(find_spec, beside)]]
    of = ChainMap[str, Any](*map(vars, parts))
    return Experiment(
        name=name,
        title=of["TITLE"],
        settings=of["Settings"],
        cells=of["cells"],
        run=of["run"],
        summary=of["summary"],
        names=of["names"],
        figures=of.get("plots", lambda report: iter(())),
    )
