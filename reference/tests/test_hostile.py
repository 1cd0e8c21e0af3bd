"""END-5 and MEM-1 against senders that try: what must be refused, and what must stay small."""

from __future__ import annotations

import json
from typing import Any

import pytest
from automcm_stage import Stage, fin
from pydantic import ValidationError

from automcm.station import Station
from automcm_spec.application import Request
from automcm_spec.messages import MessageError, Trajectory, decode, encode
from automcm_spec.parameters import Parameters

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


@pytest.mark.parametrize("v", [True, 1.0, 2, "1", None])
def test_end_5_the_version_is_the_integer_1(v: Any) -> None:
    with pytest.raises(MessageError, match="v"):
        decode(json.dumps(advertisement(v=v)))


@pytest.mark.parametrize("seq", [False, 0.0, 1, None])
def test_end_6_the_seq_of_an_ack_is_the_integer_0(seq: Any) -> None:
    ack = {"v": 1, "type": "Ack", "src": 9, "dst": 1, "session": [1, 1], "seq": seq}
    with pytest.raises(MessageError, match="seq"):
        decode(json.dumps(ack | {"of": {"type": "Fin", "seq": 1}}))


@pytest.mark.parametrize("name", ["v", "seq"])
def test_end_5_what_has_a_default_inside_is_needed_on_the_wire(name: str) -> None:
    ack = {"v": 1, "type": "Ack", "src": 9, "dst": 1, "session": [1, 1], "seq": 0}
    ack |= {"of": {"type": "Fin", "seq": 1}}
    del ack[name]
    with pytest.raises(MessageError, match=name):
        decode(json.dumps(ack))


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


def test_time_does_not_go_back_at_a_restart_either() -> None:
    station = Station(1)
    station.advance(5000)
    with pytest.raises(ValueError, match="time goes back"):
        station.restart(100)


def test_a_forged_fin_ends_the_session() -> None:
    """No message is authenticated (docs/security.md): ``src`` is whatever its sender says."""
    stage = Stage().walk("receiver", "ACTUATING")
    forged = encode(fin())
    (effects,) = stage.hear(stage.now, forged)
    assert effects.rule == "ACT-3" and stage.at == ("none", "STANDALONE")
