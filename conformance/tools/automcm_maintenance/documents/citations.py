"""The citations of each rule in the specification, code, cases, log tools, tests and others."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path

from automcm_conformance.vectors import vectors
from automcm_maintenance.documents.repository import PAGES, markdown_table
from automcm_spec.model_checking import models
from automcm_spec.support import templates
from automcm_spec.vocabulary.rules import OPERATOR, RULES

_MODEL = re.compile(r"^\[(\w+)\]$", re.MULTILINE)
_METHOD = re.compile(r"^    def (\w+)\(", re.MULTILINE)
_KERNEL = re.compile(r'^  "kernel": "(\w+)",$', re.MULTILINE)
_CASE = re.compile(r'^id = "(.+)"$', re.MULTILINE)
PLACES: dict[str, list[tuple[str, re.Pattern[str] | None]]] = {
    "specification": [("spec/tla/Station.tla", OPERATOR), ("spec/tla/*.tla", OPERATOR)],
    "must fail": [(f"spec/models/{models.LIST}", _MODEL)],
    "code": [
        ("reference/automcm/**/*.py", None),
        ("reference/automcm_simulation/radio/success.py", None),
    ],
    "case": [("conformance/suite/purposes.toml", _CASE)],
    "log tools": [
        ("spec/automcm_spec/vocabulary/station.py", _METHOD),
        ("traces/automcm_traces/**/*.py", None),
    ],
    "vector": [("conformance/vectors/*.json", _KERNEL)],
    "counterexample": [("traces/counterexamples/*.itf.json", None)],
    "test": [(f"{n}/tests/**/*.py", None) for n in ("spec", "reference", "traces", "conformance")],
}
"""For each column, where to look, and what begins a part of a file that is named by itself."""
COLUMNS = tuple(PLACES)
_FORMULAS = {formula: id_ for id_, formula in models.PROPERTIES.items()}
_CITED = re.compile(
    r"\b(?:ADV|PRE|NEG|ACT|END|REL|CMD|MSG|MEM|KIN|APP|[SILNPRT])-\d+\b"
    r"|(?<=test_)(?:adv|pre|neg|act|end|rel|cmd|msg|mem|kin|app)_\d"
    rf"|\b(?:{'|'.join(_FORMULAS)})\b"
)

KINEMATIC = tuple(f"KIN-{n}" for n in range(1, 8))
APPLICATION = {
    "APP-1": "an application knows everybody heard or seen, whether they answered or not",
    "APP-2": "it proceeds or prescribes only if everybody known is clear or follows the target",
    "APP-3": "when a vehicle is clear: gap, margin, braking",
    "APP-4": "it looks again before it moves over",
    "APP-5": "it looks on while it moves over, up to the point of no return",
    "APP-6": "a station whose clock is out of step counts as one that did not answer",
}
"""Rules of an application, not of the station, in one line each."""
Cell = list[tuple[str, str]]
"""The citations of a rule in a column: names with their places, the best first."""


def summaries() -> dict[str, str]:
    """Every rule, kernel rule, application rule and property, with a summary in one line."""
    other = ("extents", "clock", *vectors.SECURED)  # of KIN-3, as collide, of APP-6, of none
    names = [name for name in vectors.KERNELS if name not in other]
    kernels = [f"the kernel `{name}` ([kernels.md](kernels.md))" for name in names]
    properties = {id_: f"property `{name}`" for id_, name in models.PROPERTIES.items()}
    del properties["TypeInv"]
    return RULES | dict(zip(KINEMATIC, kernels, strict=True)) | APPLICATION | properties


def found(root: Path) -> dict[str, dict[str, Cell]]:
    """The citations by rule and column; a name is a file, an operator, a model or a case."""
    table: dict[str, dict[str, Cell]] = {rule: {c: [] for c in COLUMNS} for rule in summaries()}
    for column, places in PLACES.items():
        for glob, heading in places:
            rows = []
            for path in sorted(root.glob(glob)):
                for name, link, text in _parts(root, path, heading):
                    if heading is not _MODEL or "\nbreaks = " in text:
                        ids = [_id(cited) for cited in _CITED.findall(text)]
                        rows += [(-ids.count(rule), rule, name, link) for rule in set(ids)]
            for _, rule, name, link in sorted(rows, key=lambda row: row[0]):
                cell = table.get(rule, {}).get(column)
                if cell is not None and (name, link) not in cell:
                    cell.append((name, link))
    return table


def _id(cited: str) -> str:
    """The id of a rule or property; a test may carry one in its name (``test_neg_4_…``)."""
    return _FORMULAS.get(cited) or cited.upper().replace("_", "-")


def _parts(
    root: Path, path: Path, heading: re.Pattern[str] | None
) -> Iterator[tuple[str, str, str]]:
    """The name, the link to the line, and the text of each part of a file."""
    text, link = path.read_text(encoding="utf-8"), path.relative_to(root).as_posix()
    if heading is None:
        yield path.name, link, text
        return
    found = list(heading.finditer(text))
    for one, following in zip_longest(found, found[1:]):
        line = text.count("\n", 0, one.start()) + 1
        part = text[one.start() : following and following.start()]
        yield one[1], f"{link}#L{line}", part.partition("\n\n\n")[0]


def table(root: Path) -> str:
    """docs/rule-coverage.md: each cell has a citation and the number of others."""
    words = summaries()
    rows = [
        [rule, words[rule], *map(_shown, cells.values())] for rule, cells in found(root).items()
    ]
    heads = ["rule", "summary", *COLUMNS]
    table = markdown_table(heads, rows, heads)
    return templates.page(PAGES / "rule-coverage.md.j2", table=table)


def _shown(cell: Cell) -> str:
    if not cell:
        return ""
    (name, path), *others = cell
    return f"[`{name}`](../{path})" + (f" +{len(others)}" if others else "")
