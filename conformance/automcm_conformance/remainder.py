"""What the graph of two peers says beyond that of one.

A pair of state and input of ``two-peers`` has an *image* in ``one-peer`` if one of the peers can be
taken away (with its session, if the station is bound to it) and the answer is the same in what is
left.  The rest is the remainder: what needs a third station.  Of pairs that differ only in parts of
the state that the input cannot touch (END-4), or in which peer is which, it holds one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from automcm_conformance.paths import SUITE
from automcm_spec.oracle import Answer, Oracle, OracleError, canonical

Json = Any
Ids = Callable[[int], int]
PEERS = 2, 3
STRANGER = 9


def remainder(two: Oracle, one: Oracle) -> Iterator[Answer]:
    """The pairs of ``two`` that have no image in ``one``, in the order of its states."""
    seen: set[tuple[str, int]] = set()
    swapped = [two.input_index[canonical(_input(i, _swap))] for i in two.inputs]
    touched = [_touches(i) for i in two.inputs]
    views = sorted(set(touched), key=str)
    ids: dict[str, str] = {}
    for s, state in enumerate(two.states):
        mirror = _state(state, _swap)
        mine = {v: ids.setdefault(text := canonical(_view(state, v)), text) for v in views}
        other = {v: ids.setdefault(text := canonical(_view(mirror, v)), text) for v in views}
        for answer in two.answers(s):
            i = answer.input
            key = mine[touched[i]], i
            if key in seen:
                continue
            seen.add(key)
            seen.add((other[_swap_view(touched[i])], swapped[i]))
            if not _has_image(two, one, answer):
                yield answer


View = tuple[int, tuple[int, int] | None, bool]
"""Who an input is about, in which session, and whether what is remembered of it matters."""


def _touches(i: Json) -> View:
    match i[0]:
        case "receive":
            return i[1][1], tuple(i[1][3]), i[1][0] == "Advertisement"
        case "cam":
            return i[1], None, False
        case "expire" if i[1][0] == "forget":
            return i[1][1], None, True
        case "expire" if len(i[1]) > 1:
            return i[1][1][1], tuple(i[1][1][2]), False
        case "command":
            return 0, None, i[1] == "request"
    return 0, None, False


def _swap_view(view: View) -> View:
    y, session, remembered = view
    return _swap(y), None if session is None else (_swap(session[0]), session[1]), remembered


def _view(state: Json, view: View) -> Json:
    """The part of a state that an input can touch."""
    y, session, remembered = view
    bound = state[2]
    joined = [j for j in state[10] if (j[0] == y and remembered) or j == bound]
    about = [e for e in state[11] if y and tuple(e[2]) == session]
    size = len(state[11]) if remembered else 0  # MEM-1 counts all of the outbox
    if session is not None and tuple(bound) != session:  # END-4
        return [state[:2], bound[0], state[5], joined, about, size, state[12]]
    own = [e for e in state[11] if e[2] == bound and e[0] not in ("Fin", "Cancel")]
    number = 0 if state[1] == "receiver" else state[9]
    return [state[:9], number, joined, about, own, size, state[12:]]


# -- one peer taken away


def _has_image(two: Oracle, one: Oracle, answer: Answer) -> bool:
    state, i = two.states[answer.state], two.inputs[answer.input]
    return any(_image(two, one, answer, state, i, away) for away in PEERS)


def _image(two: Oracle, one: Oracle, answer: Answer, state: Json, i: Json, away: int) -> bool:
    """Whether the answer is the same without this peer.  A session of it is a stranger's then."""
    speaker, about = _speaker(i), _peers(i)
    if away in about and (away in speaker or i[0] not in ("receive", "cam")):
        return False
    if away in about and away in _bound(state):
        return False
    if any(_goes(state, away, session) for session in _sessions(i)):
        return False

    def ids(p: int) -> int:
        return STRANGER if p == away else 2 if p in PEERS else p

    n = one.state_index.get(canonical(_state(_without(state, away), ids)))
    j = one.input_index.get(canonical(_input(i, ids)))
    image = None if n is None or j is None else one.answer(n, j)
    if image is None or image.changes != answer.changes:
        return False
    mine, its = answer.effect, image.effect
    after = _state(_without(two.states[answer.next], away), ids)
    return (
        (mine.rule, mine.told) == (its.rule, its.told)
        and _set(_message(m, ids) for m in mine.messages) == _set(its.messages)
        and _set(_timer(t, ids) for t in mine.arm) == _set(its.arm)
        and _set(_timer(t, ids) for t in mine.stop) == _set(its.stop)
        and canonical(after) == canonical(one.states[image.next])
    )


def _speaker(i: Json) -> set[int]:
    """Whom a message or CAM comes from and goes to."""
    if i[0] == "receive":
        return {i[1][1], i[1][2]}
    return {i[1]} if i[0] == "cam" else set()


def _peers(i: Json) -> set[int]:
    """The peers that an input names."""
    found = _speaker(i)
    match i[0]:
        case "receive":
            found.add(i[1][3][0])
        case "cam":
            found.update(s[0] for s in i[2])
        case "command":
            found.update((i[2][0], i[4]))
        case "expire" if i[1][0] == "forget":
            found.add(i[1][1])
        case "expire" if len(i[1]) > 1:
            found.update((i[1][1][1], i[1][1][2][0]))
    return found & set(PEERS)


def _sessions(i: Json) -> list[Json]:
    """The sessions that an input names."""
    match i[0]:
        case "receive":
            return [i[1][3]]
        case "cam":
            return list(i[2])
        case "command":
            return [i[2]]
    return []


def _goes(state: Json, away: int, session: Json) -> bool:
    """Whether all that the station has to do with this session goes with that peer."""
    if state[2] == session and _without(state, away)[0] == "STANDALONE":
        return True
    return any(e[1] == away and e[2] == session for e in state[11])


def _bound(state: Json) -> set[int]:
    return {state[2][0], state[5], *state[3], *state[4]}


def _without(state: Json, away: int) -> Json:
    """A state without a peer; the station is in no session if it was in one with it."""
    out = list(state)
    out[3], out[4] = ([p for p in state[n] if p != away] for n in (3, 4))
    out[10] = [j for j in state[10] if j[0] != away]
    out[11] = [e for e in state[11] if away not in (e[1], e[2][0])]
    if away in (state[2][0], state[5]) or (state[0] == "CHOOSING" and not out[3]):
        out[:9] = ["STANDALONE", "none", [0, 0], [], [], 0, 0, False, False]
    return out


# -- other ids


def _swap(p: int) -> int:
    return {2: 3, 3: 2}.get(p, p)


def _set(values: Any) -> list[Json]:
    return sorted(values, key=canonical)


def _session(s: Json, ids: Ids) -> Json:
    p = ids(s[0])
    return [p, 1 if p == STRANGER else s[1]]


def _entry(e: Json, ids: Ids) -> Json:
    return [e[0], ids(e[1]), _session(e[2], ids), *e[3:]]


def _message(m: Json, ids: Ids) -> Json:
    return [m[0], ids(m[1]), ids(m[2]), _session(m[3], ids), *m[4:]]


def _timer(t: Json, ids: Ids) -> Json:
    if len(t) == 1:
        return t
    return [t[0], ids(t[1]) if t[0] == "forget" else _entry(t[1], ids)]


def _state(state: Json, ids: Ids) -> Json:
    out = list(state)
    out[2], out[5] = _session(state[2], ids), ids(state[5])
    out[3], out[4] = (sorted(map(ids, state[n])) for n in (3, 4))
    out[10] = _set(_session(j, ids) for j in state[10])
    out[11] = _set(_entry(e, ids) for e in state[11])
    return out


def _input(i: Json, ids: Ids) -> Json:
    match i[0]:
        case "receive":
            return ["receive", _message(i[1], ids), i[2]]
        case "cam":
            return ["cam", ids(i[1]), _set(_session(s, ids) for s in i[2]), i[3]]
        case "command":
            return ["command", i[1], _session(i[2], ids), i[3], ids(i[4])]
        case "expire":
            return ["expire", _timer(i[1], ids)]
    return i


# -- the file

PATH = SUITE / "remainder.json"
FORMAT = "automcm.remainder/1"


def text(two: Oracle, one: Oracle) -> str:
    """The file: for each state of ``two-peers`` the inputs of the remainder; a state a line."""
    pairs: dict[int, list[int]] = {}
    for answer in remainder(two, one):
        pairs.setdefault(answer.state, []).append(answer.input)
    head = f'"format":"{FORMAT}","spec_hash":"{two.spec_hash}"'
    rows = ",\n".join(f'"{s}":{canonical(inputs)}' for s, inputs in pairs.items())
    return f'{{{head},"pairs":{{\n{rows}\n}}}}\n'


def spec_hash(path: Path = PATH) -> str:
    """Of the specification that the file was made from; empty if there is no such file."""
    try:
        return str(json.loads(path.read_bytes())["spec_hash"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def read(two: Oracle, path: Path = PATH) -> list[Answer]:
    """The remainder from its file.  Raises OracleError if it is missing, or of another version."""
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise OracleError(f"{path}: {error}") from None
    if data.get("format") != FORMAT or data.get("spec_hash") != two.spec_hash:
        raise OracleError(f"{path}: made from another specification; run make generate")
    found = (two.answer(int(s), i) for s, inputs in data["pairs"].items() for i in inputs)
    return [answer for answer in found if answer is not None]
