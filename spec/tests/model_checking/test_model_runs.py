"""Must-fail models that share a run of TLC."""

import pytest
from model_stage import LISTED, checked, judged

from automcm_spec.model_checking import model_runs, models, tlc
from automcm_spec.model_checking.models import Model, ModelVerdict
from automcm_spec.support.paths import TLA

SHARED = [[model.cfg for model in run] for run in model_runs.runs(models.load()) if len(run) > 1]


def test_models_that_differ_in_operators_alone_share_a_run() -> None:
    assert ["bare_ack", "rejoin", "abandoned_acceptance"] in SHARED
    assert [run for run in SHARED if {"finishes_silently", "sent_twice", "joins_all"} <= set(run)]
    together = {name for run in SHARED for name in run}
    assert not [n for n in together if LISTED[n].expect == "holds" or LISTED[n].property == "L-1"]


@pytest.mark.parametrize(
    "names",
    [
        ["bare_ack", "abandoned_acceptance"],
        *(pytest.param(r, marks=pytest.mark.slow) for r in SHARED),
    ],
    ids=lambda names: names[0],
)
def test_a_shared_run_finds_the_counterexamples_of_the_single_ones(names: list[str]) -> None:
    """Each with its property, its steps and the names of its actions."""
    together = model_runs._shared([LISTED[name] for name in names], TLA, tlc.TlcStop())
    assert list(together) == names and all(verdict.ok for verdict in together.values())
    for name, verdict in together.items():
        single = checked(name).trace
        assert [(s.action, s.values) for s in verdict.trace] == [
            (s.action, s.values) for s in single
        ]


def test_a_model_that_breaks_elsewhere_is_run_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = LISTED["bare_ack"].model_copy(update={"length": 99})
    alone: list[str] = []

    def check(model: Model, **options: object) -> ModelVerdict:
        alone.append(model.cfg)
        return judged(model)

    def shared(run: list[Model], *_: object) -> dict[str, ModelVerdict]:
        return {model.cfg: judged(model) for model in run}

    monkeypatch.setattr(models, "check", check)
    monkeypatch.setattr(model_runs, "_shared", shared)
    found: list[ModelVerdict] = []
    model_runs.check_all([wrong, LISTED["abandoned_acceptance"]], on_done=found.append)
    assert {verdict.problem for verdict in found} == {"length is 6, expected 99", None}
    assert alone == ["bare_ack"]
