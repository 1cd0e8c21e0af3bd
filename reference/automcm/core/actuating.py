"""Actuating: ACT-2 … ACT-5.  (ACT-1 is up to the application.)"""

from __future__ import annotations

from automcm.core.outcome import (
    Me,
    Outcome,
    Received,
    Row,
    ack,
    acked,
    always,
    foreign,
    ignore,
    leave,
    leave_with,
    own,
    refuse,
    stale,
)
from automcm.core.state import State, Timer
from automcm_spec.vocabulary.application import Complete, Finished
from automcm_spec.vocabulary.messages import Cam, Fin


def cam_counts(me: Me, st: State, i: Cam) -> bool:
    """ACT-5: is the CAM marked with this session, and newer than the last one that counted?"""
    return (
        st.phase == "ACTUATING"
        and i.src == st.peer
        and st.session in i.marks
        and (st.heard_ms is None or i.generation_ms > st.heard_ms)
    )


def count_cam(me: Me, st: State, i: Cam) -> Outcome:
    """ACT-5: the CAM counts, and the cam timer restarts."""
    return Outcome(st._replace(heard_ms=i.generation_ms), again=(Timer("cam"),))


CAM: tuple[Row[Cam], ...] = (Row("ACT-5", cam_counts, count_cam), Row("ACT-5", always, ignore))


def complete(me: Me, st: State, i: Complete) -> Outcome:
    """ACT-3: the prescriber leaves, and sends Fin until it is acked."""
    fin = Fin(src=me.station_id, dst=st.target, session=own(st), seq=st.seq + 1)
    return leave_with(st, [fin])


COMPLETE: tuple[Row[Complete], ...] = (
    Row(
        "CMD-1",
        lambda me, st, i: not (st.phase == "ACTUATING" and st.role == "prescriber"),
        refuse,
    ),
    Row("PRE-5", stale, refuse),
    Row("ACT-3", always, complete),
)


def from_own_prescriber(me: Me, st: State, i: Received[Fin]) -> bool:
    """ACT-3: does the Fin come from this receiver's prescriber and belong to its session?"""
    m = i.message
    return not foreign(me, st, i) and st.role == "receiver" and m.src == m.session[0]


def finished(me: Me, st: State, i: Received[Fin]) -> Outcome:
    """ACT-3: the receiver acks the Fin and leaves the session."""
    return Outcome(leave(st), (ack(me, i.message),), Finished(session=own(st)))


FIN: tuple[Row[Received[Fin]], ...] = (
    Row("ACT-3", from_own_prescriber, finished),
    Row("END-3", always, acked),
)
