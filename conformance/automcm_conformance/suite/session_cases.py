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
from automcm_conformance.suite.scripted import Fresh, Played, number, room
from automcm_conformance.suite.scripts import (
    MINE,
    REQUEST,
    RESTART,
    THEIRS,
    USUAL,
    WINDOW,
    WITHDRAWN,
    Script,
    Y,
    cam,
    command,
    expire,
    received,
)
from automcm_spec.graph.oracle import Oracle
from automcm_spec.vocabulary.station import Cam, Command, Expire, Input, Message, Receive, Session

Z = 3
PAUSE_MS = 7
SHARES = 9
SHORT_MS = 900
"""A lease that ends before the other timers of ACTUATING."""
ROLES = ("prescriber", "receiver")


def as_prescriber(
    session: Session, peer: int, refused: bool, closes: Input = WINDOW
) -> list[Input]:
    """An own session, up to the Ack of the Fin; ``refused``: the first proposal is refused;
    ``closes``: ends the advertising window."""
    k = 2 if refused else 1
    rounds: list[Input] = [
        received("Acceptance", session, 1, source=peer),
        command("prescribe", session, 2, peer),
    ]
    return [
        REQUEST,
        received("Intention", session, source=peer),
        closes,
        command("prescribe", session, 1, peer),
        received("Ack", session, of=("Prescription", 1), source=peer),
        *(rounds if refused else []),
        received("Acceptance", session, k, accepted=True, source=peer),
        cam(peer, session),
        cam(peer, session),
        command("complete", session),
        received("Ack", session, of=("Fin", 1), source=peer),
    ]


def as_receiver(session: Session, refuses: bool) -> list[Input]:
    """A session of another station, up to its Fin; ``refuses``: the first proposal is refused."""
    peer, k = session[0], 2 if refuses else 1
    rounds: list[Input] = [
        command("refuse", session, 1),
        received("Prescription", session, 2, source=peer),
    ]
    return [
        received("Advertisement", session, source=peer),
        received("Ack", session, of=("Intention", 1), source=peer),
        received("Prescription", session, 1, source=peer),
        *(rounds if refuses else []),
        command("accept", session, k),
        received("Ack", session, of=("Acceptance", k), source=peer),
        cam(peer, session),
        cam(peer, session),
        received("Fin", session, source=peer),
    ]


def scripts(about: str) -> Iterator[Script]:
    """The scripts of the two roles' sessions."""
    roles = about.split()
    if "restart" in roles:
        yield [RESTART]
    if {"prescriber", "restart"} & {*roles}:
        yield as_prescriber(MINE, Y, True)
    if {"receiver", "restart"} & {*roles}:
        yield as_receiver(THEIRS, True)


def pairs(fresh: Fresh, about: str) -> Played:
    """``sessions FIRST SECOND``: two roles. ``sessions restart``: either, and power fails."""
    restarts = about == "restart"
    firsts, seconds = (ROLES, ROLES) if restarts else ([role] for role in about.split())
    x = fresh(USUAL)
    rounds = x.parameters["max_rounds"]
    ends = [
        (first, [*begin, end])
        for first in firsts
        for begin in _begins(first, rounds)
        for end in _ends(x.oracle, begin, restarts)
    ]
    ways = itertools.product(ends, seconds, (Y, Z), (False, True))
    for n, ((first, ended), second, peer, short) in enumerate(ways):
        x = fresh(USUAL)
        try:
            for value in ended:
                _take(x, value, LONG_MS if short else SHORT_MS)
            refused = short and rounds > 1
            _follow(x, second, peer, refused, SHORT_MS if short else LONG_MS, {first, second}, n)
        except Infeasible:
            yield None
        else:
            yield x


def _begins(role: str, rounds: int) -> list[list[Input]]:
    """Ways into each state of a session."""
    found: dict[tuple[Input, ...], list[Input]] = {}
    for refused in (False, True)[:rounds]:
        if role == "receiver":
            whole = as_receiver(THEIRS, refused)
        else:
            whole = as_prescriber(MINE, Y, refused)
            for n in (1, 2, 3):
                withdrawn = [*whole[:n], WITHDRAWN]
                found[tuple(withdrawn)] = withdrawn
        for n in range(1, len(whole)):
            found[tuple(whole[:n])] = whole[:n]
    return list(found.values())


def _ends(oracle: Oracle, begin: Sequence[Input], restarts: bool) -> list[Input]:
    """The inputs that end the session; none if the way to this state ends it."""
    state = oracle.way(oracle.input_index[value] for value in begin)[-1]
    if oracle.states[state].phase == "STANDALONE" or restarts:
        return [RESTART] if restarts else []
    moves = oracle.moves(state).items()
    ends = [oracle.inputs[i] for i, after in moves if oracle.states[after].phase == "STANDALONE"]
    return [value for value in ends if value != RESTART]


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
    sessions = [MINE, THEIRS, session]
    _try(x, sessions, roles, n)
    if role == "receiver" and st.quarantine:
        _take(x, expire("quarantine"), LONG_MS)
    if role == "prescriber" and st.backoff:
        _take(x, expire("backoff"), LONG_MS)
    whole = (
        as_receiver(session, refused)
        if role == "receiver"
        else as_prescriber(session, peer, refused)
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
