"""From the states of a closed model to what each station did, step by step.

A model of System may be reduced (System.tla): a step then also gives up what its station still
sends, and sends at once what others would answer.  Here these steps are told one by one, so that
every state of a station is one that its log can explain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.station import Expire, Input, Message, Receive, State, Timer
from automcm_traces.checker.track import INITIAL
from automcm_traces.export.behaviour_effects import Question
from automcm_traces.export.behaviour_to_log import Effects, Happening, StoryError, plain

Asker = Callable[[Iterable[Question]], dict[Question, Effects]]
ANSWERED = ("Intention", "Prescription", "Acceptance")


@dataclass(frozen=True, slots=True)
class Move:
    """One step of a model: the stations and the messages on the radio before and after it.

    ``station`` is 0 for an event of the radio or of time.  The other fields are those of
    ``Happening``.
    """

    station: int
    input: Input | None
    before: dict[int, State]
    after: dict[int, State]
    net_before: frozenset[Message] = frozenset()
    net_after: frozenset[Message] = frozenset()
    at_ms: int | None = None
    behind_ms: Mapping[int, int] = field(default_factory=dict)
    deadlines: dict[Timer, int] | None = None
    cams: tuple[int, ...] = ()
    also_armed: frozenset[Timer] = frozenset()
    """Timers that the model armed anew although no rule does (AlsoArmed in TimedSystem.tla)."""


@dataclass
class _Told:
    """A move and the steps it is told as."""

    move: Move
    chain: list[Question] = field(default_factory=list)
    answers: list[tuple[Message, list[Question]]] = field(default_factory=list)

    def questions(self) -> Iterator[Question]:
        yield from self.chain
        for _, calls in self.answers:
            yield from calls


def happenings(moves: Sequence[Move], ask: Asker, reduced: bool) -> list[Happening]:
    """The steps of the stations.  ``ask`` works out what follows (``story_effects.ask``).

    Raises StoryError where the model's next state is not explained.
    """
    return happenings_of_all([moves], ask, reduced)[0]


def happenings_of_all(
    behaviours: Sequence[Sequence[Move]], ask: Asker, reduced: bool
) -> list[list[Happening]]:
    """The same for several behaviours; all are asked about at once."""
    effects = ask(_main(move) for moves in behaviours for move in moves if move.station)
    told = [[_Told(move) for move in moves] for moves in behaviours]
    if reduced:
        for moves in told:
            wanted: set[Message] = set()
            for each in reversed(moves):
                _reduced(each, effects, wanted)
        effects = effects | ask(q for moves in told for each in moves for q in each.questions())
    return [[h for each in moves for h in _tell(each, effects)] for moves in told]


def _main(move: Move) -> Question:
    """What the step itself asks; with time, the model's word on what comes next counts."""
    assert move.input is not None
    after = move.after[move.station] if move.at_ms is not None else None
    return Question(move.station, move.before[move.station], move.input, after)


def _tell(told: _Told, effects: dict[Question, Effects]) -> list[Happening]:
    move = told.move
    if not move.station:
        return [Happening(0, INITIAL, None, NOTHING, move.at_ms, move.behind_ms, cams=move.cams)]
    s = move.station
    main = effects[_main(move)]
    main = replace(main, arm=main.arm | move.also_armed)
    when = move.at_ms, move.behind_ms, move.deadlines, move.cams
    out = [Happening(s, move.before[s], move.input, main, *when)]
    for q in told.chain:
        out.append(Happening(s, q.state, q.input, effects[q]))
    reached = out[-1].effects.after
    if reached != move.after[s]:
        raise StoryError(f"{canonical(move.input)} of {s} leads to {canonical(reached)}")
    return out + [_answer(answer, calls, effects) for answer, calls in told.answers]


NOTHING = Effects(INITIAL, frozenset(), ("nothing",), "none", frozenset(), frozenset(), frozenset())


def _reduced(told: _Told, effects: dict[Question, Effects], wanted: set[Message]) -> None:
    """What a reduced step does besides.  ``wanted`` are the messages received later on."""
    move = told.move
    if not move.station:
        return
    main = effects[_main(move)]
    at = main.after
    for entry in sorted(at.outbox, key=canonical):
        if entry.type != "Prescription":
            told.chain.append(Question(move.station, at, Expire("expire", ("giveup", entry))))
            at = at._replace(outbox=at.outbox - {entry})
            if entry.type == "Intention":
                at = at._replace(phase="WAITING")
    if at.backoff:
        told.chain.append(Question(move.station, at, Expire("expire", ("backoff",))))
    sent = frozenset(map(plain, main.messages))
    for answer in sorted((move.net_after - move.net_before - sent) & wanted, key=canonical):
        told.answers.append((answer, _candidates(answer, move, sent)))
    if isinstance(move.input, Receive):
        wanted.add(move.input.message)


def _candidates(answer: Message, move: Move, sent: frozenset[Message]) -> list[Question]:
    """What may have called for an answer that is in the net: messages the other way.

    One that can do nothing more is in the net no longer (Dead in System.tla).
    """
    way = answer.dst, answer.src, answer.session
    return [
        Question(answer.src, move.after[answer.src], Receive("receive", m, False))
        for m in sorted(move.net_before | move.net_after | sent, key=canonical)
        if m.type in ANSWERED and (m.src, m.dst, m.session) == way
    ]


def _answer(
    answer: Message, candidates: list[Question], effects: dict[Question, Effects]
) -> Happening:
    for q in candidates:
        found = effects[q]
        if any(plain(m) == answer for m in found.messages):
            return Happening(q.station, q.state, q.input, found)
    raise StoryError(f"nothing calls for {canonical(answer)}")
