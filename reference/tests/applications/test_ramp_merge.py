"""The merge from a ramp on the unchanged service."""

from __future__ import annotations

from itertools import pairwise

import pytest
from road_stage import answers_of, driven, rows, said, stands

from automcm.applications.ramp_merge import Merge, Ramp
from automcm.applications.vehicle import Vehicle
from automcm.service.application import Advertised, Proposal
from automcm_simulation.road.drive import SimulatedDrive, arrival_s
from automcm_simulation.road.road import Sample
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Verify

# -- two other applications on the same service


def ramp_and_road(x: float, **ramp: float) -> tuple[Merge, Merge]:
    """One on the ramp at 0 m, one in the lane it joins at ``x``."""
    joins = Ramp(**ramp)  # type: ignore[arg-type]
    return Merge(Vehicle(1, 0, 0, 10, 10), joins), Merge(Vehicle(2, x, 1, 10, 10), joins)


def test_merge_the_first_in_conflict_lets_the_ramp_in() -> None:
    ramp = Ramp(joins_m=120)
    on_ramp = Merge(Vehicle(1, 0, 0, 10, 10), ramp)
    ahead, abreast = Merge(Vehicle(2, 60, 1, 10, 10), ramp), Merge(Vehicle(3, -5, 1, 10, 10), ramp)
    drive = driven(on_ramp.signal, on_ramp, ahead, abreast)
    assert on_ramp.vehicle.lane == 1 and not on_ramp.vehicle.changing
    assert said(on_ramp)[-1] == "has changed lanes"
    assert said(ahead) == ["drives alone: not_selected"] and said(abreast)[-1] == "is done"
    assert 5 < min(sample.speed for sample in drive.road.of(3)) < 9.5
    at = {n: arrival_s(drive.road.of(n), ramp.joins_m) for n in (1, 2, 3)}
    assert at[1] is not None and at[2] is not None and at[3] is not None
    assert at[2] < at[1] and at[3] - at[1] > ramp.apart_s * 0.75
    assert abreast.vehicle.speed == pytest.approx(10, abs=1)


def test_merge_without_an_agreement_it_stops_before_the_end_of_the_ramp() -> None:
    for cut_ms in (3000, 50):
        on_ramp, other = ramp_and_road(-1, joins_m=120)
        drive = SimulatedDrive([on_ramp, other])
        drive.simulation.clock.at(100, on_ramp.signal)
        drive.simulation.clock.at(
            cut_ms, lambda drive=drive: drive.simulation.radio.partition([1], [2])
        )
        drive.run(60)
        assert said(on_ramp)[-1] in ("drives alone: cam_loss", "drives alone: no_participants")
        assert on_ramp.wanted is None and other.vehicle._profile is None
        stands(drive, on_ramp)


def test_merge_a_later_proposal_asks_for_less_and_never_to_come_earlier() -> None:
    on_ramp, other = ramp_and_road(-10, joins_m=150, slowest=0.999)
    drive = SimulatedDrive([on_ramp, other])
    asked: list[float] = []
    drive.simulation.services[2]._observers = (
        lambda before, effects: asked.extend(
            mean_speed(told.prescription.prescribed)
            for told in effects.indications
            if isinstance(told, Verify)
        ),
    )
    drive.simulation.clock.at(100, on_ramp.signal)
    drive.run(10)
    assert len(asked) == 3 and asked == sorted(asked) and asked[-1] < 10


def mean_speed(trajectory: messages.Trajectory) -> float:
    """m/s."""
    first, last = trajectory.points[0], trajectory.points[-1]
    return (last[1] - first[1]) / (last[0] - first[0])


def test_merge_nonsense_is_refused_and_crashes_nothing() -> None:
    _, other = ramp_and_road(0, joins_m=150)
    answers = answers_of(other)
    other.concerned(Advertised((1, 1), "merge", {"joins_mm": 150_000}, None))
    for prescribed in (
        rows((0, 10**15, 3500), (1000, 2 * 10**15, 3500)),
        rows((0, 0, 3500), (1000, 300_000_000, 3500)),
        rows((0, 0, 3500)),
        rows((5, 0, 3500), (1, 9000, 3500)),
    ):
        other.verify(Proposal((1, 1), 1, prescribed, 0, 1000))
    assert answers == ["refuse"] * 4 and other.vehicle._profile is None


def test_merge_without_conflict_needs_no_prescription() -> None:
    on_ramp, far = ramp_and_road(-90, joins_m=120)
    drive = driven(on_ramp.signal, on_ramp, far, until=25)
    assert said(far) == ["drives alone: not_needed"] and on_ramp.vehicle.lane == 1
    assert min(sample.speed for sample in drive.road.of(2)) > 9


def test_a_sample_between_two_steps() -> None:
    samples = [Sample(t, 1, x, 0, 1, 0) for t, x in ((0.0, 0.0), (1.0, 2.0), (2.0, 6.0))]
    assert arrival_s(samples, 4) == 1.5 and arrival_s(samples, 7) is None
    assert all(b.t > a.t for a, b in pairwise(samples))
