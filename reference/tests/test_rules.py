"""What changes nothing: END-5's list, other stations' messages, other sessions, commands."""

from __future__ import annotations

from typing import Any

import pytest
from automcm_stage import (
    ME,
    OTHER,
    PRESCRIBER,
    TARGET,
    Stage,
    ack,
    advertisement,
    cancel,
    fin,
    intention,
    no,
    prescription,
    sent,
    told,
    yes,
)

from automcm.outcome import Heard
from automcm.rules import decide
from automcm.station import Effects
from automcm_spec.application import Discarded, Refused

OWN = (ME, 6)
"""The stage's own session: five went before it."""
OLD = (ME, 2)
THEIRS = (PRESCRIBER, 1)
NOBODY = 0
PHASES = pytest.mark.parametrize(("role", "phase"), Stage.PHASES)


def at(role: str, phase: str) -> Stage:
    return Stage(number=5).walk(role, phase)


def changes_nothing(s: Stage, message: Any) -> Effects:
    """Hear it; state and timers stay the very same."""
    state, timers = s.state, list(s.station.timers.items())
    (only,) = s.hear(s.now, message)
    assert s.state == state
    assert list(s.station.timers.items()) == timers
    assert (only.armed, only.stopped) == ((), ())
    return only


def discarded(s: Stage, message: Any) -> None:
    only = changes_nothing(s, message)
    assert only.messages == ()
    assert (only.rule, only.indications) == ("END-5", (Discarded(detail=message.type),))


def broadcast(message: Any) -> Any:
    return message.model_copy(update={"dst": NOBODY})


# -- END-5, in whatever phase

BROKEN_ANYWHERE = {
    "Advertisement not from its prescriber": advertisement((8, 1), src=7),
    "Advertisement of my session": advertisement(OWN, src=7),
    "Prescription not from its prescriber": prescription(src=7),
    "Prescription of my session": prescription(session=OWN, src=7),
    "Intention of another's session": intention(session=THEIRS),
    "Acceptance of another's session": yes(session=THEIRS),
    "refusal of another's session": no(session=THEIRS),
    "answer of another's session": no(reason="busy", session=THEIRS),
    "Intention from my own id": intention(ME, OWN),
    "Acceptance from my own id": yes(src=ME, session=OWN),
    "addressed Advertisement": advertisement(dst=ME),
    "broadcast Intention": broadcast(intention(session=OWN)),
    "broadcast Prescription": broadcast(prescription()),
    "broadcast Acceptance": broadcast(yes(session=OWN)),
    "broadcast Fin": broadcast(fin()),
    "broadcast Cancel": broadcast(cancel()),
    "broadcast Ack": broadcast(ack(fin(dst=PRESCRIBER, src=ME))),
    "closed from a receiver of my session": cancel("closed", TARGET, OWN),
    "closed from a receiver of theirs": cancel("closed", OTHER, THEIRS),
}


@PHASES
@pytest.mark.parametrize("what", BROKEN_ANYWHERE)
def test_end_5_in_every_phase(role: str, phase: str, what: str) -> None:
    discarded(at(role, phase), BROKEN_ANYWHERE[what])


# -- END-5, where the session makes it so


@pytest.mark.parametrize(
    "phase", ["ADVERTISING", "CHOOSING", "PRESCRIBING", "NEGOTIATING", "ACTUATING"]
)
@pytest.mark.parametrize(
    "message",
    [
        yes(src=OTHER, session=OWN),
        no(src=OTHER, session=OWN),
        no(reason="busy", src=OTHER, session=OWN),
        yes(2, session=OWN),
        no(2, session=OWN),
    ],
    ids=["not the target", "a refusal", "busy", "not yet sent", "a refusal not yet due"],
)
def test_end_5_acceptance_from_another_or_too_early(phase: str, message: Any) -> None:
    discarded(at("prescriber", phase), message)


@pytest.mark.parametrize("phase", ["NEGOTIATING", "ACTUATING"])
def test_end_5_newer_proposal_out_of_turn(phase: str) -> None:
    discarded(at("receiver", phase), prescription(2))


def test_end_5_is_looked_at_before_end_3() -> None:
    s = Stage()
    assert s.hear(0, broadcast(fin()))[0].messages == ()
    assert [m.type for m in sent(s.hear(0, fin()))] == ["Ack"]


# -- to another station

TO_ANOTHER = [
    intention(dst=5, session=(5, 1)),
    intention(dst=5, session=OWN),
    prescription(dst=5),
    yes(dst=5, session=OWN),
    no(dst=5, session=OWN),
    fin(dst=5),
    cancel(dst=5),
    cancel("closed", dst=5),
    ack(fin(dst=PRESCRIBER, src=ME), dst=5),
    advertisement(dst=5),
]


@PHASES
def test_msg_1_a_message_to_another_station_is_dropped_silently(role: str, phase: str) -> None:
    s = at(role, phase)
    for message in TO_ANOTHER:
        only = changes_nothing(s, message)
        assert (only.rule, only.messages, only.indications) == ("MSG-1", (), ())


# -- of another session

BOUND = pytest.mark.parametrize(("role", "phase"), Stage.PHASES[1:])


def answers(only: Effects) -> list[tuple[Any, ...]]:
    return [(m.type, m.dst, m.session, m.seq, getattr(m, "reason", "")) for m in only.messages]


@BOUND
@pytest.mark.parametrize(
    ("message", "answer"),
    [
        (advertisement((8, 1)), []),
        (advertisement((PRESCRIBER, 2)), []),
        (intention(session=OLD), [("Cancel", TARGET, OLD, 0, "closed")]),
        (
            prescription(session=(PRESCRIBER, 2)),
            [("Acceptance", PRESCRIBER, (PRESCRIBER, 2), 0, "busy")],
        ),
        (prescription(session=(8, 1)), [("Acceptance", 8, (8, 1), 0, "busy")]),
        (yes(session=OLD), [("Cancel", TARGET, OLD, 0, "closed")]),
        (no(session=OLD), [("Ack", TARGET, OLD, 0, "")]),
        (no(reason="busy", session=OLD), []),
        (no(reason="unknown_session", session=OLD), []),
        (fin((PRESCRIBER, 2)), [("Ack", PRESCRIBER, (PRESCRIBER, 2), 0, "")]),
        (cancel(session=(PRESCRIBER, 2)), [("Ack", PRESCRIBER, (PRESCRIBER, 2), 0, "")]),
        (cancel(src=TARGET, session=OLD), [("Ack", TARGET, OLD, 0, "")]),
        (cancel("closed", session=(PRESCRIBER, 2)), []),
        (ack(fin(src=ME, dst=TARGET, session=OLD)), []),
        (ack(prescription(session=OLD, dst=TARGET)), []),
        (ack(intention(ME, (PRESCRIBER, 2), dst=PRESCRIBER)), []),
    ],
)
def test_end_4_a_message_of_another_session(
    role: str, phase: str, message: Any, answer: list[Any]
) -> None:
    only = changes_nothing(at(role, phase), message)
    assert answers(only) == answer
    assert only.indications == ()


@BOUND
def test_neg_4_busy_echoes_the_proposal(role: str, phase: str) -> None:
    (answer,) = changes_nothing(at(role, phase), prescription(3, (8, 4))).messages
    assert answer == no(3, "busy", ME, (8, 4), dst=8)


def test_neg_5_a_prescription_at_a_standalone_station() -> None:
    only = changes_nothing(Stage(), prescription(2, (8, 4)))
    assert (only.rule, only.messages) == ("NEG-5", (no(2, "unknown_session", ME, (8, 4), dst=8),))


# -- in the own session, but from another, or a second time


@BOUND
def test_end_3_fin_is_acked_and_only_a_receivers_prescriber_ends_a_session(
    role: str, phase: str
) -> None:
    s = at(role, phase)
    session = OWN if role == "prescriber" else THEIRS
    for src in (TARGET, OTHER, 7):
        only = changes_nothing(s, fin(session, src=src))
        assert answers(only) == [("Ack", src, session, 0, "")]
        assert only.indications == ()


@pytest.mark.parametrize("phase", ["INTENDING", "WAITING", "NEGOTIATING", "ACTUATING"])
def test_act_3_fin_from_the_prescriber_ends_every_receiver_phase(phase: str) -> None:
    s = at("receiver", phase)
    (only,) = s.hear(s.now, fin())
    assert answers(only) == [("Ack", PRESCRIBER, THEIRS, 0, "")]
    assert [i.name for i in only.indications] == ["finished"]
    assert s.state.outbox == () and s.at == ("none", "STANDALONE")


@pytest.mark.parametrize("phase", ["PRESCRIBING", "NEGOTIATING", "ACTUATING"])
def test_end_2_cancel_not_from_the_target_is_only_acked(phase: str) -> None:
    only = changes_nothing(at("prescriber", phase), cancel(src=OTHER, session=OWN))
    assert answers(only) == [("Ack", OTHER, OWN, 0, "")]


@pytest.mark.parametrize("phase", ["INTENDING", "WAITING", "NEGOTIATING", "ACTUATING"])
def test_end_2_cancel_not_from_the_prescriber_is_only_acked(phase: str) -> None:
    only = changes_nothing(at("receiver", phase), cancel(src=OTHER))
    assert answers(only) == [("Ack", OTHER, THEIRS, 0, "")]


@pytest.mark.parametrize(
    ("role", "phase"),
    [p for p in Stage.PHASES if p[1] in ("PRESCRIBING", "NEGOTIATING", "ACTUATING")]
    + [("receiver", "INTENDING"), ("receiver", "WAITING")],
)
def test_end_2_cancel_from_the_peer_ends_the_session(role: str, phase: str) -> None:
    s = at(role, phase)
    peer, session = (TARGET, OWN) if role == "prescriber" else (PRESCRIBER, THEIRS)
    (only,) = s.hear(s.now, cancel("cam_loss", peer, session))
    assert answers(only) == [("Ack", peer, session, 0, "")]
    assert [(i.name, i.reason) for i in only.indications] == [("fallback", "cam_loss")]
    assert s.at == ("none", "STANDALONE")


def test_end_2_a_withdrawn_station_stays_withdrawn() -> None:
    s = at("prescriber", "ADVERTISING")
    s.hear(10, cancel(src=TARGET, session=OWN))
    only = changes_nothing(s, intention(session=OWN))
    assert answers(only) == [("Cancel", TARGET, OWN, 0, "closed")]


def test_end_3_a_second_cancel_while_advertising_is_only_acked() -> None:
    s = at("prescriber", "ADVERTISING")
    s.hear(10, cancel(src=TARGET, session=OWN))
    assert changes_nothing(s, cancel(src=TARGET, session=OWN)).rule == "END-3"


def test_adv_5_after_the_window_an_intention_is_closed_although_there_is_no_room() -> None:
    s = at("prescriber", "CHOOSING")
    me = s.station.me._replace(max_participants=len(s.state.recorded))
    rule, outcome = decide(me, s.state, Heard(intention(7, OWN)))
    assert (rule, [m.type for m in outcome.messages]) == ("ADV-5", ["Cancel"])


def test_pre_1_the_last_one_withdraws_while_choosing() -> None:
    s = at("prescriber", "CHOOSING")
    s.hear(2200, cancel(src=TARGET, session=OWN))
    assert s.at == ("prescriber", "CHOOSING")
    effects = s.hear(2210, cancel(src=OTHER, session=OWN))
    assert [i.name for i in told(effects)] == ["no_participants"]
    assert [m.type for m in sent(effects)] == ["Ack"]
    assert s.state.backoff


@pytest.mark.parametrize("phase", ["PRESCRIBING", "NEGOTIATING", "ACTUATING"])
def test_adv_5_late_intentions(phase: str) -> None:
    """The target's copy is acked; a released station gets its Cancel again; others closed."""
    s = at("prescriber", phase)
    released = next(m for m in s.state.outbox if m.dst == OTHER)
    assert answers(changes_nothing(s, intention(session=OWN))) == [("Ack", TARGET, OWN, 0, "")]
    assert changes_nothing(s, intention(OTHER, OWN)).messages == (released,)
    assert answers(changes_nothing(s, intention(7, OWN))) == [("Cancel", 7, OWN, 0, "closed")]


def test_adv_5_a_copy_is_answered_with_the_fin_in_the_outbox() -> None:
    s = at("prescriber", "ACTUATING")
    (last,) = sent(s.do(2250, "complete", OWN), "Fin")
    assert changes_nothing(s, yes(session=OWN)).messages == (last,)
    assert changes_nothing(s, intention(session=OWN)).messages == (last,)


@pytest.mark.parametrize("phase", ["NEGOTIATING", "ACTUATING"])
def test_neg_1_a_copy_of_a_prescription_is_acked_and_nothing_more(phase: str) -> None:
    only = changes_nothing(at("receiver", phase), prescription())
    assert answers(only) == [("Ack", PRESCRIBER, THEIRS, 0, "")]
    assert only.indications == ()


def test_neg_6_a_late_copy_of_a_refusal_does_not_refuse_the_next_proposal() -> None:
    s = at("prescriber", "NEGOTIATING")
    s.hear(2250, no(session=OWN))
    s.do(2260, "prescribe", OWN, proposal=2)
    for late in (no(session=OWN), yes(session=OWN)):
        only = changes_nothing(s, late)
        assert (only.rule, answers(only)) == ("NEG-6", [("Ack", TARGET, OWN, 0, "")])


@pytest.mark.parametrize(
    "wrong",
    [{"src": OTHER}, {"session": OLD}, {"of": {"type": "Fin", "seq": 2}}, {"seq": 3}],
    ids=["from another", "another session", "another type", "another seq"],
)
def test_end_6_an_ack_must_match_in_all(wrong: dict[str, Any]) -> None:
    s = at("prescriber", "PRESCRIBING")
    right = ack(next(m for m in s.state.outbox if m.type == "Prescription"))
    if "of" in wrong:
        other = right.model_copy(update={"of": right.of.model_copy(update={"type": "Fin"})})
    elif "seq" in wrong:
        other = right.model_copy(update={"of": right.of.model_copy(update={"seq": 0})})
    else:
        other = right.model_copy(update=wrong)
    assert changes_nothing(s, other).rule == "END-6"
    s.hear(s.now, right)
    assert s.at == ("prescriber", "NEGOTIATING")


# -- commands

PROVIDED = {
    "request": {("none", "STANDALONE")},
    "prescribe": {("prescriber", "CHOOSING")},
    "proceed": {("prescriber", "CHOOSING")},
    "accept": {("receiver", "NEGOTIATING")},
    "refuse": {("receiver", "NEGOTIATING")},
    "complete": {("prescriber", "ACTUATING")},
    "abort": set(Stage.PHASES[1:]),
}


def refused(s: Stage, rule: str, name: str, session: Any = None, **fields: Any) -> None:
    state, timers = s.state, dict(s.station.timers)
    (only,) = s.do(s.now, name, session, **fields)
    assert (only.rule, only.messages) == (rule, ())
    assert (only.rule, only.indications) == (rule, (Refused(detail=name),))
    assert s.state is state
    assert s.station.timers == timers


@PHASES
@pytest.mark.parametrize("name", PROVIDED)
def test_cmd_1_a_command_that_no_rule_provides_for(role: str, phase: str, name: str) -> None:
    s = at(role, phase)
    session = None if name == "request" else s.state.session or OWN
    if (role, phase) not in PROVIDED[name]:
        refused(s, "ADV-1" if name == "request" else "CMD-1", name, session)
        return
    (only,) = s.do(s.now, name, session)
    assert only.indications == ()
    assert s.at != (role, phase)


@pytest.mark.parametrize("name", [name for name in PROVIDED if name != "request"])
def test_pre_5_a_command_for_another_session_is_stale(name: str) -> None:
    for role, phase in PROVIDED[name]:
        s = at(role, phase)
        for session in {OLD, OWN, THEIRS, (PRESCRIBER, 2)} - {s.state.session}:
            refused(s, "PRE-5", name, session)


def test_pre_5_an_answer_to_another_proposal_is_stale() -> None:
    refused(at("prescriber", "CHOOSING"), "PRE-5", "prescribe", OWN, proposal=2)
    refused(at("receiver", "NEGOTIATING"), "PRE-5", "accept", THEIRS, proposal=2)
    refused(at("receiver", "NEGOTIATING"), "PRE-5", "refuse", THEIRS, proposal=2)


@pytest.mark.parametrize("target", [7, ME])
def test_pre_2_only_a_recorded_station_can_be_the_target(target: int) -> None:
    refused(at("prescriber", "CHOOSING"), "PRE-2", "prescribe", OWN, target=target)


def test_pre_2_a_withdrawn_station_cannot_be_the_target() -> None:
    s = at("prescriber", "CHOOSING")
    s.hear(2150, cancel(src=TARGET, session=OWN))
    refused(s, "PRE-2", "prescribe", OWN)


def test_neg_7_the_target_never_changes_and_the_proposal_grows_by_one() -> None:
    s = at("prescriber", "NEGOTIATING")
    s.hear(2250, no(session=OWN))
    refused(s, "NEG-7", "prescribe", OWN, proposal=2, target=OTHER)
    refused(s, "PRE-5", "prescribe", OWN, proposal=1)
    refused(s, "PRE-5", "prescribe", OWN, proposal=3)
    refused(s, "CMD-1", "proceed", OWN)
    s.do(2260, "prescribe", OWN, proposal=2)
    assert (s.at, s.state.proposal) == (("prescriber", "PRESCRIBING"), 2)


def test_neg_7_no_agreement_after_max_rounds() -> None:
    s = Stage(max_rounds=2).walk("prescriber", "NEGOTIATING")
    s.hear(2250, no())
    s.do(2260, "prescribe", s.own, proposal=2)
    effects = s.hear(2270, no(2))
    assert [m.type for m in sent(effects)] == ["Ack", "Cancel"]
    assert [(i.name, i.reason) for i in told(effects)] == [("fallback", "no_agreement")]


@pytest.mark.parametrize("reason", ["busy", "unknown_session"])
def test_neg_7_busy_is_the_end_at_once(reason: str) -> None:
    s = at("prescriber", "NEGOTIATING")
    effects = s.hear(2250, no(reason=reason, session=OWN))
    assert [(m.type, m.reason) for m in sent(effects) if m.seq > 3] == [("Cancel", "no_agreement")]
    assert s.at == ("none", "STANDALONE")
