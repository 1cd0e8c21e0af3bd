"""Each comparison with the compiled station: a wrong effect, and how it is reported."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import stateful_oracle
from automcm_stage import ME, SLOWER, THEIRS, Stage, advertisement, cam, cancel, prescription
from stateful import Coordination, profile, run
from stateful_oracle import Broken, Setup
from stateful_world import World

from automcm.core.state import Timer
from automcm.core.station import Effects
from automcm_maintenance.verify.spec_mapping import abstract, concrete
from automcm_spec.vocabulary.application import Fallback

Change = Callable[[Effects], Effects]


class Compared(Stage):
    """A stage that compares only when it is asked to.  ``change`` replaces the last effects."""

    def __init__(self) -> None:
        super().__init__(max_rounds=1, max_participants=1, outbox_limit=2)

    def took(self, effects: list[Effects]) -> list[Effects]:
        return effects

    def compare(self, effects: list[Effects], change: Change = lambda e: e) -> None:
        super().took([*effects[:-1], change(effects[-1])])

    def join(self) -> None:
        self.compare(self.hear(0, advertisement()))

    def act(self) -> None:
        self.join()
        self.compare(self.hear(20, prescription()))
        self.compare(self.do(30, "accept", THEIRS))


def _replaced(**fields: Any) -> Change:
    return lambda e: e._replace(**fields)


def _sent(**fields: Any) -> Change:
    return lambda e: e._replace(messages=(e.messages[0].model_copy(update=fields),))


def _later(e: Effects) -> Effects:
    return e._replace(armed=tuple((timer, deadline + 1) for timer, deadline in e.armed))


TIMEOUT = Fallback(session=THEIRS, reason="timeout")
JOINED: dict[str, tuple[Change, str]] = {
    "another rule": (_replaced(rule="ADV-4"), "oracle ADV-3"),
    "another state": (
        lambda e: e._replace(state=e.state._replace(phase="WAITING")),
        "oracle ADV-3",
    ),
    "an indication": (_replaced(indications=(TIMEOUT,)), "oracle ADV-3"),
    "no message": (_replaced(messages=()), "oracle ADV-3"),
    "a timer is not armed": (lambda e: e._replace(armed=e.armed[1:]), "oracle ADV-3"),
    "a timer is stopped": (_replaced(stopped=(Timer("backoff"),)), "oracle ADV-3"),
    "seq leaves one out": (_sent(seq=2), "oracle content"),
    "another trajectory": (_sent(planned=SLOWER), "oracle content"),
    "a timer lasts longer": (_later, "oracle timers"),
}


@pytest.mark.parametrize("name", JOINED)
def test_a_wrong_effect_of_joining(name: str) -> None:
    change, what = JOINED[name]
    stage = Compared()
    with pytest.raises(Broken) as found:
        stage.compare(stage.hear(0, advertisement()), change)
    assert found.value.what == what


def test_the_reason_of_a_fallback_is_that_of_the_cancel() -> None:
    stage = Compared()
    stage.join()
    effects = stage.hear(20, cancel("abort"))
    with pytest.raises(Broken, match=r"oracle END-2.*told is"):
        stage.compare(effects, _replaced(indications=(TIMEOUT,)))


def test_a_cam_that_counts_is_remembered_by_its_generation_time() -> None:
    stage = Compared()
    stage.act()
    effects = stage.hear(40, cam(THEIRS[0], 35, THEIRS))
    with pytest.raises(Broken, match="heard at 34, not 35 ms"):
        stage.compare(effects, _replaced(state=stage.state._replace(heard_ms=34)))


def test_a_cam_that_is_heard_again_is_not_newer() -> None:
    stage = Compared()
    stage.act()
    stage.compare(stage.hear(40, cam(THEIRS[0], 35, THEIRS)))
    again = stage.hear(41, cam(THEIRS[0], 35, THEIRS))
    assert not again[0].armed
    stage.compare(again)


def test_marks_of_a_cam() -> None:
    stage = Compared()
    stage.join()
    stage.lockstep.sent_cam(cam(ME, 10, THEIRS))
    for marks in ((), (THEIRS, THEIRS), (THEIRS, (ME, 1))):
        with pytest.raises(Broken, match="oracle ACT-5"):
            stage.lockstep.sent_cam(cam(ME, 10, *marks))


@pytest.mark.parametrize("change", [_replaced(rule="END-4"), _replaced(indications=())])
def test_bytes_that_are_no_message(change: Change) -> None:
    stage = Compared()
    stage.compare(stage.hear(0, b"\xff"))
    with pytest.raises(Broken, match="oracle END-5"):
        stage.compare(stage.hear(0, b"\xff"), change)


def test_a_timer_that_expires_late() -> None:
    stage = Compared()
    stage.join()
    with pytest.raises(Broken, match="expires at 101, not at 100 ms"):
        stage.compare(stage.run(100), _replaced(now_ms=101))


def test_a_timer_that_does_not_expire() -> None:
    stage = Compared()
    stage.join()
    effects = stage.hear(20, prescription())
    with pytest.raises(Broken, match="101 ms: overdue"):
        stage.compare(effects, _replaced(now_ms=101))


def test_a_timer_that_runs_unseen() -> None:
    stage = Compared()
    stage.join()
    effects = stage.hear(20, prescription())
    stage.station.timers[Timer("backoff")] = 1
    with pytest.raises(Broken, match="oracle timers"):
        stage.compare(effects)


def test_a_lease_lasts_as_long_as_its_prescription_says() -> None:
    stage = Compared()
    stage.join()
    stage.compare(stage.hear(20, prescription(lease_ms=700)))
    effects = stage.do(30, "accept", THEIRS)
    armed = tuple((t, d + (t.name == "lease")) for t, d in effects[0].armed)
    with pytest.raises(Broken, match="lasts 701 ms, not 700 to 700 ms"):
        stage.compare(effects, _replaced(armed=armed))


@pytest.mark.slow
def test_a_machine_sets_up_2_to_12_stations_with_limits_that_bind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The map between the states is its own inverse on these ids, too."""
    states, stations = {}, set()

    def seen(state: Any) -> Any:
        value = abstract(state)
        states[repr(value)] = value
        return value

    class Counted(Coordination):
        def _world(self, setup: Setup) -> World:
            stations.add(setup.stations)
            return super()._world(setup)

    monkeypatch.setattr(stateful_oracle, "abstract", seen)
    met = run(Counted, profile(40, 20), 1)
    assert {2, 12} <= stations <= set(range(2, 13))
    assert met.inputs["MEM-1"] > 0
    assert len(states) > 200
    for value in states.values():
        assert abstract(concrete(value)) == value
