"""Actuating: ACT-2 … ACT-5.  (ACT-1 is up to the application.)"""

from __future__ import annotations

from automcm.core.outcome import (
    Me,
    Outcome,
    Received,
    ReceivedCam,
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
from automcm_spec.vocabulary.messages import Fin
from automcm_spec.vocabulary.parameters import cam_lead


def newer(me: Me, st: State, i: ReceivedCam) -> bool:
    """ACT-5: is the CAM newer than the last one that counted, and not too far ahead?"""
    if st.heard_ms is None or st.first_cam_ms is None:
        return True
    generated, received = st.first_cam_ms
    lead = cam_lead(me.clock_drift, me.t_resend, i.at_ms - received)
    return st.heard_ms < i.message.generation_ms <= generated + lead


def cam_counts(me: Me, st: State, i: ReceivedCam) -> bool:
    """ACT-5: is the CAM of the peer, newer, and marked with this session?"""
    m = i.message
    return (
        st.phase == "ACTUATING" and m.src == st.peer and st.session in m.marks and newer(me, st, i)
    )


def count_cam(me: Me, st: State, i: ReceivedCam) -> Outcome:
    """ACT-5: the CAM counts, and the cam timer restarts."""
    generated = i.message.generation_ms
    first = st.first_cam_ms or (generated, i.at_ms)
    counted = st._replace(heard_ms=generated, first_cam_ms=first)
    return Outcome(counted, again=(Timer("cam"),))


CAM: tuple[Row[ReceivedCam], ...] = (
    Row("ACT-5", cam_counts, count_cam),
    Row("ACT-5", always, ignore),
)


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
