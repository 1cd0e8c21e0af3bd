"""What the specification says of single steps: TLC works out ``Step`` for a list of questions.

The steps of the must-fail models are those of an ablated station, so the oracle does not know
them; TLC does, with the model's own cfg.  All questions of a model are asked in one run.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automcm_spec import scratch, simulate, tlc, values
from automcm_spec.oracle import STATE_FIELDS, canonical
from automcm_spec.paths import MODELS, TLA
from automcm_traces.story import Effects

Json = Any
MODULE = """---- MODULE Story ----
EXTENDS {module}, TLC

Answered(n, me, x, i, known, following) ==
  LET r == Step(me, x, i)
      y == IF known THEN following ELSE r.st
      same == r.st = y
  IN PrintT(ToString(<<n, y, IF same THEN r.out ELSE {{}}, r.told, r.rule,
       IF same THEN r.arm ELSE Armed(me, y) \\ Armed(me, x),
       IF same THEN r.stop ELSE (Armed(me, x) \\ Armed(me, y)) \\ Expired(i),
       Marks(y)>>))

AnyTarget(x, p) == TRUE

{questions}

NoState == FALSE /\\ st = <<>>
NoStep == FALSE /\\ st' = st
====
"""
"""``following`` is what the model itself says comes next; where Step says otherwise, the model's
word counts, and nothing is sent (a mechanism is taken away, Effected in TimedSystem.tla).
``AnyTarget`` stands for Retarget, which looks at the net: what the model did, it allowed."""

_ENTRY = ("type", "to", "session", "seq", "accepted")
_MESSAGE = ("type", "src", "dst", "session", "seq", "proposal", "accepted", "reason", "of")


@dataclass(frozen=True, slots=True)
class Question:
    """What does this station do in this state with this input?  In the form of the oracle.

    ``after`` is the state that comes next as the model has it, or None: what Step says.
    """

    station: int
    state: Json
    input: Json
    after: Json = None

    @property
    def key(self) -> str:
        """A text that is equal for equal questions."""
        return canonical([self.station, self.state, self.input, self.after])


def state(value: Any) -> Json:
    """A station of a model in the form of the oracle, its outbox sorted."""
    out = simulate.state(value)
    out[11] = sorted(out[11], key=canonical)
    return out


def ask(
    module: str, cfg: str, questions: Iterable[Question], tla: Path = TLA
) -> dict[str, Effects]:
    """The answers by ``Question.key``, as the model ``cfg`` (its text) has it.

    Raises tlc.TlcError.
    """
    wanted = list({q.key: q for q in questions}.values())
    if not wanted:
        return {}
    asked = "\n".join(f"ASSUME {_asked(n, q)}" for n, q in enumerate(wanted))
    constants = re.sub(
        r"^(INIT|NEXT|SPECIFICATION|VIEW|SYMMETRY|CHECK_DEADLOCK|INVARIANTS?|PROPERT(Y|IES)|"
        r"(ACTION_)?CONSTRAINTS?)\b.*\n(^[ \t].*\n)*",
        "",
        re.sub(r"(?m)^\\\*.*\n", "", cfg),
        flags=re.M,
    )
    constants = constants.replace("NextTarget <- Retarget", "NextTarget <- AnyTarget")
    found: dict[str, Effects] = {}

    def read(line: str) -> None:
        if line.startswith('"<<'):
            text = values.parse(line)
            assert isinstance(text, str)
            n, *answer = _tuple(values.parse(text))
            found[wanted[n].key] = _effects(answer)

    with scratch.folder("story") as place:
        for path in tla.glob("*.tla"):
            shutil.copy(path, place)
        text = MODULE.format(module=module, questions=asked)
        (place / "Story.tla").write_text(text, encoding="utf-8")
        nothing = "INIT NoState\nNEXT NoStep\nCHECK_DEADLOCK FALSE\n"
        (place / "Story.cfg").write_text(constants + nothing, encoding="utf-8")
        tlc.run("Story", place / "Story.cfg", tla_dir=place, on_print=read, short=True)
    return found


def cfg_of(model: str, models: Path = MODELS) -> str:
    """The text of a model's cfg."""
    return (models / f"{model}.cfg").read_text(encoding="utf-8")


def _tuple(value: Any) -> Any:
    assert isinstance(value, tuple)
    return value


def _effects(answer: Any) -> Effects:
    after, out, told, rule, arm, stop, marks = answer
    return Effects(
        state(after),
        sorted((simulate.message(m) for m in out), key=canonical),
        list(told),
        rule,
        sorted((_timer(t) for t in arm), key=canonical),
        sorted((_timer(t) for t in stop), key=canonical),
        sorted(list(s) for s in marks),
    )


def _timer(value: Any) -> Json:
    return simulate.input_({"kind": "expire", "timer": value})[1]


# -- the oracle's forms as TLA+ text


def _asked(n: int, q: Question) -> str:
    following = "FALSE, 0" if q.after is None else f"TRUE, {_state(q.after)}"
    return f"Answered({n}, {q.station}, {_state(q.state)}, {_input(q.input)}, {following})"


def _state(value: Json) -> str:
    fields = dict(zip(STATE_FIELDS, value, strict=True))
    text = {name: _text(fields[name]) for name in fields}
    for name in ("recorded", "withdrawn", "joined"):
        text[name] = _set(_text(item) for item in fields[name])
    text["outbox"] = _set(_record(_ENTRY, entry) for entry in fields["outbox"])
    return _fields(text)


def _input(value: Json) -> str:
    kind, *rest = value
    fields = {"kind": _text(kind)}
    match kind:
        case "receive":
            fields |= {"message": _record(_MESSAGE, rest[0]), "concerned": _text(rest[1])}
        case "cam":
            marks = _set(_text(s) for s in rest[1])
            fields |= {"src": _text(rest[0]), "marks": marks, "newer": _text(rest[2])}
        case "command":
            names = ("name", "session", "proposal", "target")
            fields |= {name: _text(item) for name, item in zip(names, rest, strict=True)}
        case "expire":
            name, *about = rest[0]
            parts = [_record(_ENTRY, a) if isinstance(a, list) else _text(a) for a in about]
            fields["timer"] = f"<<{', '.join([_text(name), *parts])}>>"
    return _fields(fields)


def _record(names: tuple[str, ...], items: Json) -> str:
    return _fields({name: _text(item) for name, item in zip(names, items, strict=True)})


def _fields(fields: Mapping[str, str]) -> str:
    return "[" + ", ".join(f"{name} |-> {text}" for name, text in fields.items()) + "]"


def _set(items: Iterable[str]) -> str:
    return "{" + ", ".join(items) + "}"


def _text(value: Json) -> str:
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    if isinstance(value, list):
        return f"<<{', '.join(_text(item) for item in value)}>>"
    return f'"{value}"' if isinstance(value, str) else str(value)
