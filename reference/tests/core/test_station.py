"""One station: what the graph leaves out. Message numbers, content, durations, malformed bytes.

``make verify`` gives each input of the graph to each of its states.
"""

from __future__ import annotations

from typing import Any

import pytest
from automcm_stage import (
    ME,
    OTHER,
    OWN,
    PLANNED,
    PRESCRIBER,
    TARGET,
    THEIRS,
    Stage,
    ack,
    advertisement,
    cam,
    cancel,
    fin,
    intention,
    no,
    prescription,
    sent,
    told,
    yes,
)

from automcm_spec.vocabulary.messages import Trajectory, encode

# -- seq


def test_new_content_takes_a_new_seq_and_copies_are_identical() -> None:
    s = Stage()
    effects = s.do(0, "request")
    s.hear(0, intention(TARGET))
    s.hear(0, intention(OTHER))
    effects += s.run(2100)
    effects += s.do(2150, "prescribe", OWN) + s.run(2400)
    effects += s.hear(2400, no())
    effects += s.do(2450, "prescribe", OWN, proposal=2) + s.run(2700)
    effects += s.hear(2700, yes(2))
    effects += s.do(2800, "complete", OWN) + s.run(3000)
    numbered: dict[int, list[Any]] = {}
    for m in sent(effects):
        if m.seq:
            numbered.setdefault(m.seq, []).append(m)
    assert [(seq, copies[0].type) for seq, copies in sorted(numbered.items())] == [
        (1, "Advertisement"),
        (2, "Prescription"),
        (3, "Cancel"),
        (4, "Prescription"),
        (5, "Fin"),
    ]
    for copies in numbered.values():
        assert len(copies) > 1
        assert all(copy is copies[0] for copy in copies)


def test_each_session_counts_its_seq_from_1() -> None:
    s = Stage(backoff_min=0, backoff_max=0)
    s.do(0, "request")
    s.run(2100)
    (again,) = sent(s.do(2200, "request"))
    assert (again.session, again.seq) == ((ME, 2), 1)
    s.restart(2300)
    (again,) = sent(s.do(10_000, "request"))
    assert (again.session, again.seq) == ((ME, 3), 1)


def test_adv_5_a_copy_is_answered_with_the_fin_in_the_outbox() -> None:
    s = Stage().walk("prescriber", "ACTUATING")
    (last,) = sent(s.do(2250, "complete", OWN), "Fin")
    assert sent(s.hear(2260, yes()) + s.hear(2260, intention())) == [last] * 2


# -- what the application gets


def test_act_1_one_trajectory_is_handed_over_and_kept() -> None:
    """The receiver drives what its verifier selected, and the prescriber is told that one."""
    selected = Trajectory(t0=30, points=((0, 1, 2), (1000, 2778, 3)))
    r = Stage(station_id=TARGET)
    r.hear(0, advertisement(OWN))
    r.hear(20, prescription(1, OWN, dst=TARGET))
    (acceptance,) = sent(r.do(30, "accept", OWN, selected=selected), "Acceptance")
    assert (acceptance.selected, r.at) == (selected, ("receiver", "ACTUATING"))

    # Whatever comes while it acts, no trajectory is handed over; the Acceptance stays the same.
    acting = r.hear(40, prescription(1, OWN, dst=TARGET, prescribed=PLANNED))
    acting += r.hear(50, prescription(2, OWN, dst=TARGET, prescribed=PLANNED))
    acting += r.hear(60, prescription(1, THEIRS, dst=TARGET, prescribed=PLANNED))
    acting += r.hear(70, advertisement(THEIRS))
    acting += r.hear(80, cam(ME, 80, OWN))
    acting += r.do(90, "accept", OWN, selected=PLANNED)
    acting += r.run(1000)
    assert r.at == ("receiver", "ACTUATING")
    assert [i.name for i in told(acting)] == ["discarded", "refused"]
    copies = [m for m in sent(acting, "Acceptance") if m.seq]
    assert len(copies) == 9 and all(copy is acceptance for copy in copies)
    assert r.state.outbox == (acceptance,)

    p = Stage().walk("prescriber", "CHOOSING")
    p.do(2150, "prescribe", OWN)
    (accepted,) = told(p.hear(2250, acceptance))
    assert accepted.acceptance == acceptance
    later = p.hear(2260, acceptance)
    later += p.hear(2270, acceptance.model_copy(update={"seq": 9, "selected": PLANNED}))
    later += p.hear(2280, prescription(1, THEIRS, prescribed=PLANNED))
    later += p.do(3000, "complete", OWN) + p.hear(3100, acceptance)
    assert told(later) == []


RUBBISH = {
    "nothing": b"",
    "text": b"hello",
    "binary": bytes(range(256)),
    "not an object": b"[1, 2, 3]",
    "cut off": encode(fin())[:-4],
    "two at once": encode(fin()) * 2,
    "unknown type": encode(fin()).replace(b"Fin", b"Fon"),
    "missing field": encode(prescription(2)).replace(b'"proposal":2,', b""),
    "extra field": encode(fin()).replace(b'"v":1', b'"v":1,"w":1'),
    "wrong type": encode(fin()).replace(b'"seq":7', b'"seq":"7"'),
    "float": encode(fin()).replace(b'"seq":7', b'"seq":7.0'),
    "null": encode(fin()).replace(b'"seq":7', b'"seq":null'),
    "another version": encode(fin()).replace(b'"v":1', b'"v":2'),
    "dst 0": encode(fin()).replace(b'"dst":1', b'"dst":0'),
    "seq 0": encode(fin()).replace(b'"seq":7', b'"seq":0'),
    "answer with a seq": encode(cancel("closed")).replace(b'"seq":0', b'"seq":1'),
    "no reason": encode(no()).replace(b',"reason":"unsafe"', b""),
    "no points": encode(intention()).replace(b"[[0,0,0],[1000,8333,0]]", b"[]"),
    "huge": b"{" * 1_000_000,
    "a bad cam": encode(cam(PRESCRIBER, 900, THEIRS)).replace(b"[[9,1]]", b"[[9]]"),
}


def test_end_5_malformed_bytes() -> None:
    """Each kind of rubbish, in each phase: reported, and nothing else happens."""
    good = {encode(m) for m in (fin(), prescription(2), cancel("closed"), no(), intention())}
    assert not good & set(RUBBISH.values())
    for role, phase in Stage.PHASES:
        s = Stage().walk(role, phase)
        state, timers = s.state, list(s.station.timers.items())
        for what, data in RUBBISH.items():
            (only,) = s.hear(s.now, data)
            assert (only.input, only.rule) == (None, "END-5"), what
            assert (only.messages, only.armed, only.stopped) == ((), (), ()), what
            (discarded,) = only.indications
            assert discarded.name == "discarded", what
            assert ": " in discarded.detail, what
            assert s.state is state, what
            assert list(s.station.timers.items()) == timers, what


# -- what the graph that is compared here is too small for; the stage compares


def test_end_6_neg_6_of_another_station_or_proposal() -> None:
    for role, phase in Stage.PHASES:
        s = Stage().walk(role, phase)
        for entry in s.state.outbox:
            s.hear(s.now, ack(entry, src=7))
        for answer in (yes(2), no(2), yes(2, OTHER), no(2, src=OTHER)):
            s.hear(s.now, answer)
        assert s.at == (role, phase)
    s = Stage().walk("prescriber", "NEGOTIATING")
    s.hear(2250, no())
    s.do(2260, "prescribe", OWN, proposal=2)
    assert {s.hear(2270, late())[0].rule for late in (no, yes)} == {"NEG-6"}


def test_mem_1_participants() -> None:
    """A withdrawn station counts on, and one whose Cancel overtakes its Intention."""
    s = Stage(max_participants=2).walk("prescriber", "ADVERTISING")
    joining = [intention(2), intention(3), intention(4), intention(2)]
    leaving = [cancel(src=2, session=OWN), intention(4), cancel(src=4, session=OWN)]
    rules = [s.hear(10, message)[0].rule for message in joining + leaving]
    assert rules == ["ADV-5", "ADV-5", "MEM-1", "ADV-5", "END-2", "MEM-1", "END-3"]


def test_mem_1_a_session_needs_room_in_the_outbox() -> None:
    s = Stage(max_participants=2, outbox_limit=4).walk("receiver", "WAITING")
    s.do(100, "abort", THEIRS)
    (request,) = s.do(150, "request")
    (join,) = s.hear(150, advertisement((8, 1)))
    assert (request.rule, join.rule) == ("MEM-1", "MEM-1")


# -- durations


@pytest.mark.parametrize("cams", [False, True])
@pytest.mark.parametrize("place", Stage.PHASES, ids=" ".join)
def test_l_1_every_timer_of_every_phase(place: tuple[str, str], cams: bool) -> None:
    """Left alone, or with the CAMs of its peer, a station ends all that it has begun: ADV-2,
    ADV-6, ADV-7, ADV-8, PRE-1, PRE-4, PRE-5, NEG-3, NEG-8, NEG-9, ACT-2, ACT-4, END-7, END-8."""
    s = Stage().walk(*place)
    for now in range(s.now + 1000, 40_000, 1000):
        s.run(now)
        if cams:
            for src, session in ((TARGET, OWN), (PRESCRIBER, THEIRS)):
                s.hear(now, cam(src, now, session))
    assert s.at == ("none", "STANDALONE") and not s.station.timers
