"""Explains a divergence: the nearest allowed behaviour, the blocking guard, other possible causes.

It searches for the conditions of the compiled specification that would have to be different to
allow the logged event (``automcm_spec.vocabulary.conditions``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

from automcm_spec.log_format.log import CamFields, ForgetTimer, MessageKey, MessageTimer, Part
from automcm_spec.vocabulary.conditions import Condition, Evaluated, blocking_conditions, record
from automcm_spec.vocabulary.messages import Ack, Fields, Message
from automcm_spec.vocabulary.rules import RULES, handler, kind
from automcm_spec.vocabulary.station import Entry, Expire, Input, Outcome, State, Station, Timer
from automcm_traces.checker.finding import Diverges, Finding
from automcm_traces.checker.input_alphabet import SOMEBODY, alphabet
from automcm_traces.checker.track import (
    NO_INDICATION,
    NUMBERED,
    PHASES,
    ROLES,
    Limits,
    Track,
    short,
)

Action = tuple[str, ...]
"""An effect or state of a station: ``("send", "Acceptance", "refused", "busy")``, ``("indication",
"verify")``, ``("arm", "hold")``, ``("phase", "WAITING")``; or the lack of one: ``("without",
…)``."""
MOST = 8
"""The maximum number of inputs listed."""
KINDS = ("expire", "command", "receive", "cam", "restart")
"""The kinds of input, in listing order."""


def explained(found: Finding, d: Diverges, track: Track) -> Finding:
    """What was found at a divergence, with why; the station was in the state of ``track``."""
    decided, broken = found.rule, _broken(d, track)
    found = _explained(replace(found, state=_state(track)), d, track)
    text = found.guard.removeprefix(f"{decided}: {RULES.get(decided, '')}")
    return replace(found, guard=f"{broken}: {RULES[broken]}{text}") if broken else found


def _broken(d: Diverges, track: Track) -> str:
    """The rule that is broken, if it is not the one by which the specification decides the input:
    it does not distinguish why a station is in quarantine. Else empty."""
    step = d.step
    if step is None or step.input.kind == "restart":
        return ""
    if _wanted(d) == ("without", "arm", "quarantine"):
        return "ACT-6"
    quarantined = step.rule == "END-8" and track.state.quarantine
    return track.quarantine.rule if quarantined and track.quarantine else ""


def _explained(known: Finding, d: Diverges, track: Track) -> Finding:
    wanted = _wanted(d)
    if d.missed:
        return replace(known, nearest=d.missed)
    if wanted == ("arm", "cam") and (ignored := _ignored_cam(d, track)):
        return replace(known, nearest=ignored)
    if not wanted or wanted == ("send", "CAM") or "deadline" in wanted or "quarantine" in wanted:
        return known
    question = Question(track, d.step.given, d.step.content) if d.step else Question(track)
    seen = d.seen[1] if d.seen is not None else ""
    if wanted[0] == "expire" and isinstance(seen, Part):
        timer = track.timer_of(seen)
        if timer is None or not (nearest := question.unarmed(timer)):
            return known
        phases = question.arms(timer) if len(timer) == 1 else []
        into = (f"a step into {', '.join(phases)}",) if phases else ()
        return replace(known, nearest=nearest, causes=into)
    if d.step is not None and (nearest := question.nearest(d.step.input, wanted)):
        return replace(known, nearest=nearest)
    if wanted[0] == "without" or wanted[1] in track.state[:2]:
        return known
    named: set[int] = set()
    dst: object = 0
    match seen:
        case {**message}:
            dst = message.get("dst", 0)
            named = {dst} if isinstance(dst, int) else named
        case ForgetTimer(station=int(station)):
            named = {station}
    near = sorted(alphabet(track, named), key=_order)
    causes = question.causes(near, wanted, dst)
    nearest = "" if causes else Question(track).elsewhere(near, wanted)
    return replace(known, nearest=nearest, causes=causes, of_last_input=False)


@dataclass(frozen=True, slots=True)
class Block:
    """The guards that block the observed event, and the outcome without them."""

    outcome: Outcome
    guards: list[Evaluated]
    """The guards in evaluation order, with the values inside them."""
    distance: tuple[bool, bool, int]
    """The sort key: the block with the smallest distance is the best."""


@lru_cache(maxsize=4096)  # the tries of ``trace shrink`` diverge in equal states
def _smallest_block(
    limits: Limits, me: int, st: State, i: Input, wanted: Action, most: int
) -> Block | None:
    """The smallest set of guards that block the wanted action.

    Of several sets, those that involve the memory limits (MEM-1) or a message that breaks the
    protocol (END-5) come last; then the one whose first guard is evaluated latest comes first.
    """
    station = Station(*limits)

    def query(station: Station) -> Outcome:
        return station.step(me, st, i)

    blocks = []
    for choice in blocking_conditions(station, query, lambda o: _does(wanted, o), most):
        flipped = {t.condition for t in choice}
        outcome, evaluated = record(station, query, flipped)
        first = next((n for n, t in enumerate(evaluated) if t.condition in flipped), 0)
        broken = any(t.condition.operator == "OnMessage" for t in choice)
        distance = outcome.rule == "MEM-1", broken, -first
        blocks.append(Block(outcome, _with_values(evaluated, flipped), distance))
    return min(blocks, key=lambda block: block.distance, default=None)


class Question:
    """Queries to the specification about one state of a station.

    ``given`` is the received message, if any, ``content`` the content from the application.
    """

    def __init__(
        self, track: Track, given: Message | CamFields | None = None, content: Fields | None = None
    ) -> None:
        self._track = track
        self._given: dict[str, object] = {}
        for name in ("seq", "reason"):
            value = getattr(given, name, (content or {}).get(name))
            self._given |= {} if value is None else {name: value}
        if isinstance(given, Ack):  # an unlogged Ack names nothing
            self._given |= {"of": f"{given.of.type} seq={given.of.seq}", "of[2]": given.of.seq}
        self._station = Station(*track.limits)

    def nearest(self, i: Input, wanted: Action) -> str:
        """How this input could have led to the wanted action; empty if it never does."""
        block = self._block(i, wanted, 3)
        return "" if block is None else self._nearest_text(block, i, wanted)

    def unarmed(self, timer: Timer) -> str:
        """The conditions that keep a timer from being armed; empty if the state decides none."""
        me, st = self._track.me, self._track.state

        def query(station: Station) -> frozenset[Timer]:
            return station.armed(me, st)

        found = blocking_conditions(self._station, query, lambda armed: timer in armed, kind="part")
        if not found or not found[-1]:
            return ""
        flipped = {t.condition for t in found[-1]}
        guards = _with_values(record(self._station, query, flipped)[1], flipped)
        to = handler(Expire("expire", timer))
        return f"nearest allowed: expire {short(timer)} ({to}) {self._blocked(guards, to)}"

    def arms(self, timer: Timer) -> list[str]:
        """The phases in which this timer can be armed."""
        me, st = self._track.me, self._track.state
        values = product(PHASES, ROLES, (False, True))
        other = (st._replace(phase=p, role=role, deciding=d) for p, role, d in values)
        return sorted({each.phase for each in other if timer in self._station.armed(me, each)})

    def causes(self, near: Sequence[Input], wanted: Action, dst: object) -> tuple[str, ...]:
        """Those of these inputs that would have led to the wanted action, at most ``MOST``.

        Inputs that change something come first. ``dst`` is the required addressee of a message.
        """
        me, st = self._track.me, self._track.state
        found: list[tuple[bool, str]] = []
        for i in near:
            outcome = self._station.step(me, st, i)
            out = frozenset(m for m in outcome.out if m.dst == dst)
            if _does(wanted, outcome._replace(out=out)):
                found.append((outcome.st == st and not outcome.arm, _input(i)))
        found.sort(key=lambda one: one[0])
        return tuple(dict.fromkeys(text for _, text in found))[:MOST]

    def elsewhere(self, near: Sequence[Input], wanted: Action) -> str:
        """Which of these inputs comes nearest to the wanted action, and the guards that block it.

        Empty if none does, or if more than two guards block it.
        """
        for most in range(3):
            blocks = [(b, i) for i in near if (b := self._block(i, wanted, most))]
            if blocks:
                block, i = min(blocks, key=lambda found: found[0].distance)
                return self._nearest_text(block, i, wanted, f" by {_input(i)},") if most else ""
        return ""

    def _block(self, i: Input, wanted: Action, most: int) -> Block | None:
        track = self._track
        return _smallest_block(track.limits, track.me, track.state, i, wanted, most)

    def _nearest_text(self, block: Block, i: Input, wanted: Action, by: str = "") -> str:
        to = handler(i)
        what = f"nearest allowed: {block.outcome.rule} {' '.join(wanted)} ({to}){by}"
        if not block.guards:
            return f"{what}, but not in this form, or not again"
        return f"{what} {self._blocked(block.guards, to)}"

    def _blocked(self, guards: Sequence[Evaluated], to: str) -> str:
        return "blocked " + "; and ".join(f"by guard {self._guard(t, to)}" for t in guards)

    def _guard(self, evaluated: Evaluated, to: str) -> str:
        operator, line, _, _, text = evaluated.condition
        inside = f" of {operator}" if operator != to else ""
        must = "must not hold" if evaluated.value else "must hold"
        values = [f"{name} = {self._value(name, value)}" for name, value in evaluated.values]
        shown = f": {', '.join(values)}" if values else ""
        return f"{text}{inside}, which {must}{shown}  Station.tla:{line}"

    def _value(self, name: str, value: object) -> str:
        """A value in the form of the log, if it has one."""
        record_, _, field = name.rpartition(".")
        value = self._given.get(field, value) if record_ == "m" else value
        if field in ("target", "dst", "to") and value == 0:
            return "all" if field == "dst" else "nobody"
        return self._plain(value)

    def _plain(self, value: object) -> str:
        match value:
            case bool():
                return str(value).upper()
            case frozenset():
                return "{" + ", ".join(map(self._plain, sorted(value))) + "}"
            case Entry():
                return self._entry(value)
            case (0, 0):
                return "none"
            case (int(p), int(number)):
                return f"{p}/{number}" if p != SOMEBODY else "another one"
            case int() if value == SOMEBODY:
                return _station(value)
        return str(value)

    def _entry(self, e: Entry) -> str:
        number = f" proposal={e.seq}" if e.type in NUMBERED else ""
        sent = next((x.message.seq for x in self._track.outbox if x.spec == e), e.seq)
        return f"{e.type} to {e.to} session={self._plain(e.session)}{number} seq={sent}"


def _with_values(evaluated: Sequence[Evaluated], flipped: set[Condition]) -> list[Evaluated]:
    """The flipped conditions, each with the values of the parts evaluated before it: these show
    what is inside the operators that it names."""
    found, inside = [], dict[str, object]()
    for t in evaluated:
        inside |= {name: value for name, value in t.values if _lasting(name)}
        if t.condition in flipped:
            found.append(t._replace(values=tuple((dict(t.values) | inside).items())))
        if t.condition.kind != "part" or t.condition in flipped:
            inside.clear()
    return found


def _lasting(name: str) -> bool:
    """Whether a name means the same in every operator."""
    return name[0].isupper() or name.split(".")[0] in ("st", "m", "c", "i")


# -- the observed event, and the effects of an input


def _wanted(d: Diverges) -> Action:
    """The logged event that is not expected, or the first expected effect that is missing."""
    match d.seen:
        case ("send", {**m}):
            return ("send", *_message(m.get))
        case (op, MessageTimer(message=MessageKey(type=type_)) as timer):
            return (op, f"{timer.name}({type_})")
        case (op, Part() as timer):
            return (op, timer.name)
        case (what, name):
            return (what, str(name))
    step = d.step
    if step is None:
        return ()
    if step.messages:
        return ("without", "send", step.messages[0].value.type)
    for op, pool in (("arm", step.arm), ("stop", step.stop)):
        if pool:
            return ("without", op, short(pool[0]))
    return ("without", "indication", *step.indications[:1])


def _message(get: Callable[[str], object]) -> Iterator[str]:
    """The words for a message, from its fields."""
    yield str(get("type"))
    if get("type") == "Acceptance":
        yield "accepted" if get("accepted") else "refused"
    if get("reason") not in (None, "none"):
        yield str(get("reason"))


def _does(wanted: Action, outcome: Outcome) -> bool:
    """Whether an outcome includes the wanted action; a shorter action matches all that begin with
    it."""
    if wanted[0] == "without":
        return not _does(wanted[1:], outcome)
    return any(
        len(wanted) <= len(done)
        and all(a == b or b == "as_sent" for a, b in zip(wanted, done, strict=False))
        for done in _done(outcome)
    )


def _done(outcome: Outcome) -> Iterator[Action]:
    for m in outcome.out:
        yield ("send", *_message(m._asdict().get))
    if outcome.told != NO_INDICATION:
        yield ("indication", *outcome.told)
    yield ("phase", outcome.st.phase)
    yield ("role", outcome.st.role)
    yield from (("arm", short(timer)) for timer in outcome.arm)
    yield from (("stop", short(timer)) for timer in outcome.stop)


def _order(i: Input) -> tuple[int, str]:
    """A fixed sort key."""
    return KINDS.index(i.kind), repr(i)


def _input(i: Input) -> str:
    """An input as text, without details that seldom matter."""
    match i.kind:
        case "receive":
            m = i.message
            answer = " (accepted)" if m.accepted else " (refused)"
            extra = answer if m.type == "Acceptance" else ""
            return f"{kind(i)} from {_station(m.src)}{extra}"
        case "cam":
            return f"{kind(i)} from {_station(i.src)}"
        case "expire":
            return f"expire {short(i.timer)}"
    return kind(i)


def _station(p: int) -> str:
    return "another station" if p == SOMEBODY else str(p)


def _state(t: Track) -> str:
    """A station's state on one line, without empty fields."""
    st = t.state
    words = [st.phase]
    if t.session is not None:
        words.append(f"{st.role} of {t.session[0]}/{t.session[1]}")
    for name, value in (
        ("target", st.target),
        ("proposal", st.proposal),
        ("recorded", sorted(st.recorded)),
        ("withdrawn", sorted(st.withdrawn)),
        ("outbox", [f"{e.spec.type} to {e.spec.to} seq={e.message.seq}" for e in t.outbox]),
    ):
        if value:
            text = str(value) if isinstance(value, int) else ", ".join(map(str, value))
            words.append(f"{name} {text}")
    words += ["deciding"] if st.deciding else []
    words += ["in back-off"] if st.backoff else []
    if st.quarantine and (q := t.quarantine) is not None:
        lasts = "" if q.lasts_ms is None else f", for {q.lasts_ms} ms"
        words.append(f"in quarantine by {q.rule} since line {q.line}{lasts}")
    return "; ".join(words)


def _ignored_cam(d: Diverges, track: Track) -> str:
    """Why the received CAM of this step does not count (ACT-5); empty if it does."""
    m = None if d.step is None else d.step.given
    if d.step is None or d.step.input.kind != "cam" or not isinstance(m, CamFields):
        return ""
    if d.step.input.newer or not d.step.input.marks:
        return ""
    generated, most = m["generation_ms"], track.latest_cam(d.step.t_ms)
    if most is not None and generated > most:
        ahead = f"generation_ms {generated} is {generated - most} ms more than {most}"
        return f"the CAM of line {d.step.at} does not count: {ahead}, the bound (ACT-5.3)"
    last = f"that of line {track.last_cam_line}, {track.last_cam_ms}"
    age = f"generation_ms {generated} is not newer than {last}"
    return f"the CAM of line {d.step.at} does not count: {age} (ACT-5)"
