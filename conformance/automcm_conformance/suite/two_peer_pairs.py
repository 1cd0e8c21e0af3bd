"""The two-peer pairs: what the two-peer graph covers and the one-peer graph does not.

A pair of state and input of ``two-peers`` has an *image* in ``one-peer`` if one of the peers can be
removed (with its session, if the station is bound to it) and the answer is the same in the rest.
The two-peer pairs are those without an image: they need a third station. Of pairs that
differ only in parts of the state that the input cannot affect (END-4), or in the order of the
peers, it holds one.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from automcm_conformance.adapter.kit_paths import SUITE
from automcm_spec.graph.oracle import Oracle, OracleAnswer, OracleError
from automcm_spec.vocabulary import renumbering
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.json_forms import canonical

PEERS = 2, 3
STRANGER = 9


def pairs_without_image(two: Oracle, one: Oracle) -> Iterator[OracleAnswer]:
    """The pairs of ``two`` that have no image in ``one``, in the order of its states."""
    seen: set[tuple[int, int]] = set()
    swapped = [two.input_index[renumbering.input_of(i, _swap)] for i in two.inputs]
    touched = [_touches(i) for i in two.inputs]
    views = set(touched)
    known: dict[Seen, int] = {}
    for s, state in enumerate(two.states):
        mirror = renumbering.state(state, _swap)
        mine = {v: known.setdefault(_view(state, v), len(known)) for v in views}
        other = {v: known.setdefault(_view(mirror, v), len(known)) for v in views}
        for answer in two.answers(s):
            i = answer.input
            key = mine[touched[i]], i
            if key in seen:
                continue
            seen.add(key)
            y, session, remembered = touched[i]
            view = renumbering.station(y, _swap), session and _swap(session), remembered
            seen.add((other[view], swapped[i]))
            if not any(_image(two, one, answer, away) for away in PEERS):
                yield answer


View = tuple[int, spec.Session | None, bool]
"""The peer and the session of an input, and whether remembered sessions matter."""
Seen = tuple[Any, ...]
"""The part of a state that such an input can affect."""


def _touches(i: spec.Input) -> View:
    match i:
        case spec.Receive(message=m):
            return m.src, m.session, m.type == "Advertisement"
        case spec.Cam():
            return i.src, None, False
        case spec.Expire(timer=(_, spec.Entry() as e)):
            return e.to, e.session, False
        case spec.Expire(timer=(_, int(p))):
            return p, None, True
        case spec.Command():
            return 0, None, i.name == "request"
    return 0, None, False


def _view(st: spec.State, view: View) -> Seen:
    """The part of a state that an input can affect."""
    y, session, remembered = view
    bound = st.session
    joined = frozenset(j for j in st.joined if (j[0] == y and remembered) or j == bound)
    about = frozenset(e for e in st.outbox if y and e.session == session)
    size = len(st.outbox) if remembered else 0  # MEM-1 counts all of the outbox
    if session is not None and bound != session:  # END-4
        return st[:2], bound[0], st.target, joined, about, size, st.quarantine
    own = frozenset(e for e in st.outbox if e.session == bound and e.type not in ("Fin", "Cancel"))
    number = 0 if st.role == "receiver" else st.number
    return st[:9], number, joined, about, own, size, st.quarantine, st.backoff


# -- one peer taken away


def _image(two: Oracle, one: Oracle, answer: OracleAnswer, away: int) -> bool:
    """Whether the answer is the same without this peer. Its session becomes a stranger's."""
    state, i = two.states[answer.state], two.inputs[answer.input]
    (speaker, sessions), about = _named(i), _peers(i)
    if away in about and (away in speaker or not isinstance(i, spec.Receive | spec.Cam)):
        return False
    bound = {state.session[0], state.target, *state.recorded, *state.withdrawn}
    if away in about and away in bound:
        return False
    if any(_goes(state, away, session) for session in sessions):
        return False

    def to(session: spec.Session) -> spec.Session:
        p, n = session
        return (STRANGER, 1) if p in (away, STRANGER) else (2, n) if p in PEERS else session

    n = one.state_index.get(renumbering.state(_without(state, away), to))
    j = one.input_index.get(renumbering.input_of(i, to))
    image = None if n is None or j is None else one.answer(n, j)
    if image is None or image.changes != answer.changes:
        return False
    mine, its = answer.effect, image.effect
    return (
        (mine.rule, mine.indication) == (its.rule, its.indication)
        and {renumbering.message(m, to) for m in mine.messages} == {*its.messages}
        and {renumbering.timer(t, to) for t in mine.arm} == {*its.arm}
        and {renumbering.timer(t, to) for t in mine.stop} == {*its.stop}
        and renumbering.state(_without(two.states[answer.next], away), to) == one.states[image.next]
    )


def _named(i: spec.Input) -> tuple[set[int], Collection[spec.Session]]:
    """The sender and the addressee of a message or CAM; the sessions that it or a command names."""
    match i:
        case spec.Receive(message=m):
            return {m.src, m.dst}, [m.session]
        case spec.Cam():
            return {i.src}, i.marks
        case spec.Command():
            return set(), [i.session]
    return set(), []


def _peers(i: spec.Input) -> set[int]:
    """The peers that an input names."""
    found: list[int] = []

    def note(session: spec.Session) -> spec.Session:
        found.append(session[0])
        return session

    renumbering.input_of(i, note)
    return {*found} & {*PEERS}


def _goes(state: spec.State, away: int, session: spec.Session) -> bool:
    """Whether the station's part in this session ends with that peer."""
    if state.session == session and _without(state, away).phase == "STANDALONE":
        return True
    return any(e.to == away and e.session == session for e in state.outbox)


def _without(state: spec.State, away: int) -> spec.State:
    """The state without a peer; the station leaves its session if the peer is in it."""
    out = state._replace(
        recorded=state.recorded - {away},
        withdrawn=state.withdrawn - {away},
        joined=frozenset(j for j in state.joined if j[0] != away),
        outbox=frozenset(e for e in state.outbox if away not in (e.to, e.session[0])),
    )
    chooses_none = out.phase == "CHOOSING" and not out.recorded
    if away in (state.session[0], state.target) or chooses_none:
        none = frozenset[int]()
        return spec.State("STANDALONE", "none", (0, 0), none, none, 0, 0, False, False, *out[9:])
    return out


def _swap(session: spec.Session) -> spec.Session:
    p, n = session
    return {2: 3, 3: 2}.get(p, p), n


# -- the file

PATH = SUITE / "remainder.json"
FORMAT = "automcm.remainder/1"


def text(two: Oracle, one: Oracle) -> str:
    """The file: one line for each state of ``two-peers``, with the inputs of its pairs."""
    pairs: dict[int, list[int]] = {}
    for answer in pairs_without_image(two, one):
        pairs.setdefault(answer.state, []).append(answer.input)
    head = f'"format":"{FORMAT}","spec_hash":"{two.spec_hash}"'
    rows = ",\n".join(f'"{s}":{canonical(inputs)}' for s, inputs in pairs.items())
    return f'{{{head},"pairs":{{\n{rows}\n}}}}\n'


def spec_hash(path: Path = PATH) -> str:
    """The hash of the specification that the file was made from; empty without a file."""
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return ""
    return str(data.get("spec_hash", "")) if isinstance(data, dict) else ""


def read(two: Oracle, path: Path = PATH) -> list[OracleAnswer]:
    """The pairs from the file. Raises OracleError if it is missing, or of another version."""
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise OracleError(f"{path}: {error}") from None
    if data.get("format") != FORMAT or data.get("spec_hash") != two.spec_hash:
        raise OracleError(f"{path}: made from another specification; run make generate")
    found = (two.answer(int(s), i) for s, inputs in data["pairs"].items() for i in inputs)
    return [answer for answer in found if answer is not None]
