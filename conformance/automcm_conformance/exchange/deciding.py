"""Why an answer is wrong: the rule, the operator and the guard of Station.tla that decided, with
their values.

The compiled specification is asked again, with real ids, in the state before the wrong answer.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from automcm_conformance.adapter.protocol import Answer as Answered
from automcm_conformance.exchange.exchange import Mismatch, Wrong
from automcm_conformance.exchange.results import Deciding
from automcm_conformance.exchange.tours import Pair
from automcm_conformance.exchange.wire import ME
from automcm_spec.graph.oracle import Oracle
from automcm_spec.vocabulary import renumbering
from automcm_spec.vocabulary.conditions import Evaluated, NoArm, blocking_conditions, record
from automcm_spec.vocabulary.parameters import LIMITS
from automcm_spec.vocabulary.rules import handler, line
from automcm_spec.vocabulary.station import Effect, Expire, Input, State, Station
from automcm_traces.checker.track import NO_INDICATION

MEANING = {
    "AwaitsAnswer(st)": "the prescriber awaits an answer",
    "AckMatches(e, m)": "the Ack names the outbox entry",
    "Bound(st)": "the station is in a session",
    "BreaksProtocol(me, m)": "the message breaks the protocol",
    "In(st, m.session)": "the message is of the own session",
    "Marked(st, i.marks)": "the CAM is marked with the own session",
    "NewerThanJoined(st, m.session)": "the session is newer than the last one joined",
    "OfPeer(st, m.src)": "the sender is the peer",
    "OlderOrSame(m.proposal, st.proposal)": "the proposal is not newer than the last one seen",
    "Quarantined(st)": "the station is in quarantine",
    "Room(st)": "the outbox has room",
    "RoomToRecord(st)": "there is room to record a participant",
    "RoomToRemember(st, m.src)": "there is room to remember the prescriber",
    "RoundLeft(st)": "another round is allowed",
    "SameProposal(m.proposal, st.proposal)": "the answer is for the current proposal",
    "WithinRounds(m.proposal)": "the proposal is at most max_rounds",
    "acked = {}": "the Ack names no outbox entry",
    "c.proposal # st.proposal": "the command names another proposal",
    "c.session # st.session": "the command names another session",
    "concerned": "the application is concerned",
    "i.newer": "the CAM is newer than the last one that counted",
    "m.dst \\notin {me, Broadcast}": "the message is to another station",
    "m.seq # 0": "the message is a reliable one",
    "st.heard": "a CAM of the peer has counted",
    "st.recorded = {}": "no participant is recorded",
}
"""Guards in words, by their text in the specification; the others are shown as they are."""


def deciding_pair(oracle: Oracle, error: Wrong) -> Pair | None:
    """The step of the specification that the wrong answer belongs to.

    If only the deadline is wrong, and no earlier answer had it, that is the expiry of its timer:
    the timer was not armed correctly.
    """
    step = error.steps[-1]
    if not step.pairs:
        return None
    if not isinstance(error, Mismatch):
        return step.pairs[-1]
    if error.parts == {"deadline"} and step.next_timer is not None:
        due, timer = step.expected.deadline, step.next_timer
        shown = any((s.expected.deadline, s.next_timer) == (due, timer) for s in error.steps[:-1])
        before = error.steps[-2].expected.deadline if len(error.steps) > 1 else None
        still_runs = before is not None and error.answer.deadline == before
        expiry = oracle.input_index.get(Expire("expire", timer), -1)
        if not shown and not still_runs and expiry >= 0 and oracle.answer(step.after, expiry):
            return step.after, expiry
    for problem in error.problems:
        for pair in reversed(step.pairs):
            effect = oracle.given(*pair).effect
            sends = {message.type for message in effect.messages}
            about = problem.kind.partition(" ")[0].partition(".")[0]
            if problem.part == "messages" and about in sends:
                return pair
            if problem.part == "indications" and effect.indication != NO_INDICATION:
                return pair
    return step.pairs[-1]


def deciding(oracle: Oracle, error: Wrong, pair: Pair) -> Deciding:
    """What decides ``pair``, which is to blame for the wrong answer."""
    answer = oracle.given(*pair)
    rule, value = answer.effect.rule, oracle.inputs[pair[1]]
    plain = Deciding(rule, handler(value), line(rule, value))
    rename = error.session if isinstance(error, Mismatch) else None
    if rename is None:
        return plain
    state = oracle.states[pair[0]]
    me = renumbering.station(ME, rename)
    real = renumbering.state(state, rename), renumbering.input_of(value, rename)
    station = _with_limits(*(oracle.constants[constant] for constant in LIMITS.values()))
    try:
        effect, evaluated = record(station, lambda s: s.decide(me, *real))
    except NoArm:
        return plain
    conditions = [e.condition for e in evaluated]
    places = [n for n, c in enumerate(conditions) if (c.kind, c.text) == ("rule", rule)]
    if effect.rule != rule or not places:
        return plain
    place = evaluated[places[-1]].condition
    before = evaluated[: places[-1]]
    guards = [n for n, e in enumerate(before) if e.condition.kind == "guard"]
    lines = [(before[n].condition.operator, before[n].condition.line) for n in guards]
    # The parts of one condition are on one line; two of them say enough.
    decided = [n for n, at in zip(guards, lines, strict=True) if at == lines[-1]][-2:]
    guard = "; ".join(_sentence(before[n], _inside(before, n)) for n in decided)
    as_if = "" if pair not in error.steps[-1].pairs else _as_if(station, me, real, error)
    return Deciding(rule, place.operator, place.line, guard, as_if)


_with_limits = cache(Station)


def _inside(evaluated: list[Evaluated], last: int) -> dict[str, object]:
    """The values of a guard, with those of its parts, which are evaluated just before it."""
    found: dict[str, object] = {}
    for each in reversed(evaluated[:last]):
        if each.condition.kind != "part":
            break
        found |= {name: value for name, value in each.values if "." in name and name not in found}
    return dict(evaluated[last].values) | found


def _sentence(evaluated: Evaluated, values: dict[str, object], must: str = "") -> str:
    """A guard in words, whether it holds, its text and its values."""
    text = evaluated.condition.text
    holds = "holds" if evaluated.value else "does not hold"
    meaning = f' ("{MEANING[text]}")' if text in MEANING else ""
    shown = ", ".join(f"{name} = {_plain(value)}" for name, value in values.items())
    return f"{text}{meaning} {must or holds}{': ' if shown else ''}{shown}"


def _plain(value: object) -> str:
    match value:
        case bool():
            return str(value).upper()
        case (int(p), int(number)):
            return "none" if (p, number) == (0, 0) else f"{p}/{number}"
        case frozenset():
            return "{" + ", ".join(sorted(map(_plain, value))) + "}"
        case tuple():
            return ", ".join(map(_plain, value))
    return str(value)


def _as_if(station: Station, me: int, real: tuple[State, Input], error: Wrong) -> str:
    """The guards that would lead to what the answer has, of one step; empty if there are none."""
    step = error.steps[-1]
    if len(step.pairs) != 1 or not isinstance(error, Mismatch):
        return ""
    wanted = _wanted(error.answer)
    found = blocking_conditions(station, lambda s: s.decide(me, *real), wanted, most=2)
    if not found or not found[0]:
        return ""
    musts = (("did not hold" if e.value else "held", e) for e in found[-1])
    return " and ".join(_sentence(e, dict(e.values), must) for must, e in musts)


def _wanted(answer: Answered) -> Callable[[Effect], bool]:
    """Whether an effect has the messages, the indication and the phase of an answer."""
    messages = (m if type(m) is dict else {} for m in answer.messages)
    sent = sorted(repr((m.get("type"), m.get("dst", 0))) for m in messages)
    names = [indication["name"] for indication in answer.indications]

    def is_wanted(effect: Effect) -> bool:
        told = [] if effect.told == NO_INDICATION else [effect.told[0]]
        return (
            sorted(repr((m.type, m.dst)) for m in effect.out) == sent
            and told == names
            and answer.phase in (None, effect.st.phase)
        )

    return is_wanted
