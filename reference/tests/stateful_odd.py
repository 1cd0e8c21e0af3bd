"""What is odd, and must do nothing: messages that no station sends which follows the rules."""

from __future__ import annotations

from typing import Any

from stateful_oracle import STRANGER, UNUSED_SEQ
from stateful_world import World

from automcm_spec.vocabulary.messages import (
    Acceptance,
    Ack,
    Advertisement,
    Cancel,
    Fin,
    Intention,
    Message,
    MessageId,
    Prescription,
    Session,
    Trajectory,
    encode,
)

# -- what is odd, and must do nothing


def odd_messages(world: World, s: int, t: int) -> list[bytes]:
    """What station ``s`` may hear from ``t`` that breaks the protocol, is not for it, or counts
    for nothing.  None of it could come from a station that follows the rules."""
    x = world.state(s)
    u = next((q for q in world.ids if q not in (s, t)), STRANGER)
    theirs, mine, no = (t, UNUSED_SEQ), (s, max(1, x.number)), Trajectory(t0=0, points=((0, 0, 0),))
    mine = x.session if x.role == "prescriber" and x.session else mine
    air: Any = {"src": t, "session": theirs, "seq": UNUSED_SEQ}
    of: Any = {**air, "dst": s}
    advertised: Any = {"scenario": "odd", "details": {}}
    content: Any = {"proposal": 1, "prescribed": no, "hold_ms": 0, "lease_ms": 1}
    said: Any = {"proposal": 1, "accepted": True, "selected": no}
    found: list[Message] = [
        Advertisement(**{**air, "src": s}, **advertised),
        Advertisement(**of, **advertised),
        Advertisement(**{**air, "session": (u, UNUSED_SEQ)}, **advertised),
        Intention(**of, planned=no),
        Intention(**air, planned=no),
        Prescription(**{**of, "session": (u, UNUSED_SEQ)}, **content),
        Prescription(**air, **content),
        Acceptance(**of, **said),
        Acceptance(**air, **said),
        Fin(**{**of, "src": s}),
        Fin(**air),
        Fin(**{**of, "dst": u}),
        Advertisement(**{**of, "dst": u}, **advertised),
        Intention(**{**of, "dst": u}, planned=no),
        Prescription(**{**of, "dst": u}, **content),
        Acceptance(**{**of, "dst": u}, **said),
        Fin(**of),
        Fin(**{**of, "session": mine}),
        Cancel(**air, reason="abort"),
        Cancel(**of, reason="abort"),
        Cancel(**{**of, "session": mine, "seq": 0}, reason="closed"),
        _ack(t, s, theirs, "Cancel", UNUSED_SEQ),
        Ack(**{**air, "seq": 0}, of=MessageId(type="Fin", seq=1)),
    ]
    for entry in x.outbox:
        other = next(q for q in (t, u) if q != entry.dst)
        found += [
            _ack(other, s, entry.session, entry.type, entry.seq),
            _ack(entry.dst, s, entry.session, entry.type, 0),
            _ack(entry.dst, s, entry.session, entry.type, UNUSED_SEQ),
            _ack(entry.dst, s, (u, UNUSED_SEQ), entry.type, entry.seq),
            _ack(entry.dst, s, entry.session, "Advertisement", entry.seq),
        ]
    if x.session is not None and x.target:
        other = next(q for q in (t, u) if q != x.target)
        own = {**of, "session": x.session}
        found += [
            Acceptance(**{**own, "src": other}, **said),
            Cancel(**{**own, "src": other}, reason="abort"),
        ]
        newer = {**said, "proposal": x.proposal + 1}
        found.append(Acceptance(**{**own, "src": x.target}, **newer))
    if x.session is not None and x.role == "receiver":
        own = {**of, "session": x.session}
        other = next(q for q in (t, u) if q != x.session[0])
        found += [Fin(**{**own, "src": other}), Cancel(**{**own, "src": other}, reason="abort")]
        if x.phase != "ACTUATING":  # nobody acts yet who could have finished
            found.append(Fin(**{**own, "src": x.session[0]}))
        if x.phase in ("NEGOTIATING", "ACTUATING"):
            newer = {**content, "proposal": x.proposal + 1}
            found.append(Prescription(**{**own, "src": x.session[0]}, **newer))
    return [b'{"v":1', b"\xff", *(encode(message) for message in found)]


def _ack(src: int, dst: int, session: Session, type_: Any, seq: int) -> Ack:
    return Ack(src=src, dst=dst, session=session, of=MessageId(type=type_, seq=seq))
