"""The citations of each rule in the specification, code, cases, log tools, tests and others."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator
from itertools import zip_longest
from pathlib import Path

from automcm_conformance.suite import purposes
from automcm_conformance.vectors import vectors
from automcm_maintenance.compilation import compiler
from automcm_maintenance.documents.repository import PAGES, ROOT, markdown_table
from automcm_spec.model_checking import models
from automcm_spec.support import markdown
from automcm_spec.vocabulary.rules import OPERATOR, RULES

COLUMNS = (
    *("specification", "must fail", "code", "case", "log tools", "vector", "counterexample"),
    "test",
)
_ID = re.compile(r"\b(?:ADV|PRE|NEG|ACT|END|REL|CMD|MSG|MEM|KIN|APP|S|I|L|R|T)-\d\b")
_CODE = ("reference/automcm/**/*.py", "reference/automcm_simulation/radio/success.py")
_LOG_TOOLS = ("traces/automcm_traces/**/*.py",)
_CASE = re.compile(r'^id = "(.+)"$', re.MULTILINE)
_MODEL = re.compile(r"^\[(\w+)\]$", re.MULTILINE)
_METHOD = re.compile(r"^    def (\w+)\(", re.MULTILINE)
_TESTS = tuple(
    f"{folder}/tests/**/*.py" for folder in ("spec", "reference", "traces", "conformance")
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
    kernels = dict(zip(KINEMATIC, names, strict=True))
    return (
        RULES
        | {
            rule: f"the kernel `{name}` ([kernels.md](kernels.md))"
            for rule, name in kernels.items()
        }
        | APPLICATION
        | {id_: f"property `{name}`" for id_, name in models.PROPERTIES.items() if id_ != "TypeInv"}
    )


def found(root: Path) -> dict[str, dict[str, Cell]]:
    """The citations by rule and column; a name is a file, an operator, a model or a case."""
    makers: dict[str, Callable[[Path], Iterable[tuple[str, str, str]]]] = {
        "specification": _operators,
        "must fail": _must_fail,
        "code": lambda root: _files(root, _CODE),
        "case": _cases,
        "log tools": lambda root: [*_compiled(root), *_files(root, _LOG_TOOLS)],
        "vector": _vectors,
        "counterexample": _counterexamples,
        "test": lambda root: _files(root, _TESTS),
    }
    table: dict[str, dict[str, Cell]] = {rule: {c: [] for c in COLUMNS} for rule in summaries()}
    for column, make in makers.items():
        for rule, name, path in make(root):
            cell = table.get(rule, {}).get(column)
            if cell is not None and (name, path) not in cell:
                cell.append((name, path))
    return table


def table(root: Path) -> str:
    """docs/rule-coverage.md: each cell has a citation and the number of others."""
    words = summaries()
    rows = [
        [rule, words[rule], *map(_shown, cells.values())] for rule, cells in found(root).items()
    ]
    heads = ["rule", "summary", *COLUMNS]
    table = markdown_table(heads, rows, heads)
    return markdown.page(PAGES / "rule-coverage.md.j2", table=table)


def _shown(cell: Cell) -> str:
    if not cell:
        return ""
    (name, path), *others = cell
    return f"[`{name}`](../{path})" + (f" +{len(others)}" if others else "")


def _ids(text: str) -> list[str]:
    """The ids in a text; a test may carry one in its name (``test_neg_4_…``)."""
    return _ID.findall(text) + [
        each.upper().replace("_", "-")
        for each in re.findall(
            r"(?<=test_)(?:adv|pre|neg|act|end|rel|cmd|msg|mem|kin|app)_\d", text
        )
    ]


def _files(root: Path, globs: Iterable[str]) -> list[tuple[str, str, str]]:
    """Files that cite a rule, the one with most citations first."""
    rows = [
        (-ids.count(rule), path.relative_to(root).as_posix(), rule)
        for glob in globs
        for path in sorted(root.glob(glob))
        for ids in [_ids(path.read_text())]
        for rule in set(ids)
    ]
    return [(rule, Path(path).name, path) for _, path, rule in sorted(rows)]


def _operators(root: Path) -> list[tuple[str, str, str]]:
    """Operators that cite a rule, those of Station.tla first, and the formulas of properties."""
    rows = []
    for path in sorted(root.glob("spec/tla/*.tla"), key=lambda p: (p.stem != "Station", p.stem)):
        for name, link, body in _parts(root, path, OPERATOR):
            rows += [(rule, name, link) for rule in _ids(body) if rule in RULES]
            rows += [
                (id_, name, link) for id_, formula in models.PROPERTIES.items() if formula == name
            ]
    return rows


def _parts(root: Path, path: Path, heading: re.Pattern[str]) -> Iterator[tuple[str, str, str]]:
    """The name, the link to the line, and the text of each part that begins with a heading."""
    text, link = path.read_text(), path.relative_to(root).as_posix()
    found = list(heading.finditer(text))
    for one, following in zip_longest(found, found[1:]):
        line = text.count("\n", 0, one.start()) + 1
        yield one[1], f"{link}#L{line}", text[one.end() : following and following.start()]


def _cases(root: Path) -> list[tuple[str, str, str]]:
    lines = {id_: link for id_, link, _ in _parts(root, purposes.PATH, _CASE)}
    return [(rule, case.id, lines[case.id]) for case in purposes.load() for rule in case.rules]


def _compiled(root: Path) -> list[tuple[str, str, str]]:
    """The methods of the compiled station that decide by a rule."""
    parts = _parts(root, root / compiler.PATH.relative_to(ROOT), _METHOD)
    ends = "\n\n\n"  # of a class
    return [(rule, name, link) for name, link, body in parts for rule in _ids(body.split(ends)[0])]


def _must_fail(root: Path) -> list[tuple[str, str, str]]:
    parts = _parts(root, root / "spec" / "models" / models.LIST, _MODEL)
    links = {name: link for name, link, _ in parts}
    return [
        (id_, model.cfg, links[model.cfg])
        for model in models.load()
        if model.expect == "violates"
        for id_ in [str(model.property), *_ids(model.why)]
    ]


def _vectors(root: Path) -> list[tuple[str, str, str]]:
    return [
        (case.rule, path.name, f"conformance/vectors/{path.name}")
        for path in vectors.paths()
        for case in vectors.load(path)
    ]


def _counterexamples(root: Path) -> list[tuple[str, str, str]]:
    breaks = {m.cfg: str(m.property) for m in models.load() if m.expect == "violates"}
    rows = []
    for path in sorted((root / "traces" / "counterexamples").glob("*.itf.json")):
        states = json.loads(path.read_text())["states"]
        name, link = path.name.removesuffix(".itf.json"), path.relative_to(root).as_posix()
        decided = {state["#meta"].get("rule") for state in states}
        rows += [(rule, name, link) for rule in (breaks[name], *sorted(decided - {None}))]
    return rows
