"""The committed results of ``spec mutate``, and the reasons for mutants that no property kills."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.documents.repository import PAGES, ROOT, digest, markdown_table
from automcm_maintenance.spec_mutation.mutant_rules import HOW, KINDS, NOT_MUTATED
from automcm_spec.model_checking.models import PROPERTIES
from automcm_spec.support import files, templates
from automcm_spec.vocabulary.messages import Frozen

RESULTS = ROOT / "spec" / "mutation" / "results.json"
REASONS = RESULTS.with_name("no-property.toml")
"""Why no property kills a mutant; each reason lists the ids of its mutants."""
_CODE = "spec/tools/automcm_maintenance/spec_mutation"
INPUTS = (
    "spec/tla",
    "spec/models",
    f"{_CODE}/mutant_rules.toml",
    *(f"{_CODE}/mutant{name}.py" for name in ("_edits", "_rules", "_runs", "s")),
)
"""What the results depend on."""
STALE = "the specification, the models or the generator have changed since the run"
NOTHING = "none"
HEADS = ("mutants", *HOW, NOTHING)


class MutantResult(Frozen):
    """A mutant, the properties that kill it, and the other differences (``HOW``)."""

    id: str
    line: int
    change: str
    properties: list[str]
    differs: list[str]

    @property
    def module(self) -> str:
        """The mutated module."""
        return self.id.split(".")[0]

    @property
    def how(self) -> str:
        """What finds it: a property, else the most informative difference, else nothing."""
        return "property" if self.properties else next(iter(self.differs), NOTHING)


class MutationResults(Frozen):
    """inputs is the hash of INPUTS at the run; empty if it is not known.

    run: its profile, and how many of the mutants it had. Only a deep one finds every property.
    """

    inputs: str
    run: str
    mutants: list[MutantResult]

    @property
    def stale(self) -> bool:
        """Whether the inputs have changed since the run."""
        return self.inputs != present()

    @property
    def summary(self) -> str:
        """The figures in a paragraph of Markdown, with *stale* if they are."""
        total, hows = len(self.mutants), Counter(row.how for row in self.mutants)
        killed = hows["property"]
        modules = " and ".join(sorted({row.module for row in self.mutants}))
        apart = ", ".join(f"{hows[how]} {how}" for how in HOW if hows[how] and how != "property")
        return (
            f"{f'*Stale*: {STALE}. ' if self.stale else ''}Of {total} mutants of {modules} "
            f"({self.run}), "
            f"a property kills {killed} ({killed / max(1, total):.1%}). Of the other "
            f"{total - killed}, {total - killed - hows[NOTHING]} show another difference, which is "
            f"no kill ({apart or 'none'}), and {hows[NOTHING]} show none."
        )


def present() -> str:
    """The hash of INPUTS now."""
    return digest(ROOT, INPUTS)


def load(path: Path = RESULTS) -> MutationResults:
    """The committed results.  Raises ValueError for an invalid file, OSError without the file."""
    return MutationResults.model_validate_json(path.read_bytes())


def before(profile: str, path: Path = RESULTS) -> list[MutantResult]:
    """The written results of this profile that hold on the present inputs."""
    found = load(path)
    return found.mutants if found.run.startswith(f"{profile} ") and not found.stale else []


def write(run: str, rows: Sequence[MutantResult], path: Path = RESULTS) -> None:
    """Write the results of a run on the present inputs, one mutant a line."""
    ordered = sorted(rows, key=lambda row: (row.module, row.line, row.id))
    lines = ",\n".join(json.dumps(row.model_dump(), ensure_ascii=False) for row in ordered)
    files.write(path, f'{{"inputs": "{present()}", "run": "{run}", "mutants": [\n{lines}\n]}}\n')


def reasons(path: Path = REASONS) -> dict[str, str]:
    """The reason for each mutant, by id.  Raises ValueError for an id listed twice."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))["reason"]
    listed = [(id_, entry["text"]) for entry in table for id_ in entry["mutants"]]
    if twice := [id_ for id_, n in Counter(id_ for id_, _ in listed).items() if n > 1]:
        raise ValueError(f"{path.name} lists {twice[0]} twice")
    return dict(listed)


def problems(
    rows: Sequence[MutantResult],
    known: Mapping[str, str],
    generated: Collection[str],
) -> list[str]:
    """Mutants that no property kills and that have no reason, and reasons without such a mutant.

    generated are the ids of all mutants.
    """
    missing = [
        f"no property kills {row.id} ({row.change}), and {REASONS.name} does not say why"
        for row in rows
        if not row.properties and row.id not in known
    ]
    killed = [
        f"{REASONS.name} lists {row.id}, but {row.properties[0]} kills it"
        for row in rows
        if row.properties and row.id in known
    ]
    gone = [
        f"{REASONS.name} lists {id_}, but there is no such mutant"
        for id_ in known
        if id_ not in generated
    ]
    return missing + killed + gone


def by_kind(rows: Sequence[MutantResult]) -> dict[str, list[int]]:
    """For each kind and for all, the numbers of HEADS."""
    kinds = {kind: [row for row in rows if row.id.split(".")[2] == kind] for kind in KINDS}
    return {
        kind: [len(of), *(sum(row.how == how for row in of) for how in HEADS[1:])]
        for kind, of in (kinds | {"all": list(rows)}).items()
        if of
    }


def by_property(rows: Sequence[MutantResult]) -> dict[str, int]:
    """How many mutants each property kills."""
    killed = Counter(name for row in rows for name in row.properties)
    return {name: killed[name] for name in dict.fromkeys([*PROPERTIES, *sorted(killed)])}


def page(found: MutationResults) -> str:
    """The page: the figures, the mutants that no property kills with the reasons."""
    known = reasons()
    alive: dict[str, list[MutantResult]] = {}
    for row in found.mutants:
        if not row.properties:
            alive.setdefault(known.get(row.id, "No reason yet."), []).append(row)
    kinds = [[kind, *n, KINDS.get(kind, "")] for kind, n in by_kind(found.mutants).items()]
    return templates.page(
        PAGES / "mutation.md.j2",
        summary=found.summary,
        kinds=markdown_table(["kind", *HEADS, "what"], kinds),
        hows=HOW,
        properties=markdown_table(["property", "kills"], list(by_property(found.mutants).items())),
        alive=alive,
        not_mutated=NOT_MUTATED,
        edits=faults.load("second_reader").values(),
    )
