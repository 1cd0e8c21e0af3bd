"""Part of a log as a log: what it keeps together, and how its gaps are closed."""

from __future__ import annotations

from pathlib import Path

from automcm_spec.log_format.log import TimerArm
from automcm_traces.edit.log_slice import LogSlice

CORPUS = Path(__file__).parents[2] / "corpus"
PRESCRIBER, RECEIVER = CORPUS / "pair/1001.ndjson", CORPUS / "pair/2002.ndjson"


def test_a_whole_log_is_as_it_was(tmp_path: Path) -> None:
    """With the vendor fields of each record."""
    path = tmp_path / "1001.ndjson"
    path.write_bytes(
        PRESCRIBER.read_bytes().replace(b"}\n", b',"x_at":{"by":"' + b"v" * 5000 + b'"}}\n')
    )
    log = LogSlice.read(path)
    assert log.text() == log.closed_up(log.items).text() == path.read_bytes()


def test_a_step_is_an_input_with_its_effects_and_a_cam_stands_alone() -> None:
    log = LogSlice.read(RECEIVER)
    steps = [[item.line for item in step] for step in log.steps()]
    assert [3, 4, 5, 6] in steps  # Advertisement, Intention, two timers
    assert sorted(line for step in steps for line in step) == [i.line for i in log.items]
    cams = [i.line for i in log.items if i.event.ev == "send" and "CAM" in str(i.record)]
    assert all([line] in steps for line in cams)


def test_later_events_come_earlier_but_an_expiry_when_it_is_due() -> None:
    """PRE-1: the window closes when its timer says so, whatever is left out before."""
    log = LogSlice.read(PRESCRIBER)
    window = next(i for i in log.items if i.record.get("timer") == {"name": "advertise"}
                  and isinstance(i.event, TimerArm))  # fmt: skip
    assert isinstance(window.event, TimerArm)
    close = next(i for i in log.items if i.record.get("timer") == {"name": "advertise"}
                 and i.record["op"] == "expire")  # fmt: skip
    left = [i for i in log.items if not window.line < i.line < close.line]
    closed = {i.line: i.event.t_ms for i in log.closed_up(left).items}
    assert closed[close.line] == window.event.deadline == close.event.t_ms
    # What waits for no timer follows as soon after what is before it as it did.
    end = log.items[-1]
    left = [i for i in log.items if i.line not in range(close.line + 10, close.line + 20)]
    closed = {i.line: i.event.t_ms for i in log.closed_up(left).items}
    assert list(closed.values()) == sorted(closed.values())
    assert closed[close.line] == close.event.t_ms
    assert closed[end.line] < end.event.t_ms


def test_a_timer_still_runs_as_long_as_it_did() -> None:
    log = LogSlice.read(RECEIVER)
    left = [i for i in log.items if i.line > 40]
    closed = log.closed_up(left)
    was = {i.line: i.event.deadline - i.event.t_ms for i in left if isinstance(i.event, TimerArm)}
    arms = [i for i in closed.items if isinstance(i.event, TimerArm)]
    assert {i.line: i.event.deadline - i.event.t_ms for i in arms} == was  # type: ignore[union-attr]
