"""The steps of counterexamples of all kinds of models, as named inputs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from model_stage import checked

from automcm_spec.model_checking.counterexample_steps import ModelStep, steps
from automcm_spec.model_checking.tlc import TraceState
from automcm_spec.vocabulary.station import Receive


def found(cfg: str) -> list[ModelStep]:
    return steps(checked(cfg).trace)


def test_every_step_of_a_station_names_its_input_rule_and_line() -> None:
    for step in found("bare_ack"):
        assert step.station in (1, 2)
        assert step.rule and step.line > 0 and step.input[0] in ("receive", "command", "expire")
    last = found("bare_ack")[-1]
    assert isinstance(last.input, Receive) and last.input.message.type == "Ack"
    assert "outbox" in last.changes
    assert f"station {last.station}: " in last.text and f"[{last.rule}: OnAck" in last.text


@pytest.mark.slow
def test_the_only_station_of_a_model_is_found() -> None:
    assert [step.station for step in found("finishes_silently")] == [1, 1]
    last = found("finishes_silently")[-1]
    assert last.rule == "ACT-3" and last.changes["phase"][1] == "STANDALONE"


@pytest.mark.slow
def test_a_liveness_counterexample_goes_on_for_ever() -> None:
    result = checked("no_give_up").result
    assert result is not None and result.loop in range(1, len(result.trace) + 1)
    text = [step.text for step in found("no_give_up")]
    assert "a message is lost: " in "".join(text)


@pytest.mark.sweep(1)
@pytest.mark.parametrize(("cfg", "event"), [("bound_less_one", "tick"), ("silent_cam_loss", "cut")])
def test_time_and_the_radio_have_steps_of_their_own(cfg: str, event: str) -> None:
    events = [step for step in found(cfg) if step.station is None]
    assert event in {step.input[0] for step in events}
    assert all(not step.changes and step.rule is None and step.text for step in events)


def test_the_bound_of_t_2_is_reached_by_a_restart_after_a_cam() -> None:
    kinds = [step.input[0] for step in found("bound_less_one")]
    restart = kinds.index("restart")
    assert "cam" in kinds[restart:]  # the last CAM with the mark arrives after the restart
    assert kinds[restart:].count("tick") == 5  # Delay + CamLoss of that model


def test_a_station_that_is_a_model_value_is_found_by_its_name() -> None:
    def named(state: TraceState) -> TraceState:
        last: Any = state.values["last"]
        stations = dict(zip("ab", state.values["st"], strict=True))
        changed = {"st": stations, "last": {**last, "station": "ab"[(last["station"] or 1) - 1]}}
        other = replace(state)
        object.__setattr__(other, "values", state.values | changed)
        return other

    trace = checked("bare_ack").trace
    assert [step.station for step in steps(list(map(named, trace)))] == [
        "ab"[(step.station or 1) - 1] for step in steps(trace)
    ]
