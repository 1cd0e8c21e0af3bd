"""What would have been allowed instead, and which guard of Station.tla was in the way.

``nearest`` asks of an input that did something else than the log says: by which branch of the
input's handler would that have happened, and which guard keeps the station from it?  ``unarmed``
asks of a timer why it does not run, ``causes`` of what the log says which inputs would have led
to it.  What is observed is given as a tuple:

- ``("send", type)``, for an Acceptance also ``accepted`` (a bool), for it and a Cancel ``reason``;
- ``("told", name)``, for a fallback also the reason;
- ``("arm", timer)``, ``("stop", timer)``; ``("phase", name)``, the phase after the step;
- ``("without", …)``: the log lacks this; ``("nothing",)``: it has nothing at all.

Less is a question about all that begins so; a whole message or timer of a log may stand for its
type or name, ``indication`` for ``told``, tuples for lists.  States, inputs and ids are the
oracle's; ``Names`` says how ids are written.  ``observed`` reads the tuple from an event of a log.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from automcm_spec.oracle import Oracle, canonical
from automcm_spec.rules import handler, place
from automcm_traces.graph_view import STRANGER, View
from automcm_traces.guards_end import HANDLERS
from automcm_traces.guards_timers import armed
from automcm_traces.guards_tree import Facts, Guard, Leaf, Way, done, ways
from automcm_traces.log import ApplicationIndication, Event, Send, TimerArm, TimerEnd
from automcm_traces.track import NUMBERED

Json = Any
MOST = 8
_LIMITS = ("MaxRounds", "MaxParticipants", "OutboxLimit", "MemoryLimit", "Reserve")
_MISSING = ("nothing", "without")
_KINDS = ("expire", "command", "receive", "cam", "restart")


@dataclass(frozen=True, slots=True)
class Names:
    """How the oracle's ids are written: stations, sessions, proposals, and the seq of an entry.

    ``limits`` holds the station's MaxRounds, MaxParticipants, OutboxLimit, MemoryLimit and Reserve;
    without it those of the oracle are shown.  ``given`` is the message received, as the log has it.
    """

    station: Callable[[int], int] = lambda p: p
    session: Callable[[Json], Sequence[int]] = lambda s: s
    proposal: Callable[[int], int] = lambda k: k
    seq: Callable[[Json], int] = lambda e: int(e[3])
    limits: Mapping[str, int] | None = None
    given: Mapping[str, Json] | None = None

    def of_station(self, p: int) -> str:
        """A station, as a log has it."""
        if p == 0:
            return "nobody"
        return str(self.station(p) or "another station") if p != STRANGER else "a stranger"

    def of_session(self, s: Json) -> str:
        """A session as PRESCRIBER/NUMBER."""
        if s == [0, 0]:
            return "none"
        prescriber, number = self.session(s) if s[0] != STRANGER else (0, 0)
        return f"{prescriber}/{number}" if prescriber else "another one"

    def of_entry(self, e: Json) -> str:
        """An entry of the outbox."""
        number = f" proposal={self.proposal(e[3])}" if e[0] in NUMBERED else ""
        to, session = self.of_station(e[1]), self.of_session(e[2])
        return f"{e[0]} to {to} session={session}{number} seq={self.seq(e)}"

    def of_value(self, name: str, value: Json) -> str:
        """A value of ``Nearest.values``."""
        record, _, field = name.rpartition(".")
        if self.limits is not None and name in _LIMITS:
            return str(self.limits[name])
        if self.given is not None and record == "m":
            return _given(self.given, field)
        match field:
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
                return f"{value[0]} seq={value[1]}"
        return str(value).upper() if isinstance(value, bool) else str(value)


def _given(message: Mapping[str, Json], field: str) -> str:
    """A field of a message of a log."""
    value = message.get(field, {"dst": "all", "accepted": False}.get(field, "none"))
    match field, value:
        case "session", [prescriber, number]:
            return f"{prescriber}/{number}"
        case "of", {"type": type_, "seq": seq}:
            return f"{type_} seq={seq}"
    return str(value).upper() if isinstance(value, bool) else str(value)


PLAIN = Names()
"""The oracle's own ids: 1 the station, 2 the peer, 3 the other one."""


def names(view: View, given: Mapping[str, Json] | None = None) -> Names:
    """The real ids behind those of a view, and the station's limits; ``given`` as in ``Names``."""
    t = view.track
    limits = {
        "MaxRounds": t.max_rounds,
        "MaxParticipants": t.limits.participants,
        "OutboxLimit": t.limits.outbox,
        "MemoryLimit": t.limits.memory,
        "Reserve": 1 + max(t.max_rounds, t.limits.participants),
    }

    def proposal(k: int) -> int:
        real = (t.proposal, *(e.k for e in view.entries()))
        return next((n for n in real if n and view.proposals(n) == k), k)

    def seq(entry: Json) -> int:
        real = (e.message["seq"] for e in view.entries() if plain(view.entry(e)) == plain(entry))
        return int(next(real, entry[3]))

    return Names(view.real_id, view.real_session, proposal, seq, limits, given)


def plain(value: Json) -> Json:
    """Lists where the engine has tuples."""
    return [plain(v) for v in value] if isinstance(value, list | tuple) else value


def observed(event: Event) -> tuple[Json, ...]:
    """What an event of a log shows, as ``nearest`` and ``causes`` want it; else it is empty."""
    match event:
        case Send(message=m):
            return ("send", *_message(m))
        case ApplicationIndication(indication=indication):
            return ("told", indication.name, (indication.model_extra or {}).get("reason"))
        case TimerArm(timer=timer):
            return ("arm", timer.name)
        case TimerEnd(op="stop", timer=timer):
            return ("stop", timer.name)
    return ()


def timer_in(view: View, timer: Mapping[str, Json]) -> Json:
    """A timer of a log in the oracle's ids; of a message that is not in the outbox, roughly."""
    t, m = view.track, timer.get("message")
    if m is None:
        station = timer.get("station")
        return [timer["name"], view.ids.get(station, STRANGER)] if station else [timer["name"]]
    entry = t.entry_by_seq(dict(m))
    if entry is not None and entry in view.entries():
        return [timer["name"], plain(view.entry(entry))]
    to = view.ids.get(m["to"], STRANGER) if "to" in m else 0
    return [timer["name"], [m["type"], to, list(view.sessions(m["session"])), 1, False]]


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
            return f"nearest allowed: {what} ({self.handler}), but not in this form, or not again"
        shown = ", ".join(f"{name} = {names.of_value(name, value)}" for name, value in self.values)
        inside = f" of {self.where}" if self.where != self.handler else ""
        return (
            f"nearest allowed: {what} ({self.handler}) blocked by guard {self.guard}{inside}, "
            f"which must {'' if self.must_hold else 'not '}hold; {self.why}: {shown}"
            f"{''.join(f'; {why}' for why in self.also)}  Station.tla:{self.line}"
        )


def nearest(
    oracle: Oracle, state: Json, i: Json, observed: Sequence[Json], full: bool = False
) -> Nearest | None:
    """The branch for input ``i`` that does what was observed and has the fewest guards against it.

    None if no branch of the input's handler does that; ``causes`` may tell more then.  A timer that
    is not armed is answered as by ``unarmed``.  ``full`` says that the station has no room, though
    the oracle's has (MEM-1).
    """
    state, i = plain(state), plain(i)
    if i[0] == "expire" and (blocked := unarmed(oracle, state, i[1])) is not None:
        return blocked
    facts, wanted, to = Facts(state, i, oracle.constants, full), _words(observed), handler(i)
    best: tuple[tuple[int, bool, int], list[int], Way, Leaf] | None = None
    for way, leaf in ways(HANDLERS[to]):
        if not _does(wanted, leaf, state[0]):
            continue
        against = [n for n, (guard, holds) in enumerate(way) if guard.test(facts) != holds]
        if not against and not full and not _happens(oracle, state, i, wanted):
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
    state, timer = plain(state), plain(timer)
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
    """Which inputs would have led to what was observed, at most ``MOST``.

    First those that change something, of these timers first.  Empty if none would, if the state is
    not in the oracle, or if something is missing rather than observed.
    """
    at, wanted = _place(oracle, state), _words(observed)
    if at is None or not wanted or wanted[0] in _MISSING:
        return []
    found: list[tuple[bool, int, str]] = []
    for answer in oracle.answers(at):
        i = oracle.inputs[answer.input]
        if _among(wanted, done(oracle, answer), state[0]):
            found.append((not answer.changes, _KINDS.index(i[0]), _input(i, names)))
    return list(dict.fromkeys(text for _, _, text in sorted(found, key=lambda f: f[:2])))[:MOST]


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
    given = list(observed)
    if len(given) > 1 and isinstance(given[1], Mapping):  # a message or a timer of a log
        m = given[1]
        given[1:] = [m["name"]] if "name" in m else _message(m)
    words = [str(word) for word in given if word not in (None, "", "none")]
    if words[:1] == ["indication"]:
        words[0] = "told"
    if "Acceptance" in words:
        answer = {"True": "accepted", "False": "refused"}
        words = [answer.get(word, word) for word in words]
    return words


def _message(m: Mapping[str, Json]) -> list[Json]:
    answer = [m["accepted"]] if m["type"] == "Acceptance" and "accepted" in m else []
    return [m["type"], *answer, m.get("reason")]


def _does(wanted: list[str], leaf: Leaf, phase: str) -> bool:
    """Whether a leaf may do what is wanted."""
    surely = {text for text in leaf.does if not text.endswith("?")}
    if wanted[0] in _MISSING:
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
    at, place_ = _place(oracle, state), oracle.input_index.get(canonical(i))
    answer = None if at is None or place_ is None else oracle.answer(at, place_)
    return answer is not None and _among(wanted, done(oracle, answer), state[0])


def _place(oracle: Oracle, state: Json) -> int | None:
    """The place of a state in the oracle; the order of its outbox does not matter."""
    outbox = sorted(plain(state[11]), key=canonical) if len(state) > 11 else []
    return oracle.state_index.get(canonical([*state[:11], outbox, *state[12:]]))


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
