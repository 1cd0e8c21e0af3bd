"""Small modules, to be mutated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from automcm_maintenance.spec_mutation import mutants
from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.model_checking.models import Model

TINY = r"""---- MODULE Tiny ----
EXTENDS Naturals
VARIABLE n
Init == n = 0
Step(x) == IF x < 3 THEN x + 1 ELSE 0
Same(x) == IF x > 7 THEN 0 ELSE x
Next == n' = Same(Step(n))
\* Helpers of the properties
Small == n <= 3
====
"""
OTHER = r"""---- MODULE Other ----
EXTENDS Naturals
Pick(st, m) ==
  CASE m.type = "Fin" -> [st EXCEPT !.phase = "WAITING", !.session[1] = @ + 1]
    [] m.type = "Ack" -> st   \* not "Fin"
Late(st) ==
  CASE st.a -> {st.b, 2}
    [] OTHER -> {x \in st.c : /\ x # 1
                              /\ x \in st.d \ {4}}
Guarded(st) == IF /\ st.a
                  /\ ~st.b  THEN "lease" ELSE "none"
Do(x) == /\ st' = x
         /\ last' = [rule |-> "ADV-1", phase |-> "WAITING"]
Told(st) == Effect(st, {}, <<"fallback", "timeout">>, "ADV-1")
Over(j, s) == j >= s \/ j = s
=====
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "Tiny.tla").write_text(TINY)
    (tmp_path / "Other.tla").write_text(OTHER)
    (tmp_path / "tiny.cfg").write_text("INIT Init\nNEXT Next\nINVARIANTS Small \\* one\n")
    return tmp_path


def tiny(cfg: str = "tiny", seconds: float = 1, states: int = 5, **changes: Any) -> Model:
    entry = {
        "cfg": cfg,
        "module": "Tiny",
        "config": "",
        "profile": "quick",
        "why": "A test.",
        "seconds": seconds,
        "distinct_states": 4,
        "states": states,
        "depth": 4,
    }
    return Model.model_validate(entry | changes)


def with_cfg(folder: Path, model: Model) -> Model:
    """The model with the cfg of its name in the folder."""
    return model.model_copy(update={"config": (folder / f"{model.cfg}.cfg").read_text()})


def changes(folder: Path, module: str) -> dict[str, Mutant]:
    return {m.change: m for m in mutants.generate(folder, [module])}
