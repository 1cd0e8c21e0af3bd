"""Why a log diverges: asked of stations that are led through a session, and of logs."""

from __future__ import annotations

import re

import pytest

from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.messages import Ack, Fin, MessageId
from automcm_spec.vocabulary.station import Command, Expire, Input, Message, Receive, State, Station
from automcm_traces.checker import divergence
from automcm_traces.checker.divergence import Action, Question
from automcm_traces.checker.input_alphabet import alphabet
from automcm_traces.checker.track import DEFAULT_LIMITS, OutboxEntry, Track

ME, PEER, OTHER = 4711, 815, 1616
OWN, THEIRS = (ME, 1), (PEER, 7)
STATION = Station(*DEFAULT_LIMITS)
LINES = (TLA / "Station.tla").read_text().splitlines()
NAMED = ["advertise", "decide", "hold", "answer", "cam", "lease", "quarantine", "backoff"]


def heard(message: Message) -> Receive:
    return Receive("receive", message, True)


def ack(session: tuple[int, int], type_: str) -> Receive:
    return heard(STATION.message("Ack", PEER, ME, session, 0)._replace(of=(type_, 1)))


def command(name: str, session: tuple[int, int] = (0, 0), k: int = 0, target: int = 0) -> Command:
    return Command("command", name, session, k, target)


ADVERTISEMENT = heard(STATION.advertisement(PEER, THEIRS))
FIN = heard(STATION.fin(PEER, ME, THEIRS))
PRESCRIBER: list[Input] = [
    command("request"),
    heard(STATION.intention(PEER, OWN)),
    Expire("expire", ("advertise",)),
    command("prescribe", OWN, 1, PEER),
    ack(OWN, "Prescription"),
    heard(STATION.acceptance(PEER, OWN, 1)),
    command("complete", OWN),
    ack(OWN, "Fin"),
]
RECEIVER: list[Input] = [
    ADVERTISEMENT,
    ack(THEIRS, "Intention"),
    heard(STATION.prescription(PEER, ME, THEIRS, 1)),
    command("accept", THEIRS, 1),
    ack(THEIRS, "Acceptance"),
    FIN,
]


def led(inputs: list[Input], seq: int = 1) -> Track:
    """A station after these inputs; ``seq`` is that of what it still sends."""
    st = STATION.initial
    for i in inputs:
        st = STATION.step(ME, st, i).st
    return track(st, seq)


def track(st: State, seq: int = 1) -> Track:
    posted = [OutboxEntry(e, Fin(src=ME, session=e.session, seq=seq)) for e in st.outbox]
    return Track(ME, state=st, outbox=posted)


def guards(said: str) -> list[tuple[str, bool]]:
    """The guards that are named and whether they must hold; each stands in its line."""
    form = r"by guard (.*?)(?: of \w+)?, which must (not )?hold.*?  Station\.tla:(\d+)"
    found = re.findall(form, said)
    for guard, _, line in found:
        assert guard in LINES[int(line) - 1]
    return [(guard, not negated) for guard, negated, _ in found]


def nearest(inputs: list[Input], i: Input, *wanted: str) -> str:
    return Question(led(inputs)).nearest(i, wanted)


# -- the guard in the way


def test_adv_4_every_guard_in_the_way_is_named_with_its_values() -> None:
    said = nearest(RECEIVER[:2], ADVERTISEMENT, "send", "Intention")
    assert said.startswith("nearest allowed: ADV-3 send Intention (OnAdvertisement) blocked by")
    assert guards(said) == [("Bound(st)", False), ("NewerThanJoined(st, m.session)", True)]
    assert "st.phase = WAITING" in said  # what is inside of Bound
    assert "m.session = 815/7, st.joined = {815/7}" in said


def test_adv_3_what_is_missing_and_not_for_want_of_memory() -> None:
    """Of six guards that would do, the last one that is not MEM-1's."""
    said = nearest([], ADVERTISEMENT, "without", "send", "Intention")
    assert "ADV-3" in said and guards(said) == [("concerned", False)]


def test_what_the_input_does_anyway_or_never() -> None:
    said = nearest([], ADVERTISEMENT, "send", "Intention")
    assert said.endswith(
        "ADV-3 send Intention (OnAdvertisement), but not in this form, or not again"
    )
    assert nearest([], ADVERTISEMENT, "send", "Fin") == ""


@pytest.mark.parametrize(
    ("wanted", "named"),
    [
        (("send", "Acceptance", "refused", "busy"), [("In(st, m.session)", False)]),
        (("indication", "verify"), [("OlderOrSame(m.proposal, st.proposal)", False)]),
        (("arm", "decide"), [("OlderOrSame(m.proposal, st.proposal)", False)]),
        (("phase", "NEGOTIATING"), [("OlderOrSame(m.proposal, st.proposal)", False)]),
    ],
)
def test_neg_1_messages_indications_timers_and_phases(
    wanted: Action, named: list[tuple[str, bool]]
) -> None:
    again = RECEIVER[2]
    refused = [*RECEIVER[:3], command("refuse", THEIRS, 1)]
    assert guards(nearest(refused, again, *wanted)) == named


def test_rel_1_a_copy_may_have_any_reason() -> None:
    sending = [*RECEIVER[:2], command("abort", THEIRS)]
    (entry,) = led(sending).state.outbox
    assert nearest(sending, Expire("expire", ("resend", entry)), "send", "Cancel", "abort")


def test_end_6_an_ack_is_shown_as_the_log_has_it() -> None:
    """With the seq on the wire, as what it did not match."""
    gone = led(PRESCRIBER[:7], seq=5)
    given = Ack(src=PEER, dst=ME, session=OWN, of=MessageId(type="Fin", seq=5))
    said = Question(gone, given).nearest(ack(OWN, "Fin"), ("without", "stop"))
    assert guards(said) == [("acked = {}", True)]
    assert "acked = {Fin to 815 session=4711/1 seq=5}" in said and "m.of = Fin seq=5" in said


# -- timers that are not armed


def test_why_a_timer_is_not_armed_and_in_which_phases_it_is() -> None:
    tried = set()
    for inputs in (PRESCRIBER, RECEIVER):
        for n in range(len(inputs)):
            station = led(inputs[:n])
            question, armed = Question(station), STATION.armed(ME, station.state)
            for name in NAMED:
                said, phases = question.unarmed((name,)), question.arms((name,))
                assert bool(guards(said)) != ((name,) in armed)
                assert (station.state.phase in phases) >= ((name,) in armed)
                tried.add((name, (name,) in armed))
    assert {name for name, armed in tried if armed} >= set(NAMED[:2] + NAMED[3:6])
    said = Question(led(RECEIVER[:2])).unarmed(("lease",))
    assert said.startswith(
        "nearest allowed: expire lease (OnExpiry) blocked by guard LeaseRuns(st)"
    )
    assert Question(led(RECEIVER[:2])).arms(("hold",)) == ["WAITING"]
    assert guards(Question(led(RECEIVER[:2])).unarmed(("forget", PEER))) == [
        ("x # st.session", True)
    ]


# -- what else would have led to it


@pytest.mark.parametrize("inputs", [PRESCRIBER, RECEIVER])
def test_an_input_is_among_the_causes_of_what_it_does(inputs: list[Input]) -> None:
    for n, i in enumerate(inputs):
        station = led(inputs[:n])
        outcome = STATION.step(ME, station.state, i)
        near = sorted(alphabet(station, {PEER}), key=divergence._order)
        for done in divergence._done(outcome):
            if done[0] in ("phase", "role"):
                continue
            dst = 0 if done[1] == "Advertisement" else PEER
            assert divergence._input(i) in Question(station).causes(near, done, dst), (done, i)


def test_causes_come_from_the_station_that_a_message_is_for() -> None:
    station = led(RECEIVER[:5])
    near = sorted(alphabet(station, {OTHER}), key=divergence._order)
    found = Question(station).causes(near, ("send", "Ack"), OTHER)
    assert found and all(str(OTHER) in cause for cause in found)
    assert Question(station).causes(near, ("indication", "finished"), 0) == (
        f"receive Fin from {PEER}",
    )


def test_end_5_a_message_that_breaks_the_protocol_is_not_called_nearest() -> None:
    station = led(PRESCRIBER[:3])
    near = sorted(alphabet(station, ()), key=divergence._order)
    said = Question(station).elsewhere(near, ("indication", "verify"))
    assert "receive Prescription" in said
    assert [guard for guard, _ in guards(said)] == [
        "In(st, m.session)",
        'st.phase \\in {"INTENDING", "WAITING"}',
    ]
