"""Computes the effects of single steps with TLC: ``Step`` for a list of queries.

The must-fail models use an ablated station, which the oracle does not know. TLC evaluates it with
the model's own cfg, all queries of a model in one run.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from automcm_spec.model_checking import tla_values, tlc, tlc_simulation
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.station import Entry, Input, Message, Outcome, State
from automcm_traces.export.behaviour_to_log import StepEffects

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
"""``following`` is the next state in the model. Where Step differs, the model's state counts and
nothing is sent, because a mechanism is removed (Effected in TimedSystem.tla). ``AnyTarget``
replaces Retarget, which depends on the net: the model allowed its own steps."""


@dataclass(frozen=True, slots=True)
class EffectQuery:
    """A query: the effects of an input of this station in this state.

    ``after`` is the next state in the model, or None for the next state of Step.
    """

    station: int
    state: State
    input: Input
    after: State | None = None


def effects_of(
    module: str, cfg: str, questions: Iterable[EffectQuery]
) -> dict[EffectQuery, StepEffects]:
    """The effects for each query, according to the model with the text ``cfg``.

    Raises tlc.TlcError.
    """
    wanted = list(dict.fromkeys(questions))
    if not wanted:
        return {}
    assumptions = []
    for n, q in enumerate(wanted):
        following = "FALSE, 0" if q.after is None else f"TRUE, {_tla(q.after)}"
        query = f"{n}, {q.station}, {_tla(q.state)}, {_tla(q.input)}, {following}"
        assumptions.append(f"ASSUME Answered({query})")
    constants = re.sub(
        r"^(INIT|NEXT|SPECIFICATION|VIEW|SYMMETRY|CHECK_DEADLOCK|INVARIANTS?|PROPERT(Y|IES)|"
        r"(ACTION_)?CONSTRAINTS?)\b.*\n(^[ \t].*\n)*",
        "",
        re.sub(r"(?m)^\\\*.*\n", "", cfg),
        flags=re.M,
    )
    constants = constants.replace("NextTarget <- Retarget", "NextTarget <- AnyTarget")
    found: dict[EffectQuery, StepEffects] = {}

    def read(line: str) -> None:
        if line.startswith('"<<'):
            text = tla_values.parse(line)
            assert isinstance(text, str)
            answer: Any = tla_values.parse(text)
            found[wanted[answer[0]]] = _effects(answer[1:])

    with scratch.folder("story") as place:
        for path in TLA.glob("*.tla"):
            shutil.copy(path, place)
        text = MODULE.format(module=module, questions="\n".join(assumptions))
        (place / "Story.tla").write_text(text, encoding="utf-8")
        nothing = "INIT NoState\nNEXT NoStep\nCHECK_DEADLOCK FALSE\n"
        (place / "Story.cfg").write_text(constants + nothing, encoding="utf-8")
        tlc.run("Story", place / "Story.cfg", tla_dir=place, on_print=read, short=True)
    return found


def _effects(answer: Any) -> StepEffects:
    after, out, told, rule, arm, stop, marks = answer
    st, messages = tlc_simulation.state(after), frozenset(Message(**m) for m in out)
    timers = (frozenset(map(tlc_simulation.timer_of, timers)) for timers in (arm, stop))
    return StepEffects(Outcome(st, messages, told, rule, *timers), marks)


def _tla(value: Any) -> str:
    """A value of the specification as TLA+ text."""
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    if isinstance(value, frozenset):
        return f"{{{', '.join(sorted(map(_tla, value)))}}}"
    if not isinstance(value, tuple):
        return f'"{value}"' if isinstance(value, str) else str(value)
    items = map(_tla, value)
    if isinstance(value, State | Message | Entry | Input):
        both = zip(value._fields, items, strict=True)
        return f"[{', '.join(f'{name} |-> {text}' for name, text in both)}]"
    return f"<<{', '.join(items)}>>"
