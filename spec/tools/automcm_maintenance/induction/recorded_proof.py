"""The result of the proof for ``automcm verify``; the committed one has a hash of its files."""

from __future__ import annotations

import json
from dataclasses import dataclass

from automcm_maintenance.documents.repository import ROOT, digest
from automcm_maintenance.induction import prove_commands
from automcm_spec.model_checking import models
from automcm_spec.support.paths import TLA

PATH = ROOT / "spec" / "proof.json"
_TOOLS = "spec/tools/automcm_maintenance"
_CODE = ("compilation/sany.py", "induction/proof.py", "induction/symbolic.py")


@dataclass(frozen=True)
class Proof:
    """The number of obligations, and those that are not proved, in words."""

    obligations: int
    open: tuple[str, ...] = ()
    seconds: float | None = None
    """The time of z3; None if the result is the committed one."""


def files() -> list[str]:
    """What the proof depends on: the modules and the prover."""
    texts = {path.stem: path.read_text(encoding="utf-8") for path in TLA.glob("*.tla")}
    modules = sorted(models.extended(prove_commands.MODULE, texts))
    return [*(f"{_TOOLS}/{name}" for name in _CODE), *(f"spec/tla/{m}.tla" for m in modules)]


def prove() -> Proof:
    """Prove everything, in a minute of processor time."""
    report = prove_commands.run([], "", lambda text: None)
    return Proof(
        len(report.results),
        tuple(map(prove_commands.unproved, report.open)),
        sum(r.seconds for r in report.results),
    )


def text(proof: Proof) -> str:
    """What is committed of a proof of the present files."""
    return json.dumps({"inputs": digest(ROOT, files()), "obligations": proof.obligations}) + "\n"


def committed() -> Proof | None:
    """The committed result, if it is of the present files."""
    if not PATH.exists():
        return None
    found = json.loads(PATH.read_text(encoding="utf-8"))
    same = found["inputs"] == digest(ROOT, files())
    return Proof(found["obligations"]) if same else None
