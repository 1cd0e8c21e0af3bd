"""Cases ``sessions FIRST SECOND``: the memory of one session must not affect another.

The graph of one station has no hidden memory, so tours do not play one session after another to
look for it. Here each session is ended in every state and in every way, and then a second one is
played in full. In each state of the second, inputs of either session that must change nothing are
given.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

from automcm_conformance.adapter.protocol import NEEDS
from automcm_conformance.exchange.exchange import Exchange, Infeasible
from automcm_conformance.exchange.wire import LONG_MS, ME
from automcm_conformance.suite import scripts as s
from automcm_conformance.suite.scripted import Fresh, Played, number, room
from automcm_spec.graph.oracle import Oracle
from automcm_spec.vocabulary.station import Cam, Command, Expire, Input, Message, Receive, Session

Z = 3
PAUSE_MS = 7
SHARES = 9
SHORT_MS = 900
"""A lease that ends before the other timers of ACTUATING."""
ROLES = ("prescriber", "receiver")


def scripts(about: str) -> Iterator[s.Script]:
    """The scripts of the two roles' sessions."""
    roles = about.split()
    if "restart" in roles:
        yield [s.RESTART]
    if {"prescriber", "restart"} & {*roles}:
        yield s.as_prescriber(s.MINE, s.Y, True)
    if {"receiver", "restart"} & {*roles}:
        yield s.as_receiver(s.THEIRS, True)


def pairs(fresh: Fresh, about: str) -> Played:
    """``sessions FIRST SECOND``: two roles. ``sessions restart``: either, and power fails."""
    restarts = about == "restart"
    firsts, seconds = (ROLES, ROLES) if restarts else ([role] for role in about.split())
    x = fresh(s.USUAL)
    rounds = x.parameters["max_rounds"]
    ends = [
        (first, [*begin, end])
        for first in firsts
        for begin in _begins(first, rounds)
        for end in _ends(x.oracle, begin, restarts)
    ]
    ways = itertools.product(ends, seconds, (s.Y, Z), (False, True))
    for n, ((first, ended), second, peer, short) in enumerate(ways):
        x = fresh(s.USUAL)
        try:
            for value in ended:
                _take(x, value, LONG_MS if short else SHORT_MS)
            refused = short and rounds > 1
            _follow(x, second, peer, refused, SHORT_MS if short else LONG_MS, {first, second}, n)
        except Infeasible:
            yield None
        else:
            yield x


def _begins(role: str, rounds: int) -> list[tuple[Input, ...]]:
    """Ways into each state of a session."""
    found: list[tuple[Input, ...]] = []
    for refused in (False, True)[:rounds]:
        if role == "receiver":
            whole = s.as_receiver(s.THEIRS, refused)
        else:
            whole = s.as_prescriber(s.MINE, s.Y, refused)
            found += [(*whole[:n], s.WITHDRAWN) for n in (1, 2, 3)]
        found += [tuple(whole[:n]) for n in range(1, len(whole))]
    return list(dict.fromkeys(found))


def _ends(oracle: Oracle, begin: Sequence[Input], restarts: bool) -> list[Input]:
    """The inputs that end the session; none if the way to this state ends it."""
    state = oracle.way(oracle.input_index[value] for value in begin)[-1]
    if oracle.states[state].phase == "STANDALONE" or restarts:
        return [s.RESTART] if restarts else []
    moves = oracle.moves(state).items()
    ends = [oracle.inputs[i] for i, after in moves if oracle.states[after].phase == "STANDALONE"]
    return [value for value in ends if value != s.RESTART]


def _take(x: Exchange, value: Input, lease_ms: int) -> None:
    """Give an input after a pause. Other timers due before an expiry fire first. Raises
    Infeasible."""
    i = number(x, value)
    if isinstance(value, Expire):
        x.expire(i, after_others=True)
    else:
        answer = x.oracle.answer(x.state, i)
        if answer is None or answer.effect.rule == "MEM-1":
            raise Infeasible
        x.give(i, lease_ms=lease_ms)
    x.wait(x.now + PAUSE_MS)


def _follow(
    x: Exchange, role: str, peer: int, refused: bool, lease_ms: int, roles: set[str], n: int
) -> None:
    """Play the second session, as far as limits allow it. Raises Infeasible, Mismatch, Broken."""
    st = x.oracle.states[x.state]
    newest = max([n for p, n in st.joined if p == peer], default=0)
    session = (ME, st.number + 1) if role == "prescriber" else (peer, newest + 1)
    if x.parameters["memory_limit"] < 2 or len(st.outbox) > room(x):
        raise Infeasible
    sessions = [s.MINE, s.THEIRS, session]
    _try(x, sessions, roles, n)
    if role == "receiver" and st.quarantine:
        _take(x, s.expire("quarantine"), LONG_MS)
    if role == "prescriber" and st.backoff:
        _take(x, s.expire("backoff"), LONG_MS)
    whole = (
        s.as_receiver(session, refused)
        if role == "receiver"
        else s.as_prescriber(session, peer, refused)
    )
    for value in whole:
        _take(x, value, lease_ms)
        _try(x, sessions, roles, n)
    x.flush()


def _try(x: Exchange, sessions: list[Session], roles: set[str], n: int) -> None:
    """The inputs that must change nothing here; each exchange tries another part of them."""
    commands = {"abort", *(name for name, feature in NEEDS.items() if feature in roles)}
    for i in range(n % SHARES, len(x.oracle.inputs), SHARES):
        answer = x.oracle.answer(x.state, i)
        if answer is None or answer.changes or answer.effect.rule == "MEM-1":
            continue
        match x.oracle.inputs[i]:
            case Receive(message=Message(type="Advertisement"), concerned=True) if (
                "receiver" not in roles
            ):
                continue
            case Receive(message=Message(src=2 | 3, dst=0 | 1, session=session)) if (
                session in sessions
            ):
                x.give(i)
            case Cam(src=2 | 3):
                x.give(i)
            case Command(name=name, session=session) if name in commands and session in sessions:
                x.give(i)
