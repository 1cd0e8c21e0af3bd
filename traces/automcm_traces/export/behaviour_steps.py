"""Converts the states of a closed model to the steps of each station.

A model of System may be reduced (System.tla): then a step also gives up the messages that its
station still sends, and sends the answers of other stations at once. This module splits such steps,
so that a log can explain every state of a station.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from automcm_spec.vocabulary.conditions import EMPTY
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.station import Expire, Input, Message, Outcome, Receive, State, Timer
from automcm_traces.checker.track import INITIAL, NO_INDICATION
from automcm_traces.export.behaviour_effects import EffectQuery
from automcm_traces.export.behaviour_to_log import BehaviourError, BehaviourStep, StepEffects, plain

EffectsOf = Callable[[Iterable[EffectQuery]], dict[EffectQuery, StepEffects]]
ANSWERED = ("Intention", "Prescription", "Acceptance")


@dataclass(frozen=True, slots=True)
class Move:
    """One step of a model: the stations and the messages on the radio, before and after it.

    ``station`` is 0 for an event of the radio or of time. The other fields are those of
    ``BehaviourStep``.
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
    """Timers that the model re-armed although no rule does (AlsoArmed in TimedSystem.tla)."""


@dataclass
class _SplitMove:
    """A move and the steps it is split into."""

    move: Move
    chain: list[EffectQuery] = field(default_factory=list)
    answers: list[tuple[Message, list[EffectQuery]]] = field(default_factory=list)

    def questions(self) -> Iterator[EffectQuery]:
        yield from self.chain
        for _, calls in self.answers:
            yield from calls


def steps_of(
    behaviours: Sequence[Sequence[Move]], effects_of: EffectsOf, reduced: bool
) -> list[list[BehaviourStep]]:
    """The steps of the stations in several behaviours, with all queries in one call.
    ``effects_of`` computes effects (``behaviour_effects.effects_of``).

    Raises BehaviourError if they do not lead to the model's next state.
    """
    effects = effects_of(_main(move) for moves in behaviours for move in moves if move.station)
    split = [[_SplitMove(move) for move in moves] for moves in behaviours]
    if reduced:
        for moves in split:
            wanted: set[Message] = set()
            for each in reversed(moves):
                _reduced(each, effects, wanted)
        effects = effects | effects_of(
            q for moves in split for each in moves for q in each.questions()
        )
    return [[h for each in moves for h in _steps_of_move(each, effects)] for moves in split]


def _main(move: Move) -> EffectQuery:
    """The query for the step itself; in a timed model, the model's next state counts."""
    assert move.input is not None
    after = move.after[move.station] if move.at_ms is not None else None
    return EffectQuery(move.station, move.before[move.station], move.input, after)


def _steps_of_move(
    split: _SplitMove, effects: dict[EffectQuery, StepEffects]
) -> list[BehaviourStep]:
    move = split.move
    if not move.station:
        return [
            BehaviourStep(0, INITIAL, None, NOTHING, move.at_ms, move.behind_ms, cams=move.cams)
        ]
    s = move.station
    main, marks = effects[_main(move)]
    main = main._replace(arm=main.arm | move.also_armed)
    when = move.at_ms, move.behind_ms, move.deadlines, move.cams
    out = [BehaviourStep(s, move.before[s], move.input, StepEffects(main, marks), *when)]
    out += [BehaviourStep(s, q.state, q.input, effects[q]) for q in split.chain]
    reached = out[-1].effects.outcome.st
    if reached != move.after[s]:
        raise BehaviourError(
            f"{canonical(move.input)} of {s} leads to {canonical(reached)}, not to the model's "
            f"state {canonical(move.after[s])}"
        )
    return out + [_answer(answer, calls, effects) for answer, calls in split.answers]


NOTHING = StepEffects(Outcome(INITIAL, EMPTY, NO_INDICATION, "none", EMPTY, EMPTY), EMPTY)


def _reduced(
    split: _SplitMove, effects: dict[EffectQuery, StepEffects], wanted: set[Message]
) -> None:
    """Add the other parts of a reduced step. ``wanted`` are the messages that are received
    later."""
    move = split.move
    if not move.station:
        return
    main = effects[_main(move)].outcome
    at = main.st
    for entry in sorted(at.outbox, key=canonical):
        if entry.type != "Prescription":
            split.chain.append(EffectQuery(move.station, at, Expire("expire", ("giveup", entry))))
            at = at._replace(outbox=at.outbox - {entry})
            if entry.type == "Intention":
                at = at._replace(phase="WAITING")
    if at.backoff:
        split.chain.append(EffectQuery(move.station, at, Expire("expire", ("backoff",))))
    sent = frozenset(map(plain, main.out))
    for answer in sorted((move.net_after - move.net_before - sent) & wanted, key=canonical):
        split.answers.append((answer, _candidates(answer, move, sent)))
    if isinstance(move.input, Receive):
        wanted.add(move.input.message)


def _candidates(answer: Message, move: Move, sent: frozenset[Message]) -> list[EffectQuery]:
    """The inputs that may have caused an answer in the net: messages in the other direction.

    A message that can have no further effect is no longer in the net (Dead in System.tla).
    """
    way = answer.dst, answer.src, answer.session
    return [
        EffectQuery(answer.src, move.after[answer.src], Receive("receive", m, False))
        for m in sorted(move.net_before | move.net_after | sent, key=canonical)
        if m.type in ANSWERED and (m.src, m.dst, m.session) == way
    ]


def _answer(
    answer: Message, candidates: list[EffectQuery], effects: dict[EffectQuery, StepEffects]
) -> BehaviourStep:
    for q in candidates:
        found = effects[q]
        if any(plain(m) == answer for m in found.outcome.out):
            return BehaviourStep(q.station, q.state, q.input, found)
    raise BehaviourError(f"no input causes {canonical(answer)}")
