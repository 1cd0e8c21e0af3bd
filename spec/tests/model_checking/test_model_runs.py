"""Must-fail models that share a run of TLC."""

import pytest

from automcm_spec.model_checking import model_runs, models, tlc
from automcm_spec.support.paths import TLA

QUICK = {model.cfg: model for model in models.load()}
SHARED = [[model.cfg for model in run] for run in model_runs.runs(models.load()) if len(run) > 1]


def test_models_that_differ_in_operators_alone_share_a_run() -> None:
    assert ["bare_ack", "rejoin", "abandoned_acceptance"] in SHARED
    assert [run for run in SHARED if {"finishes_silently", "sent_twice", "joins_all"} <= set(run)]
    together = {name for run in SHARED for name in run}
    assert not [n for n in together if QUICK[n].expect == "holds" or QUICK[n].property == "L-1"]


@pytest.mark.sweep(1)
@pytest.mark.parametrize("names", SHARED, ids=lambda names: names[0])
def test_a_shared_run_finds_the_counterexamples_of_the_single_ones(names: list[str]) -> None:
    """Each with its property, its steps and the names of its actions."""
    run = [QUICK[name] for name in names]
    together = model_runs._shared(run, TLA, tlc.TlcStop())
    alone = {model.cfg: models.check(model) for model in run}
    found = {name: verdict.trace for name, verdict in together.items()}
    assert list(found) == names and all(verdict.ok for verdict in together.values())
    for name, trace in found.items():
        single = alone[name].trace
        assert [(s.action, s.values) for s in trace] == [(s.action, s.values) for s in single]


def test_a_model_that_breaks_elsewhere_is_run_alone() -> None:
    run = [QUICK["bare_ack"].model_copy(update={"length": 99}), QUICK["abandoned_acceptance"]]
    verdicts = model_runs.check_all(run)
    assert [verdict.problem for verdict in verdicts] == ["length is 6, expected 99", None]
