"""Random behaviours of a model: equal for equal seeds, and the rules that they cover."""

import json

import pytest
from cli_stage import automcm

from automcm_spec.model_checking import models, random_walks
from automcm_spec.support.paths import SIMULATION
from automcm_spec.vocabulary.rules import RULES

KNOWN = random_walks.known()


def test_the_listed_models_and_the_larger_ones_have_names() -> None:
    assert set(KNOWN) == {
        *(m.cfg for m in models.load()),
        *(p.stem for p in SIMULATION.glob("*.cfg")),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "depth"), [(4, 20), pytest.param(20, 30, marks=pytest.mark.deep)]
)
def test_the_same_seed_gives_the_same_bytes(number: int, depth: int) -> None:
    def report(seed: int) -> str:
        found = random_walks.run(
            KNOWN["two_by_three"], seed=seed, depth=depth, seconds=None, number=number
        )
        return json.dumps(found.as_dict())

    first = report(1)
    assert first == report(1)
    one, other = json.loads(first), json.loads(report(2))
    assert one["rules"] != other["rules"]
    assert one["behaviours"] == number


@pytest.mark.slow
def test_every_step_is_decided_by_a_rule() -> None:
    found = random_walks.run(KNOWN["one_by_two"], depth=12, seconds=None, number=100)
    assert (found.behaviours, found.ended, found.exit_code) == (100, "number", 0)
    assert found.steps == sum(found.rules.values()) <= 1200
    assert found.rules["ADV-1"] == 100  # one session, and it is opened first
    assert set(found.rules) | set(found.never) == set(RULES)
    assert "MEM-1" in found.never


@pytest.mark.slow
def test_a_violated_property_is_reported_with_its_steps() -> None:
    result = automcm("spec", "simulate", "bare_ack", "--seconds", "60", "--depth", "40")
    assert result.exit_code == 0, result.output
    assert "S-6 is violated; as expected" in result.output
    assert "  1. Command at station 1: " in result.output
    assert "[END-6: OnAck" in result.output or "[ADV-6: OnAck" in result.output


def test_a_violation_where_all_was_to_hold_is_a_verdict_against() -> None:
    found = random_walks.run(KNOWN["bare_ack"], seconds=60, depth=40)
    assert found.ended == "violation"
    assert found.rules[last_rule(found)] >= 1
    unexpected = random_walks.Walks(
        KNOWN["one_by_two"], 1, 40, 1, 1, found.rules, "violation", found.property, found.trace
    )
    assert unexpected.exit_code == 1


def last_rule(found: random_walks.Walks) -> str:
    last = found.trace[-1].values["last"]
    assert isinstance(last, dict)
    return str(last["rule"])


@pytest.mark.slow
def test_a_model_that_must_fail_and_does_not_is_no_verdict() -> None:
    found = random_walks.run(KNOWN["retarget"], depth=3, seconds=None, number=5)
    assert (found.property, found.exit_code) == (None, 4)


def test_a_module_that_does_not_extend_system_is_refused() -> None:
    model = random_walks.WalkModel("open", KNOWN["one_by_two"].cfg, "OpenStation")
    with pytest.raises(models.ModelError, match="must extend System"):
        random_walks.run(model, number=1)
