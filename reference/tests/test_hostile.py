"""END-5 and MEM-1 against hostile senders: refused messages, and bounded memory."""

from __future__ import annotations

import json
from typing import Any

import pytest
from automcm_stage import Stage, fin
from pydantic import ValidationError

from automcm.core.station import Station
from automcm_spec.vocabulary.application import Request
from automcm_spec.vocabulary.messages import MessageError, Trajectory, decode, encode
from automcm_spec.vocabulary.parameters import Parameters

PLANNED = Trajectory(t0=0, points=((0, 0, 0),))


def advertisement(src: int = 9, number: int = 1, **fields: Any) -> dict[str, Any]:
    message = {"v": 1, "type": "Advertisement", "src": src, "session": [src, number], "seq": 1}
    return message | {"scenario": "x", "details": {}} | fields


@pytest.mark.parametrize("value", [1.5, float("nan"), float("inf"), None, {"b": [None]}, [1.0]])
def test_end_5_details_hold_neither_floats_nor_nulls(value: Any) -> None:
    with pytest.raises(MessageError, match="details"):
        decode(json.dumps(advertisement(details={"a": value})))
    with pytest.raises(ValidationError):
        Request(scenario="x", details={"a": value})


def test_end_5_details_may_nest() -> None:
    details = {"lane": 2, "zone": [[0, 1], {"open": True, "name": "B"}]}
    message = decode(json.dumps(advertisement(details=details)))
    assert json.loads(encode(message))["details"] == details


def test_end_5_an_error_is_short_whatever_was_sent() -> None:
    with pytest.raises(MessageError) as caught:
        decode(json.dumps(advertisement(type="x" * 1_000_000)))
    assert len(str(caught.value)) <= 200


def test_mem_1_nothing_is_kept_of_a_forgotten_prescriber() -> None:
    station = Station(1, Parameters(t_timeout=0), plan=lambda _: PLANNED)
    now = 0
    for prescriber in range(10, 60):
        station.receive(json.dumps(advertisement(prescriber)).encode(), now)
        now += 60_000
        station.advance(now)
        while (deadline := station.next_deadline()) is not None:
            station.advance(now := max(now, deadline))
    assert not station.state.joined and not station._joined_at


def test_a_forged_fin_ends_the_session() -> None:
    """No message is authenticated (docs/security.md): ``src`` is whatever its sender says."""
    stage = Stage().walk("receiver", "ACTUATING")
    forged = encode(fin())
    (effects,) = stage.hear(stage.now, forged)
    assert effects.rule == "ACT-3" and stage.at == ("none", "STANDALONE")
