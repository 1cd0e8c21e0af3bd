"""Claims as data: NAME.claims.toml beside the page of an experiment."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

from jinja2 import Template

from automcm_spec.support import templates

Verdict = Literal["reproduced", "in shape only", "not reproduced", "beyond the paper"]


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of the paper, or a further one, and the result here.

    ``paper`` and ``here`` are the two figures with their units; ``why`` explains a difference.
    """

    claim: str
    paper: str
    here: str
    verdict: Verdict
    why: str


@cache
def _compilers(folder: Path) -> tuple[Callable[[str], Any], Callable[[str], Template]]:
    """What makes an expression and a template; each is compiled once."""
    jinja = templates.environment(folder).overlay(trim_blocks=False, lstrip_blocks=False)
    expression = partial(jinja.compile_expression, undefined_to_none=False)
    return cache(expression), cache(jinja.from_string)


def read(path: Path, names: dict[str, Any]) -> list[Claim]:
    """The claims of a file, with these names.

    Each entry of ``names`` in the file is an expression of Jinja, which later ones may use; the
    texts of a claim are its templates.  A claim is *reproduced* if the expression ``full`` is true,
    and *in shape only* if ``shape`` is.  One with ``holds`` has no figure in the paper.  ``each``:
    a claim for each ``it`` of this list.
    """
    file = tomllib.loads(path.read_text(encoding="utf-8"))
    compiled, template_of = _compilers(path.parent)
    names = dict(names)

    def value(expression: str) -> Any:
        return compiled(expression)(names)

    def text(template: str) -> str:
        return " ".join(template_of(template).render(names).split())

    def verdict(claim: dict[str, str]) -> Verdict:
        if "holds" in claim:
            return "beyond the paper" if value(claim["holds"]) else "not reproduced"
        if value(claim["full"]):
            return "reproduced"
        return "in shape only" if value(claim["shape"]) else "not reproduced"

    for name, expression in file.get("names", {}).items():
        names[name] = value(expression)
    found = []
    for claim in file["claim"]:
        for names["it"] in value(claim.get("each", "[none]")):
            texts = (text(claim.get(part, "")) for part in ("claim", "paper", "here", "why"))
            statement, paper, here, why = texts
            found.append(Claim(statement, paper or "-", here, verdict(claim), why))
    return found
