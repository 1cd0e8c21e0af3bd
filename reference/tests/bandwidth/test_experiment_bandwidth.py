"""Bytes on the air: their count, and the claims about them."""

from __future__ import annotations

import pytest
from automcm_stage import prescription

from automcm.encoding.codec import JSON, codec
from automcm_evaluation.bandwidth.bandwidth_air import (
    Recorded,
    Sent,
    certificates,
    measured,
    offered,
    on_air,
    record,
    session,
)
from automcm_evaluation.framework.experiment import ExperimentError
from automcm_simulation.road.drive import FourVehicles
from automcm_spec.vocabulary.messages import Cam, Prescription, Trajectory


@pytest.fixture(scope="module")
def four() -> Recorded:
    return record(3, [1], seed=3)


# -- how it is counted


def test_the_column_is_fig_6(four: Recorded) -> None:
    """Same vehicles, same seed, same messages as the scenario of the paper."""
    setting = FourVehicles(seed=3, until_s=16)
    assert four.drive.sent == setting.run().sent
    two = record(1, [0], seed=3)
    # There the receiver is station 3, here it is 2.
    kinds = [kind for _, _, kind in FourVehicles(vehicles=2, until_s=16).run().sent]
    assert sorted(kind for _, _, kind in two.drive.sent) == sorted(kinds)


def trajectory(t0: int = 7) -> Trajectory:
    return Trajectory(t0=t0, points=((0, 1, 2), (3, 4, 5)))


def test_on_the_air_ids_and_times_are_long() -> None:
    sent = prescription(1, (1, 5), dst=2, prescribed=trajectory(), hold_ms=1, lease_ms=2)
    there = on_air(sent)
    assert isinstance(there, Prescription)
    me, other = 3_000_000_001, 3_000_000_002
    later = {"prescribed": trajectory(1_800_000_000_007)}
    assert there == sent.model_copy(update={"src": me, "dst": other, "session": (me, 5)} | later)
    cam = Cam(src=1, generation_ms=9, x_mm=1, y_mm=2, heading_mrad=3, speed_mm_s=4, marks=((2, 5),))
    there = on_air(cam)
    assert isinstance(there, Cam)
    extras = {"length_mm": 4500, "width_mm": 1800, "station_type": 5, "sigma_mm": 9}
    assert on_air(cam.model_copy(update=extras)) == there
    assert there.generation_ms == 1_800_000_000_009 and there.marks == ((3_000_000_002, 5),)
    broadcast = on_air(offered(1, trajectory()))
    assert not isinstance(broadcast, Cam) and broadcast.dst == 0
    for message in (there, broadcast):
        assert JSON.decode(JSON.encode(message)) == message, "it is a message all the same"
        assert measured(message) == {n: len(codec(n).encode(message)) for n in ("json", "uper")}


def test_a_session_is_counted_from_its_first_message_to_its_last(four: Recorded) -> None:
    found = session(four, 1)
    times = [s.ms for s in four.air.sent if s.type != "CAM"]
    assert found["ms"] == times[-1] - times[0]
    few = {"Acceptance": 1, "Prescription": 1, "Fin": 1, "Cancel": 2, "Intention": 3}
    assert found["count"] == few | {"Ack": 8, "Advertisement": 21}
    assert found["cancelled"] == [2, 4] and found["finished"]
    assert found["cams"]["count"] == pytest.approx(4 * found["ms"] / 100, abs=4)
    whole = sum(found["bytes"]["sent"]["uper"].values())
    assert whole == sum(each["uper"] for each in found["by_station"].values())
    offers = [offer.forms["sent"]["uper"] for offer in four.offers]
    vehicles_s = 4 * found["ms"] / 1000
    rate = found["always"]["sent"]["uper"] / vehicles_s
    assert 10 * min(offers) <= rate <= 10 * max(offers)
    assert found["busiest"]["count"] == len(
        [s for s in four.air.sent if s.type != "CAM" and 1000 <= s.ms < 1500]
    )
    with pytest.raises(ExperimentError, match="station 9 sent nothing"):
        session(four, 9)


def test_each_station_sends_its_certificate_once_a_second() -> None:
    sent = [Sent(ms, src, "Ack", 1, {}) for ms, src in ((0, 1), (5, 2), (999, 1), (1000, 1))]
    assert certificates(sent) == 3
    assert certificates([*sent, Sent(1999, 1, "Ack", 1, {}), Sent(2000, 1, "Ack", 1, {})]) == 4
