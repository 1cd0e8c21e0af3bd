"""Cases ``sessions FIRST SECOND``: a session is not touched by what a station remembers of another.

The graph of one station knows no memory but its state, so a tour never plays one session after
another just to see whether the first one shows.  Here each session is ended wherever and however
it can end, and then a second one is played in full.  In each state of the second everything comes
that must change nothing: messages and commands of either session.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

from automcm_conformance.exchange import Exchange, Infeasible
from automcm_conformance.scripted import Fresh, Played, number, room
from automcm_conformance.scripts import (
    MINE,
    REQUEST,
    THEIRS,
    USUAL,
    WINDOW,
    Script,
    Y,
    command,
    received,
)
from automcm_conformance.wire import LONG_MS, ME
from automcm_spec.oracle import Oracle, canonical

Json = Any
Z = 3
PAUSE_MS = 7
SHARES = 9
SHORT_MS = 900
"""A lease that ends before the other timers of ACTUATING."""
COMMANDS = {
    "prescriber": ("request", "prescribe", "proceed", "complete", "abort"),
    "receiver": ("accept", "refuse", "abort"),
}
ROLES = ("prescriber", "receiver")


def as_prescriber(session: Json, peer: int, refused: bool) -> Script:
    """A session of the station's own, up to the Ack of the Fin; first refused once, if so."""
    k = 2 if refused else 1
    rounds = [
        received("Acceptance", session, 1, source=peer),
        command("prescribe", session, 2, peer),
    ]
    return [
        REQUEST,
        received("Intention", session, source=peer),
        WINDOW,
        command("prescribe", session, 1, peer),
        received("Ack", session, of=["Prescription", 1], source=peer),
        *(rounds if refused else []),
        received("Acceptance", session, k, accepted=True, source=peer),
        ["cam", peer, [session], True],
        ["cam", peer, [session], True],
        command("complete", session),
        received("Ack", session, of=["Fin", 1], source=peer),
    ]


def as_receiver(session: Json, refuses: bool) -> Script:
    """A session of another, up to its Fin; it refuses first, if so."""
    peer, k = session[0], 2 if refuses else 1
    rounds = [command("refuse", session, 1), received("Prescription", session, 2, source=peer)]
    return [
        received("Advertisement", session, source=peer),
        received("Ack", session, of=["Intention", 1], source=peer),
        received("Prescription", session, 1, source=peer),
        *(rounds if refuses else []),
        command("accept", session, k),
        received("Ack", session, of=["Acceptance", k], source=peer),
        ["cam", peer, [session], True],
        ["cam", peer, [session], True],
        received("Fin", session, source=peer),
    ]


def scripts(case: str) -> Iterator[Script]:
    """What the sessions of a case are made of."""
    roles = case.split()[1:]
    if "restart" in roles:
        yield [["restart"]]
    if {"prescriber", "restart"} & {*roles}:
        yield as_prescriber(MINE, Y, True)
    if {"receiver", "restart"} & {*roles}:
        yield as_receiver(THEIRS, True)


def pairs(fresh: Fresh, about: str) -> Played:
    """``sessions FIRST SECOND``: two roles.  ``sessions restart``: either, and power fails."""
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


def _begins(role: str, rounds: int) -> list[Script]:
    """Ways into each state of a session."""
    found: dict[str, Script] = {}
    for refused in (False, True)[:rounds]:
        if role == "receiver":
            whole = as_receiver(THEIRS, refused)
        else:
            whole = as_prescriber(MINE, Y, refused)
            for n in (1, 2, 3):
                withdrawn = [*whole[:n], received("Cancel", MINE)]
                found[canonical(withdrawn)] = withdrawn
        for n in range(1, len(whole)):
            found[canonical(whole[:n])] = whole[:n]
    return list(found.values())


def _ends(oracle: Oracle, begin: Script, restarts: bool) -> list[Json]:
    """The inputs that end the session; nothing if the way there ends it."""
    state = 0
    for value in begin:
        answer = oracle.answer(state, oracle.input_index[canonical(value)])
        assert answer is not None
        state = answer.next
    if oracle.states[state][0] == "STANDALONE" or restarts:
        return [["restart"]] if restarts else []
    moves = oracle.moves(state).items()
    ends = [oracle.inputs[i] for i, after in moves if oracle.states[after][0] == "STANDALONE"]
    return [value for value in ends if value != ["restart"]]


def _take(x: Exchange, value: Json, lease_ms: int) -> None:
    """An input, and a pause.  Before an expiry whatever else is due comes.  Raises Infeasible."""
    i = number(x, value)
    if value[0] == "expire":
        fired: list[int] = []
        while i not in fired:
            if x.deadline(value[1]) is None or x.next_due is None:
                raise Infeasible
            fired = x.advance(x.next_due)
    else:
        answer = x.oracle.answer(x.state, i)
        if answer is None or answer.effect.rule == "MEM-1":
            raise Infeasible
        x.give(i, lease_ms=lease_ms)
    x.wait(x.now + PAUSE_MS)


def _follow(
    x: Exchange, role: str, peer: int, refused: bool, lease_ms: int, roles: set[str], n: int
) -> None:
    """The second session, as far as limits allow it.  Raises Infeasible, Mismatch, Broken."""
    number_, joined, outbox, quarantined, backs_off = x.oracle.states[x.state][9:14]
    newest = max([n for p, n in joined if p == peer], default=0)
    session = [ME, number_ + 1] if role == "prescriber" else [peer, newest + 1]
    if x.parameters["memory_limit"] < 2 or len(outbox) > room(x):
        raise Infeasible
    sessions = [MINE, THEIRS, session]
    _try(x, sessions, roles, n)
    if role == "receiver" and quarantined:
        _take(x, ["expire", ["quarantine"]], LONG_MS)
    if role == "prescriber" and backs_off:
        _take(x, ["expire", ["backoff"]], LONG_MS)
    whole = (
        as_receiver(session, refused)
        if role == "receiver"
        else as_prescriber(session, peer, refused)
    )
    for value in whole:
        _take(x, value, lease_ms)
        _try(x, sessions, roles, n)
    x.flush()


def _try(x: Exchange, sessions: list[Json], roles: set[str], n: int) -> None:
    """What must change nothing here: each exchange tries another share of it."""
    commands = {name for role in roles for name in COMMANDS[role]}
    for i in range(n % SHARES, len(x.oracle.inputs), SHARES):
        answer = x.oracle.answer(x.state, i)
        if answer is None or answer.changes or answer.effect.rule == "MEM-1":
            continue
        match x.oracle.inputs[i]:
            case ["receive", ["Advertisement", *_], True] if "receiver" not in roles:
                continue
            case ["receive", [_, 2 | 3, 0 | 1, session, *_], _] if session in sessions:
                x.give(i)
            case ["cam", 2 | 3, _, _]:
                x.give(i)
            case ["command", name, session, *_] if name in commands and session in sessions:
                x.give(i)
