"""Cases that no graph carries: durations of timers, simultaneous events, malformed messages and
bounds, contents, CAMs, the back-off, one session after another. Each is a list of exchanges in
natural time.

The expected answers come from the oracle, as in a tour; a script (scripts.py) leads to the
beginning of the case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache, partial
from itertools import pairwise

from automcm_conformance.adapter.protocol import read_answer
from automcm_conformance.exchange.answers import BACK_OFF, Problem
from automcm_conformance.exchange.exchange import Exchange, Mismatch, Step, Wrong
from automcm_conformance.exchange.malformed_messages import edge_cases, invalid
from automcm_conformance.exchange.wire import LONG_MS
from automcm_conformance.suite import quantity_cases, session_cases
from automcm_conformance.suite import scripts as s
from automcm_conformance.suite.scripted import Fresh, Played, inputs, number, play, played
from automcm_spec.graph.growing_graph import GrowingGraph
from automcm_spec.graph.oracle import Oracle, load
from automcm_spec.graph.oracle_generation import TWO_PEERS
from automcm_spec.vocabulary.messages import RELIABLE

SETS: tuple[dict[str, int], ...] = (
    {},
    {"t_timeout": 1000, "t_decide": 170},
    {"t_timeout": 0, "t_cam_loss": 1001},
    {"t_timeout": 250, "t_resend": 61, "t_decide": 2500, "t_cam_loss": 3000},
)
"""Parameters of the timing cases, besides the defaults. Half of 61 ms is rounded."""
LEASE_MS = 901
"""A lease whose margin is rounded (ACT-4)."""
DRIFTS: tuple[tuple[dict[str, int], int], ...] = (
    ({"clock_drift": 1}, LEASE_MS),
    ({"clock_drift": 7, "t_resend": 60}, LEASE_MS),
    ({"clock_drift": 1}, 1),
    ({"clock_drift": 99}, 100),
)
"""Parameters and leases of the lease cases, for a station with the feature ``clock_drift`` (ACT-4).
The margin of the last two is the whole lease."""
LIMITS = {"max_rounds": 3, "max_participants": 5, "outbox_limit": 7, "memory_limit": 4}
"""With these, a session needs an outbox of one entry, as in the graphs (MEM-1)."""
SEEDS, DRAWS = 8, 32
"""A fair station draws one of two values 32 times in a row with odds of 1 in 2 * 10^9."""


def timer(fresh: Fresh, name: str) -> Played:
    """``timer NAME``: nothing happens a millisecond before the deadline, everything at it, with
    several sets of parameters."""
    ends = name.startswith("lease")
    cases = [(changed, LEASE_MS if ends else LONG_MS) for changed in SETS]
    for changed, lease_ms in [*cases, *DRIFTS] if ends else cases:
        for script in s.TIMERS[name]:
            x = fresh(s.USUAL | changed)
            fits = changed.keys() <= x.parameters.keys()
            yield played(x, script, lease_ms) if fits else None


def sendings(fresh: Fresh, t_timeout: str) -> Played:
    """``sendings N``: every message is sent exactly as often as section 3 requires."""
    for name in RELIABLE:
        for script in s.TIMERS[f"giveup {name}"]:
            x = fresh(s.USUAL | {"t_timeout": int(t_timeout)})
            yield played(x, [*script, s.Wait(1000)])


def content(fresh: Fresh, type_: str) -> Played:
    """``content TYPE``: the application's content arrives unchanged, in every copy."""
    for rich in (False, True):
        for script in s.CONTENT[type_]:
            yield played(fresh(s.USUAL, rich=rich), script)


def plain(fresh: Fresh, case: str) -> Played:
    """A case that consists only of scripts."""
    for changed in ({}, DRIFTS[1][0]) if case.startswith("cam ahead") else ({},):
        for script in s.PLAIN[case]:
            x = fresh(s.USUAL | changed)
            fits = changed.keys() <= x.parameters.keys()
            yield played(x, script, _lease(script)) if fits else None


def _lease(script: s.Script) -> int:
    """The lease in ms: long, unless the script waits for its end."""
    return (
        LEASE_MS if any(isinstance(v, s.At) and v.timer == ("lease",) for v in script) else LONG_MS
    )


# -- malformed, and bounds


def malformed(fresh: Fresh, type_: str) -> Played:
    """``malformed TYPE``: each message is discarded and changes nothing; the valid one counts."""
    script, good, _ = s.RECEIVED[type_]
    x = fresh(s.USUAL)
    play(x, script)
    for what, message in invalid(x.wire.command(good, x.now)["message"]):
        x.malformed(message, f"{type_} with {what}")
    try:
        x.flush()
    except Wrong as error:
        wrong = _alone(fresh, script, error.steps[-1]) or error
        wrong.args = (f"{wrong.steps[-1].fault or type_}: {wrong}",)
        raise wrong from None
    x.give(number(x, good))
    x.flush()
    yield x


def _alone(fresh: Fresh, script: s.Script, step: Step) -> Wrong | None:
    """The failure if this malformed message is the only one; None if there is none."""
    if not step.fault:
        return None
    x = fresh(s.USUAL)
    try:
        play(x, script)
        x.malformed(step.command["message"], step.fault)
        x.flush()
    except Wrong as error:
        return error
    return None


def bounds(fresh: Fresh, type_: str) -> Played:
    """``bounds TYPE``: a message with an unusual valid value counts like any other."""
    script, good, after = s.RECEIVED[type_]
    for what, fields in edge_cases(fresh(s.USUAL).wire.command(good, 0)["message"]):
        try:
            yield played(fresh(s.USUAL), [*script, s.With(fields, good), *after])
        except Wrong as error:
            error.args = (f"{type_} with {what}: {error}",)
            raise


def _received(type_: str) -> list[s.Script]:
    script, good, _ = s.RECEIVED[type_]
    return [[*script, good]]


def room(fresh: Fresh) -> Played:
    """``room``: the free space in the outbox follows from the larger of the two limits."""
    for script in s.ROOM:
        x = fresh(s.USUAL, limits=LIMITS)
        fits = all(x.parameters[name] == limit for name, limit in LIMITS.items())
        yield played(x, script) if fits else None


# -- CAMs and the back-off


def cam_rate(fresh: Fresh) -> Played:
    """``cam rate``: one CAM every ``t_cam`` (50 % tolerance), in every phase."""
    for t_cam in (100, 400):
        for script in ([], s.WAITING):
            x = fresh(s.USUAL | {"t_cam": t_cam})
            play(x, script)
            x.wait(x.now + 12 * x.parameters["t_cam"])
            x.flush()
            times = [
                cam["generation_ms"] for step in x.done for cam in read_answer(step.answer).cams
            ]
            gaps = [later - earlier for earlier, later in pairwise(times)]
            period = x.parameters["t_cam"]
            if len(times) < 10 or any(abs(gap - period) > period / 2 for gap in gaps):
                text = f"expected a CAM every {period} ms, got CAMs at {times} ms"
                raise Mismatch(x.done, [Problem("cams", text, "interval of CAMs")])
            yield x


def back_off(fresh: Fresh) -> Played:
    """``back-off``: within its bounds, both included, equal for equal seeds, not always equal."""
    parameters = s.USUAL | {"backoff_min": 500, "backoff_max": 2000}
    found: dict[int, int] = {}
    for seed in [*range(1, SEEDS + 1), *range(1, SEEDS + 1)]:
        x = fresh(parameters, seed=seed)
        low, high, lasts = _draw(x)
        if found.setdefault(seed, lasts) != lasts:
            raise _wrong(x, f"seed {seed}: back-offs of {found[seed]} and {lasts} ms in two runs")
        if len(found) == SEEDS and low < high and len(set(found.values())) == 1:
            raise _wrong(x, f"a back-off of {lasts} ms for every seed")
        x.give(number(x, s.REQUEST))
        play(x, [s.expire("backoff"), s.REQUEST])
        yield x
    x = fresh(s.USUAL | {"t_timeout": 0, "backoff_min": 500, "backoff_max": 501})
    drawn = set[int]()
    for _ in range(DRAWS):
        low, high, lasts = _draw(x)
        drawn.add(lasts)
        x.expire(number(x, s.expire("backoff")))
    if high == low + 1 and len(drawn) == 1:
        raise _wrong(x, f"expected back-offs of {low} and {high} ms, got {lasts} ms {DRAWS} times")
    yield x


def _draw(x: Exchange) -> tuple[int, int, int]:
    """A session without participants: the bounds of the back-off after it, and what it lasts.
    Raises Mismatch and Broken."""
    x.give(number(x, s.REQUEST))
    x.expire(number(x, s.WINDOW))
    x.flush()
    deadline = read_answer(x.done[-1].answer).deadline
    low, high = x.parameters["backoff_min"], x.parameters["backoff_max"]
    lasts = -1 if deadline is None else deadline - x.now
    if not low <= lasts <= high:
        got = "none" if lasts < 0 else f"{lasts} ms"
        raise _wrong(x, f"expected a back-off of {low} to {high} ms, got {got}")
    x.clock.learn(("backoff",), deadline or 0)
    return low, high, lasts


def _wrong(x: Exchange, text: str) -> Mismatch:
    return Mismatch(x.done, [Problem("deadline", text, BACK_OFF)])


# -- which case is which


TWO = ("sessions ", "two ")
"""The first words of the cases that need a second peer."""
_ABOUT: dict[str, tuple[Callable[[Fresh, str], Played], Callable[[str], Iterable[s.Script]]]] = {
    "timer": (timer, s.TIMERS.__getitem__),
    "sendings": (sendings, lambda _: (s.ACTING, s.COMMITTED)),
    "malformed": (malformed, _received),
    "bounds": (bounds, _received),
    "content": (content, s.CONTENT.__getitem__),
    "sessions": (session_cases.pairs, session_cases.scripts),
    "quantity": (quantity_cases.exchanges, quantity_cases.scripts),
}
"""The function and the scripts of a case, by its first word."""
_ALONE: dict[str, tuple[Callable[[Fresh], Played], Sequence[s.Script]]] = {
    "cam rate": (cam_rate, [s.WAITING]),
    "back-off": (back_off, [[s.REQUEST]]),
    "room": (room, s.ROOM),
}


def _of(case: str) -> tuple[Callable[[Fresh], Played], Iterable[s.Script]]:
    """The function and the scripts of a case. Raises KeyError for an unknown case."""
    if case in s.PLAIN:
        return partial(plain, case=case), s.PLAIN[case]
    if case in _ALONE:
        return _ALONE[case]
    name, _, about = case.partition(" ")
    played_about, scripts_about = _ABOUT[name]
    return lambda fresh: played_about(fresh, about), scripts_about(about)


def exchanges(case: str, fresh: Fresh) -> Played:
    """The exchanges of a case. Raises Mismatch, Broken, and KeyError for an unknown case."""
    return _of(case)[0](fresh)


def graph(case: str, one: Oracle) -> Oracle:
    """The graph that judges a case: ``one``, that of two peers, or one that grows."""
    if case.startswith("quantity ") or case == "back-off":
        return GrowingGraph(one.spec_hash)
    return two_peers(one.spec_hash) if case.startswith(TWO) else one


@cache
def two_peers(spec_hash: str) -> Oracle:
    """The graph of two peers, read once in a process."""
    return load(TWO_PEERS.path, spec_hash)


def needs(case: str) -> set[str]:
    """The features that a case needs."""
    values = [value for script in _of(case)[1] for value in inputs(script)]
    features = {s.REQUEST: "prescriber", s.ADVERTISED: "receiver", s.RESTART: "restart"}
    found = {feature for value, feature in features.items() if value in values}
    return found | ({"cam"} if case in ("cam rate", "cam marks") else set())
