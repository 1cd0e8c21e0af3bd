"""END-5 and MEM-1 against hostile senders: refused messages, and bounded memory."""

from __future__ import annotations

import json
from typing import Any

import pytest
from automcm_stage import Stage, cam, fin

from automcm.core.station import Station
from automcm_spec.vocabulary.messages import MessageError, Trajectory, decode, encode
from automcm_spec.vocabulary.parameters import Parameters

PLANNED = Trajectory(t0=0, points=((0, 0, 0),))


def advertisement(src: int = 9, number: int = 1, **fields: Any) -> dict[str, Any]:
    message = {"v": 1, "type": "Advertisement", "src": src, "session": [src, number], "seq": 1}
    return message | {"scenario": "x", "details": {}} | fields


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


FAR = 2**53 - 1
Forgery = list[tuple[int, int]]
"""When CAMs arrive, and by how much they are ahead, in ms."""


def left_at(role: str, forged: Forgery, busy_ms: int = 0) -> int | None:
    """When a station leaves although the CAMs of its peer come every 100 ms for 4 s.

    It is busy at first, and then takes those that have come meanwhile.
    """
    stage = Stage().walk(role, "ACTUATING")
    begin, session, peer = stage.now, stage.state.session, stage.state.peer
    assert session is not None
    honest = [(max(t, busy_ms), min(t - busy_ms, 0) - 3) for t in range(10, 4000, 100)]
    for t, ahead in sorted([*honest, *forged]):
        stage.hear(begin + t, encode(cam(peer, min(begin + t + ahead, FAR), session)))
        if stage.state.phase != "ACTUATING":
            return t
    return None


@pytest.mark.parametrize("role", ["prescriber", "receiver"])
@pytest.mark.parametrize(
    "forged",
    [
        [(500, FAR)],
        [(500, 397)],
        [(500 + n, 397 + n * 100) for n in range(90)],
        [(t, 5_000) for t in range(15, 4000, 10)],
        [(599, -180)],
    ],
    ids=["far ahead", "at the bound", "step by step", "all the time", "late"],
)
def test_act_5_a_cam_that_is_far_ahead_changes_nothing(role: str, forged: Forgery) -> None:
    assert left_at(role, forged) is None


@pytest.mark.parametrize("role", ["prescriber", "receiver"])
def test_act_5_a_host_that_is_busy_at_first_loses_no_session(role: str) -> None:
    assert left_at(role, [], busy_ms=360) is None


@pytest.mark.parametrize("role", ["prescriber", "receiver"])
def test_act_5_a_forged_first_cam_ends_the_session(role: str) -> None:
    """Not protected (docs/security.md)."""
    assert left_at(role, [(0, FAR)]) == 1510


def test_end_5_an_error_is_short_whatever_was_sent() -> None:
    with pytest.raises(MessageError) as caught:
        decode(json.dumps(advertisement(type="x" * 1_000_000)))
    assert len(str(caught.value)) <= 200
