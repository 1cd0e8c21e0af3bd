"""Bytes on the air: their count, and the claims about them."""

from __future__ import annotations

import pytest
from automcm_stage import prescription

from automcm.encoding.codec import JSON, CodecError, codec
from automcm_evaluation.bandwidth import bandwidth, bandwidth_air
from automcm_evaluation.bandwidth.bandwidth_air import (
    BIN_MS,
    Recorded,
    RecordingCodec,
    Sent,
    certificates,
    column,
    in_forms,
    measured,
    offered,
    on_air,
    over_time,
    record,
    session,
)
from automcm_evaluation.framework.experiment import ExperimentError
from automcm_simulation.road.drive import FourVehicles
from automcm_spec.vocabulary.messages import (
    Ack,
    Advertisement,
    Cam,
    Cancel,
    MessageId,
    Prescription,
    Trajectory,
)
from automcm_spec.vocabulary.parameters import Parameters

EXPERIMENT = bandwidth.EXPERIMENT


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


def test_prescribers_stand_beside_the_receivers_named() -> None:
    vehicles = [driver.vehicle for driver in column(6, [4, 1], gap_m=60)]
    assert [v.station_id for v in vehicles] == list(range(1, 9))
    assert [v.lane for v in vehicles] == [0] * 2 + [1] * 6
    receivers = [v.x for v in vehicles[2:]]
    assert receivers == sorted(receivers, reverse=True)
    assert vehicles[0].x == receivers[4] + 3 == 0
    assert vehicles[1].x == receivers[1] + 3 == 180


def test_all_that_services_send_is_noted(four: Recorded) -> None:
    """As many of each type as the services count, CAMs, Acks and copies among them."""
    for station, service in four.drive.simulation.services.items():
        for kind, number in service.statistics.sent.items():
            noted = [s for s in four.air.sent if (s.src, s.type) == (station, kind)]
            assert len(noted) == number, (station, kind)
    times = [sent.ms for sent in four.air.sent]
    assert times == sorted(times) and times[-1] > 15_000
    messages = [s for s in four.air.sent if s.type != "CAM"]
    assert sorted((s.ms, s.src, s.type) for s in messages) == sorted(four.drive.sent)


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
        assert measured(message) == tuple(len(codec(n).encode(message)) for n in ("json", "uper"))


def test_other_trajectories_take_the_place_of_its_own() -> None:
    sent = Advertisement(
        src=1, session=(1, 1), seq=1, scenario="s", details={}, planned=trajectory()
    )
    more, none = on_air(sent, 52), on_air(sent, 52, lean=True)
    assert isinstance(more, Advertisement) and more.planned is not None
    assert len(more.planned.points) == 52
    assert isinstance(none, Advertisement) and none.planned is None
    lean = on_air(offered(1, trajectory()), 52, lean=True)
    assert len(JSON.encode(lean)) > 1000, "an Intention without a trajectory is none"
    ack = Ack(src=1, dst=2, session=(1, 1), of=MessageId(type="Fin", seq=1))
    assert on_air(ack, 52) == on_air(ack)


def test_a_codec_that_notes_changes_nothing() -> None:
    air = RecordingCodec(now=lambda: 12)
    sent = Cancel(src=1, dst=2, session=(1, 1), seq=1, reason="not_selected")
    assert air.decode(air.encode(sent)) == sent
    (noted,) = air.sent
    assert noted == Sent(12, 1, "Cancel", 1, in_forms(sent), cancelled=2)


def test_bins_hold_every_byte(four: Recorded) -> None:
    time = over_time(four)
    last = len(time["json"]["CAM"]) * BIN_MS
    for kind in ("CAM", "Intention", "Ack", "Fin"):
        noted = [s for s in four.air.sent if s.type == kind and s.ms < last]
        for n, name in enumerate(("json", "uper")):
            assert sum(time[name][kind]) == sum(s.forms["sent"][n] for s in noted)
    (fin,) = (s for s in four.air.sent if s.type == "Fin")
    assert time["json"]["Fin"][fin.ms // BIN_MS] == fin.forms["sent"].json
    each = [offer.forms["sent"].json for offer in four.offers[:4]]
    assert time["json"]["always-on"][0] == 5 * sum(each), "four vehicles at 10 Hz"


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
    offers = [offer.forms["sent"].uper for offer in four.offers]
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


def test_cams_at_2_hz_change_no_message() -> None:
    """What drives with many vehicles rely on."""
    often, seldom = (record(3, [1], seed=3, parameters=Parameters(t_cam=ms)) for ms in (100, 500))
    assert session(often, 1)["bytes"] == session(seldom, 1)["bytes"]
    cams = [len([s for s in r.air.sent if s.type == "CAM"]) for r in (often, seldom)]
    assert cams[0] == pytest.approx(5 * cams[1], abs=16)


def test_receivers_beyond_max_participants_repeat_their_intention() -> None:
    few = Parameters(t_cam=500, max_participants=2)
    found = session(record(3, [1], seed=3, parameters=few), 1)
    assert found["count"]["Intention"] == 2 + 21


def test_loss_adds_copies() -> None:
    lossy = session(record(1, [0], seed=1, loss=0.4), 1)
    assert lossy["count"]["Intention"] + lossy["count"]["Acceptance"] > 2
    assert lossy["count"]["Advertisement"] == 21


def test_without_the_extra_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise CodecError("the codec uper needs asn1tools: pip install 'automcm[asn1]'")

    monkeypatch.setattr(bandwidth_air, "codec", missing)
    with pytest.raises(ExperimentError, match=r"bandwidth: .*automcm\[asn1\]"):
        bandwidth.run({"part": "sizes"}, 1)


# -- the sweep


def test_blocks_hold_all_trials() -> None:
    made = EXPERIMENT.cells(EXPERIMENT.set("standard", {"trials": 12, "vehicles": [33, 34]}))
    lossy = [c for c in made if c.get("loss") == 0.2 and c["vehicles"] == 4]
    assert [c["trials"] for c in lossy] == [5, 5, 2]
    many = [(c["vehicles"], c["participants"]) for c in made if c["part"] == "many"]
    assert many == [(33, 32), (34, 32), (34, 33)]
