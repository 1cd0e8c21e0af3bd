"""From the states of a closed model to what each station did, step by step.

A model of System may be reduced (System.tla): a step then also gives up what its station still
sends, and sends at once what others would answer.  Here these steps are told one by one, so that
every state of a station is one that its log can explain.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from automcm_spec.oracle import canonical
from automcm_traces.story import Effects, Happening, StoryError
from automcm_traces.story_effects import Question

Json = Any
Asker = Callable[[Iterable[Question]], dict[str, Effects]]
ANSWERED = ("Intention", "Prescription", "Acceptance")


@dataclass(frozen=True, slots=True)
class Move:
    """One step of a model: the stations and the messages on the radio before and after it.

    ``station`` is 0 for an event of the radio or of time.  The other fields are those of
    ``Happening``.
    """

    station: int
    input: Json
    before: dict[int, Json]
    after: dict[int, Json]
    net_before: frozenset[str] = frozenset()
    net_after: frozenset[str] = frozenset()
    at_ms: int | None = None
    behind_ms: Mapping[int, int] = field(default_factory=dict)
    deadlines: dict[str, int] | None = None
    cams: tuple[int, ...] = ()
    also_armed: tuple[Json, ...] = ()
    """Timers that the model armed anew although no rule does (AlsoArmed in TimedSystem.tla)."""


@dataclass
class _Told:
    """A move and the steps it is told as."""

    move: Move
    chain: list[Question] = field(default_factory=list)
    answers: list[tuple[Json, list[Question]]] = field(default_factory=list)

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
            wanted: set[str] = set()
            for each in reversed(moves):
                _reduced(each, effects, wanted)
        effects = effects | ask(q for moves in told for each in moves for q in each.questions())
    return [[h for each in moves for h in _tell(each, effects)] for moves in told]


def _main(move: Move) -> Question:
    """What the step itself asks; with time, the model's word on what comes next counts."""
    after = move.after[move.station] if move.at_ms is not None else None
    return Question(move.station, move.before[move.station], move.input, after)


def _tell(told: _Told, effects: dict[str, Effects]) -> list[Happening]:
    move = told.move
    if not move.station:
        return [Happening(0, [], move.input, NOTHING, move.at_ms, move.behind_ms, cams=move.cams)]
    s = move.station
    main = effects[_main(move).key]
    more = [timer for timer in move.also_armed if timer not in main.arm]
    main = replace(main, arm=main.arm + more) if more else main
    when = move.at_ms, move.behind_ms, move.deadlines, move.cams
    out = [Happening(s, move.before[s], move.input, main, *when)]
    for q in told.chain:
        out.append(Happening(s, q.state, q.input, effects[q.key]))
    reached = out[-1].effects.after
    if canonical(reached) != canonical(move.after[s]):
        raise StoryError(f"{canonical(move.input)} of {s} leads to {canonical(reached)}")
    return out + [_answer(answer, calls, effects) for answer, calls in told.answers]


NOTHING = Effects([], [], ["nothing"], "none", [], [], [])


def _reduced(told: _Told, effects: dict[str, Effects], wanted: set[str]) -> None:
    """What a reduced step does besides.  ``wanted`` are the messages received later on."""
    move = told.move
    if not move.station:
        return
    main = effects[_main(move).key]
    at = copy.deepcopy(main.after)
    for entry in list(at[11]):
        if entry[0] != "Prescription":
            told.chain.append(
                Question(move.station, copy.deepcopy(at), ["expire", ["giveup", entry]])
            )
            at[11].remove(entry)
            if entry[0] == "Intention":
                at[0] = "WAITING"
    if at[13]:
        told.chain.append(Question(move.station, copy.deepcopy(at), ["expire", ["backoff"]]))
    sent = {plain(m) for m in main.messages}
    for text in sorted((move.net_after - move.net_before - sent) & wanted):
        answer = json.loads(text)
        told.answers.append((answer, _candidates(answer, move, sent)))
    if move.input[0] == "receive":
        wanted.add(canonical(move.input[1]))


def _candidates(answer: Json, move: Move, sent: set[str]) -> list[Question]:
    """What may have called for an answer that is in the net: messages the other way.

    One that can do nothing more is in the net no longer (Dead in System.tla).
    """
    _, src, dst, session, *_ = answer
    calls = [json.loads(text) for text in sorted(move.net_before | move.net_after | sent)]
    return [
        Question(src, move.after[src], ["receive", m, False])
        for m in calls
        if m[0] in ANSWERED and m[1:4] == [dst, src, session]
    ]


def _answer(answer: Json, candidates: list[Question], effects: dict[str, Effects]) -> Happening:
    for q in candidates:
        found = effects[q.key]
        if any(plain(m) == canonical(answer) for m in found.messages):
            return Happening(q.station, q.state, q.input, found)
    raise StoryError(f"nothing calls for {canonical(answer)}")


def plain(m: Json) -> str:
    """A message as the radio of the model holds it (Plain in Network.tla)."""
    said = m[7] in ("none", "busy", "unknown_session", "closed")
    return canonical([*m[:7], m[7] if said else "as_sent", m[8]])
