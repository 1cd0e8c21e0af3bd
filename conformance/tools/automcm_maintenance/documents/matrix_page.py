"""The matrix of mutants and properties on the page of mutation, from committed files."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from automcm_maintenance.documents.repository import ROOT, markdown_table
from automcm_spec.model_checking.models import PROPERTIES

FOLDER = ROOT / "spec" / "mutation"
MATRIX = FOLDER / "matrix.jsonl"
"""The result: a line with the models, then a line for each mutant."""
REASONS = FOLDER / "no-property.toml"
"""Why no property kills a mutant; each reason lists the ids of its mutants."""
ORACLE = "oracle"
"""In place of a property: one station answers an input otherwise than the unmutated one."""
ERROR = "error"
"""The end of a mutant that TLC could not evaluate."""


class MatrixFileError(ValueError):
    """The matrix or the reasons cannot be read."""


class _Row(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Head(_Row):
    """models ran in this order, some with changed constants; a mutant was explored up to ``states``
    times a model's states."""

    models: list[str]
    changed: dict[str, dict[str, str]]
    states: int


class MatrixEntry(_Row):
    """A mutant: the first model that violates each property, and the models not finished, with
    the reason (ENDS of ``matrix``)."""

    id: str
    change: str
    kills: dict[str, str]
    unfinished: dict[str, str]

    @property
    def definition(self) -> str:
        """The mutated operator."""
        return self.id.split(".")[1]

    @property
    def properties(self) -> list[str]:
        """The properties that kill it."""
        return [id_ for id_ in self.kills if id_ != ORACLE]


def text(head: Head, entries: Sequence[MatrixEntry]) -> str:
    """The committed file."""
    lines = [json.dumps(row.model_dump(), ensure_ascii=False) for row in (head, *entries)]
    return "\n".join([*lines, ""])


def load(path: Path = MATRIX) -> tuple[Head, list[MatrixEntry]]:
    """The committed file.  Raises MatrixFileError for an invalid line, OSError without the file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows: list[Head | MatrixEntry] = []
    for number, line in enumerate(lines, start=1):
        kind = Head if number == 1 else MatrixEntry
        try:
            rows.append(kind.model_validate_json(line))
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(map(str, fault["loc"])) or "line"
            raise MatrixFileError(f"{path.name}:{number}: {where}: {fault['msg']}") from error
    if not rows or not isinstance(rows[0], Head):
        raise MatrixFileError(f"{path.name} is empty")
    return rows[0], [row for row in rows[1:] if isinstance(row, MatrixEntry)]


def reasons(path: Path = REASONS) -> dict[str, str]:
    """The reason for each mutant, by id.

    Raises MatrixFileError for an invalid file or an id listed twice, OSError without the file.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise MatrixFileError(f"{path.name}: {error}") from error
    found: dict[str, str] = {}
    for entry in table.get("reason", []):
        text_, ids = entry.get("text"), entry.get("mutants")
        if set(entry) != {"text", "mutants"} or not isinstance(text_, str) or not text_.strip():
            raise MatrixFileError(f"{path.name}: a reason must have text and mutants: {entry}")
        if not isinstance(ids, list) or not ids or not all(isinstance(id_, str) for id_ in ids):
            raise MatrixFileError(f"{path.name}: mutants must be a list of ids: {entry}")
        for id_ in ids:
            if id_ in found:
                raise MatrixFileError(f"{path.name} lists {id_} twice")
            found[id_] = text_
    if unknown := set(table) - {"reason"}:
        raise MatrixFileError(f"{path.name}: unknown key {', '.join(sorted(unknown))}")
    return found


def problems(entries: Sequence[MatrixEntry], known: Mapping[str, str]) -> list[str]:
    """Mutants that no property kills and that have no reason, and reasons without such a mutant."""
    alive = {entry.id: entry for entry in entries if not entry.properties}
    by_id = {entry.id for entry in entries}
    missing = [
        f"no property kills {id_} ({entry.change}), and {REASONS.name} does not say why"
        for id_, entry in alive.items()
        if id_ not in known
    ]
    obsolete = [
        f"{REASONS.name} lists {id_}, but "
        + ("a property kills it" if id_ in by_id else "there is no such mutant")
        for id_ in known
        if id_ not in alive
    ]
    return missing + obsolete


def section(head: Head, entries: Sequence[MatrixEntry], known: Mapping[str, str]) -> str:
    """The tables and the list of mutants that no property kills."""
    order = [*PROPERTIES, ORACLE]
    found = {id_ for entry in entries for id_ in entry.kills}
    columns = [id_ for id_ in order if id_ in found] + sorted(found - set(order))
    rows: list[list[object]] = []
    for name in dict.fromkeys(entry.definition for entry in entries):
        of = [entry for entry in entries if entry.definition == name]
        rows.append([f"`{name}`", *_counts(of, columns)])
    rows.append(["all", *_counts(entries, columns)])
    heads = ["definition", "mutants", *columns, ERROR, "none"]
    alive = [entry for entry in entries if not entry.properties]
    lines = [
        f"The models {', '.join(f'`{name}`' for name in head.models)} were run on all "
        f"{len(entries)} mutants of Station, each property by itself{_changed(head)}.  A mutant "
        "counts in the column of every property that it violates; `matrix.jsonl` names the models.",
        "",
        markdown_table(heads, rows),
        "",
        f"- *{ORACLE}*: the station answers an input otherwise, so the comparison with the oracle "
        "finds it",
        f"- *{ERROR}*: TLC cannot evaluate the mutant; it is not explored further",
        "- *none*: no property kills it",
        "",
        f"{_unfinished(head, entries)}",
        "",
        "### Mutants that no property kills",
        "",
        f"{len(alive)} of {len(entries)}; the comparison with the oracle finds "
        f"{sum(ORACLE in entry.kills for entry in alive)} of them.  From "
        f"`spec/mutation/{REASONS.name}`, with reasons.",
        "",
    ]
    by_reason: dict[str, list[MatrixEntry]] = {}
    for entry in alive:
        by_reason.setdefault(known.get(entry.id, "No reason yet."), []).append(entry)
    for reason, of in by_reason.items():
        lines += [f"{reason}", ""]
        lines += [f"- `{entry.id}`: `{entry.change}`" for entry in of]
        lines.append("")
    return "\n".join(lines).rstrip()


def _counts(entries: Sequence[MatrixEntry], columns: Sequence[str]) -> list[object]:
    killed = Counter(id_ for entry in entries for id_ in entry.kills)
    errors = sum(ERROR in entry.unfinished.values() for entry in entries)
    none = sum(not entry.properties for entry in entries)
    return [len(entries), *(killed[id_] or "" for id_ in columns), errors or "", none or ""]


def _changed(head: Head) -> str:
    """The models that ran with other constants."""
    each = [
        f"`{name}` with {' and '.join(f'`{k} = {v}`' for k, v in constants.items())}"
        for name, constants in head.changed.items()
    ]
    return f" ({', '.join(each)})" if each else ""


def _unfinished(head: Head, entries: Sequence[MatrixEntry]) -> str:
    """How many cells are undecided."""
    ends = Counter(end for entry in entries for end in entry.unfinished.values())
    left = (
        f"  {ends['left']} explorations were left out: temporal properties on mutants that another "
        "property kills (`--sparing`)."
    )
    return (
        f"Undecided: {ends['states']} explorations ended at {head.states} times the states of the "
        f"model, {ends['time']} at the time limit.  What such a mutant violates later is not known."
    ) + (left if ends["left"] else "")


def page_part() -> str:
    """The part of the page, from the committed files."""
    if not MATRIX.is_file():
        return "Not run yet."
    head, entries = load()
    return section(head, entries, reasons())
