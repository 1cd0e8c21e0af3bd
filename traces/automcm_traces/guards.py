"""What would have been allowed instead, and which guard of Station.tla was in the way.

``nearest`` asks of an input that did something else than the log says: by which branch of the
input's handler would that have happened, and which guard keeps the station from it?  ``unarmed``
asks of a timer why it does not run, ``causes`` of what the log says which inputs would have led
to it.  What is observed is given as a tuple:

- ``("send", type)``, for an Acceptance also ``accepted`` (a bool), for it and a Cancel ``reason``;
- ``("told", name)``, for a fallback also the reason;
- ``("arm", timer)``, ``("stop", timer)``; ``("phase", name)``, the phase after the step;
- ``("without", …)``: the log lacks this; ``("nothing",)``: it has nothing at all.

Less is a question about all that begins so.  States, inputs and ids are the oracle's;
``Names`` says how ids are written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from automcm_spec.oracle import Oracle, canonical
from automcm_spec.rules import handler, place
from automcm_traces.guards_end import HANDLERS
from automcm_traces.guards_timers import armed
from automcm_traces.guards_tree import Facts, Guard, Leaf, Way, done, ways
from automcm_traces.track import NUMBERED, STRANGER, View

Json = Any
MOST = 8
_LIMITS = ("MaxRounds", "MaxParticipants", "OutboxLimit", "MemoryLimit", "Reserve")
_KINDS = ("expire", "command", "receive", "cam", "restart")


@dataclass(frozen=True, slots=True)
class Names:
    """How the oracle's ids are written: stations, sessions and proposals as they are.

    ``limits`` holds what the station tells of MaxRounds, MaxParticipants, OutboxLimit and
    MemoryLimit; without it those of the oracle are shown.
    """

    station: Callable[[int], int] = lambda p: p
    session: Callable[[Json], Sequence[int]] = lambda s: s
    proposal: Callable[[int], int] = lambda k: k
    limits: Mapping[str, int] | None = None

    def of_station(self, p: int) -> str:
        """A station, as a log has it."""
        if p == 0:
            return "nobody"
        return str(self.station(p)) if p != STRANGER else "a stranger"

    def of_session(self, s: Json) -> str:
        """A session as PRESCRIBER/NUMBER."""
        if s == [0, 0]:
            return "none"
        if s[0] == STRANGER:
            return "another one"
        prescriber, number = self.session(s)
        return f"{prescriber}/{number}"

    def of_entry(self, e: Json) -> str:
        """An entry of the outbox."""
        number = f" proposal={self.proposal(e[3])}" if e[0] in NUMBERED else ""
        return f"{e[0]} to {self.of_station(e[1])} session={self.of_session(e[2])}{number}"

    def of_value(self, name: str, value: Json) -> str:
        """A value of ``Nearest.values``."""
        if self.limits is not None and name in _LIMITS:
            return str(self.limits.get(name, "not told"))
        match name.rsplit(".", 1)[-1]:
            case "src" | "target" | "to" | "Peer(st)" | "t[2]":
                return self.of_station(value)
            case "dst":
                return self.of_station(value) if value else "all"
            case "session":
                return self.of_session(value)
            case "proposal":
                return str(self.proposal(value))
            case "recorded" | "withdrawn":
                return _set(self.of_station(p) for p in value)
            case "joined" | "marks":
                return _set(self.of_session(s) for s in value)
            case "outbox":
                return _set(self.of_entry(e) for e in value)
            case "of":
                return f"{value[0]} {value[1]}"
        return str(value).upper() if isinstance(value, bool) else str(value)


PLAIN = Names()
"""The oracle's own ids: 1 the station, 2 the peer, 3 the other one."""


def names(view: View, limits: Mapping[str, int] | None = None) -> Names:
    """The real ids behind those of a view; ``limits`` as for ``Names``, MaxRounds is known."""
    known = {"MaxRounds": view.track.max_rounds, **(limits or {})}
    if "MaxParticipants" in known:
        known["Reserve"] = 1 + max(known["MaxRounds"], known["MaxParticipants"])

    def proposal(k: int) -> int:
        real = (view.track.proposal, *(e.k for e in view.entries()))
        return next((n for n in real if n and view.proposals(n) == k), k)

    return Names(view.real_id, view.real_session, proposal, known)


@dataclass(frozen=True, slots=True)
class Nearest:
    """The nearest branch that does what was observed, and the first guard that blocks it."""

    rule: str
    """The rule of that branch; empty for a timer that is not armed."""
    action: str
    """What was observed: ``send Intention``, ``arm hold``, ``expire cam``."""
    handler: str
    """The operator of Station.tla that the input goes to."""
    where: str
    """The operator that the guard stands in: the handler, or one that it uses."""
    guard: str
    """Its text there; empty if no guard blocks: the rule does this, but in another form."""
    must_hold: bool
    why: str
    """How it is, in words."""
    values: tuple[tuple[str, Json], ...]
    """What the guard looks at, by its name in Station.tla, in the oracle's ids."""
    line: int
    also: tuple[str, ...] = ()
    """What else blocks it, in words."""

    def text(self, names: Names = PLAIN) -> str:
        """One line for a person."""
        what = f"{self.rule} {self.action}".strip()
        if not self.guard:
            return f"nearest allowed: {what} ({self.handler}), but not in this form"
        shown = ", ".join(f"{name} = {names.of_value(name, value)}" for name, value in self.values)
        inside = f" of {self.where}" if self.where != self.handler else ""
        return (
            f"nearest allowed: {what} ({self.handler}) blocked by guard {self.guard}{inside}, "
            f"which must {'' if self.must_hold else 'not '}hold; {self.why}: {shown}"
            f"{''.join(f'; {why}' for why in self.also)}  Station.tla:{self.line}"
        )


def nearest(oracle: Oracle, state: Json, i: Json, observed: Sequence[Json]) -> Nearest | None:
    """The branch for input ``i`` that does what was observed and has the fewest guards against it.

    None if no branch of the input's handler does that; ``causes`` may tell more then.  A timer that
    is not armed is answered as by ``unarmed``.
    """
    if i[0] == "expire" and (blocked := unarmed(oracle, state, i[1])) is not None:
        return blocked
    facts, wanted, to = Facts(state, i, oracle.constants), _words(observed), handler(i)
    best: tuple[tuple[int, bool, int], list[int], Way, Leaf] | None = None
    for way, leaf in ways(HANDLERS[to]):
        if not _does(wanted, leaf, state[0]):
            continue
        against = [n for n, (guard, holds) in enumerate(way) if guard.test(facts) != holds]
        if not against and not _happens(oracle, state, i, wanted):
            continue
        # few guards against it; not for want of memory; as far as possible along the handler
        distance = len(against), leaf.rule == "MEM-1", -against[0] if against else 0
        if best is None or distance < best[0]:
            best = distance, against, way, leaf
    if best is None:
        return None
    _, against, way, leaf = best
    if not against:
        return Nearest(leaf.rule, _action(wanted), to, "", "", True, "", (), 0)
    first = _blocked(leaf.rule, _action(wanted), to, *way[against[0]], facts)
    also = tuple(_why(*way[n]) for n in against[1:])
    return replace(first, line=lines(way)[against[0]], also=also)


def unarmed(oracle: Oracle, state: Json, timer: Json) -> Nearest | None:
    """Why this timer is not armed; None if it is."""
    facts, guard = Facts(state, ["expire", timer], oracle.constants), armed(timer)
    if guard.test(facts):
        return None
    to = handler(["expire", timer])
    return _blocked("", f"expire {_timer(timer)}", to, guard, True, facts)


def armed_in(oracle: Oracle, timer: Json) -> list[str]:
    """The phases in which this timer may be armed, in the order of their names."""
    guard, i = armed(timer), ["expire", timer]
    states = oracle.states
    return sorted({s[0] for s in states if guard.test(Facts(s, i, oracle.constants))})


def causes(
    oracle: Oracle, state: Json, observed: Sequence[Json], names: Names = PLAIN
) -> list[str]:
    """Which inputs would have led to what was observed, at most ``MOST``, timers first.

    Empty if none would, or if the state is not in the oracle.
    """
    at = oracle.state_index.get(canonical(state))
    if at is None:
        return []
    wanted, found = _words(observed), {kind: dict[str, None]() for kind in _KINDS}
    for answer in oracle.answers(at):
        i = oracle.inputs[answer.input]
        if _among(wanted, done(state, answer.effect, oracle.states[answer.next]), state[0]):
            found[i[0]][_input(i, names)] = None
    return [text for kind in _KINDS for text in found[kind]][:MOST]


def lines(way: Way) -> list[int]:
    """The line in Station.tla of each guard on a way."""
    ends: dict[str, int] = {}
    found = []
    for guard, _ in way:
        line, ends[guard.where] = place(guard.where, guard.text, ends.get(guard.where, 0))
        found.append(line)
    return found


def _blocked(
    rule: str, action: str, to: str, guard: Guard, must_hold: bool, facts: Facts
) -> Nearest:
    values = tuple((name, _value(facts, name)) for name in guard.shows)
    line, why = place(guard.where, guard.text)[0], _why(guard, must_hold)
    return Nearest(rule, action, to, guard.where, guard.text, must_hold, why, values, line)


def _why(guard: Guard, must_hold: bool) -> str:
    """How it is where the guard is not as it must be."""
    return guard.no if must_hold else guard.yes


def _value(facts: Facts, name: str) -> Json:
    match name:
        case "Peer(st)":
            return facts.peer
        case "Reserve":
            return facts.reserve
        case "concerned":
            return facts.concerned
        case "t[1]" | "t[2]":
            return facts.t[int(name[2]) - 1]
    if name in facts.limits:
        return facts.limits[name]
    record, field = name.split(".")
    return getattr(getattr(facts, record), field)


# -- what was observed, in the words of a leaf


def _words(observed: Sequence[Json]) -> list[str]:
    words = [str(word) for word in observed if word not in (None, "", "none")]
    if "Acceptance" in words:
        answer = {"True": "accepted", "False": "refused"}
        words = [answer.get(word, word) for word in words]
    return words


def _does(wanted: list[str], leaf: Leaf, phase: str) -> bool:
    """Whether a leaf may do what is wanted."""
    surely = {text for text in leaf.does if not text.endswith("?")}
    if wanted[0] in ("nothing", "without"):
        return _among(wanted, surely, phase)
    return _among(wanted, {text.removesuffix("?") for text in leaf.does}, phase)


def _among(wanted: list[str], does: set[str], phase: str) -> bool:
    """Whether what is done is what is wanted."""
    if wanted[0] == "nothing":
        return not does
    if wanted[0] == "without":
        return not any(_same(wanted[1:], text.split()) for text in does)
    if wanted == ["phase", phase]:  # it stays
        return not any(text.startswith("phase ") for text in does)
    return any(_same(wanted, text.split()) for text in does)


def _same(wanted: list[str], words: list[str]) -> bool:
    if len(wanted) > len(words):
        return False
    return all(a == b or b == "as_sent" for a, b in zip(wanted, words, strict=False))


def _happens(oracle: Oracle, state: Json, i: Json, wanted: list[str]) -> bool:
    """Whether the oracle itself answers with this."""
    try:
        answer = oracle.ask(state, i)
    except KeyError:
        return False
    return _among(wanted, done(state, answer.effect, oracle.states[answer.next]), state[0])


def _action(wanted: list[str]) -> str:
    return " ".join("indication" if word == "told" else word for word in wanted)


def _timer(timer: Json) -> str:
    return f"{timer[0]}({timer[1][0]})" if timer[0] in ("resend", "giveup") else str(timer[0])


def _input(i: Json, names: Names) -> str:
    """An input in words, without what seldom matters."""
    match i[0]:
        case "receive":
            m = i[1]
            extra = f" ({'accepted' if m[6] else 'refused'})" if m[0] == "Acceptance" else ""
            return f"receive {m[0]} from {names.of_station(m[1])}{extra}"
        case "cam":
            return f"receive CAM from {names.of_station(i[1])}"
        case "command":
            return f"command {i[1]}"
        case "expire":
            return f"expire {_timer(i[1])}"
    return str(i[0])


def _set(texts: Iterable[str]) -> str:
    return "{" + ", ".join(texts) + "}"
