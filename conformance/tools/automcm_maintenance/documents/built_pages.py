"""The pages of the site that are built from the code and from committed results, not committed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import typer
from typer.cli import get_docs_for_click
from typer.main import get_command

from automcm_cli.shared.common import CODES
from automcm_cli.spec.model_output import checks
from automcm_maintenance.documents.repository import PAGES, ROOT, markdown_table
from automcm_spec.model_checking import models
from automcm_spec.support import templates

RESULTS = ROOT / "docs" / "evaluation"
FAULTS = ROOT / "conformance" / "faults.json"
"""The results of ``make test-faults``."""
_CODE_OR_MARK = re.compile(r"(`[^`]*`|\*\*|^\*)|[<*]", re.MULTILINE)
"""Code and marks of Markdown, or a character that would be taken for one."""

_EXAMPLE = re.compile(r"^Example: (.+?)\.(?:  (.+))?$", re.MULTILINE)


def pages() -> dict[str, Callable[[], str]]:
    """Each page by its name below docs/."""
    from automcm_evaluation.sweeps import report
    from automcm_evaluation.sweeps.catalogue import NAMES
    from automcm_maintenance.code_mutation import certificate_page
    from automcm_maintenance.corpus import corpus
    from automcm_maintenance.documents import citations
    from automcm_maintenance.spec_mutation import mutant_results

    details = {
        f"evaluation/{name}/{report.PAGE}": partial(_details, RESULTS / name / report.RESULTS)
        for name in NAMES
    }
    commands = {name: partial(str, text) for name, text in _commands().items()}
    return {
        "certificate.md": lambda: certificate_page.markdown(certificate_page.load()),
        **commands,
        "corpus.md": partial(corpus.page, ROOT / "traces" / "corpus"),
        "faults.md": lambda: faults_page(json.loads(FAULTS.read_bytes())),
        "index.md": _first_page,
        "models.md": lambda: models_page(models.load()),
        "mutation.md": lambda: mutant_results.page(mutant_results.load()),
        "rule-coverage.md": lambda: citations.table(ROOT),
        **details,
    }


def _commands() -> dict[str, str]:
    """The pages by name: one for each group of commands, and one of the others."""
    from automcm_cli.main import app

    main: Any = get_command(app)
    context = typer.Context(main)
    pages, single = {}, []
    for name, command in sorted(main.commands.items()):
        text = get_docs_for_click(obj=command, ctx=context, name=name, call_prefix="automcm")
        text = _CODE_OR_MARK.sub(lambda m: m[1] or {"<": "&lt;", "*": r"\*"}[m[0]], text)
        text = _EXAMPLE.sub(lambda m: f"Example:\n\n    {m[1]}\n\n{m[2] or ''}", text)
        if hasattr(command, "commands"):
            pages[f"cli-{name}.md"] = text
        else:
            single.append(text.replace("# ", "## ", 1))
    groups = [page.removeprefix("cli-").removesuffix(".md") for page in pages]
    main_page = templates.page(PAGES / "cli.md.j2", codes=CODES, groups=groups, commands=single)
    return {"cli.md": main_page} | pages


def faults_page(found: dict[str, Any]) -> str:
    """The faults of a station, from the results of ``make test-faults``."""
    faults = found["faults"].items()
    wide = [[name, *f["outcomes"]] for name, f in faults if set(f["outcomes"]) != {"Fin"}]
    narrow = [[name, f["codes"], f["log"], f["effect"]] for name, f in faults]
    heads, ends = ["fault", *found["phases"]], ["fault", "exit code", "log", "effect"]
    return templates.page(
        PAGES / "faults.md.j2",
        found=found,
        outcomes=markdown_table(heads, _alike(wide), heads),
        effects=markdown_table(ends, _alike(narrow), ends),
    )


def _alike(rows: list[list[str]]) -> list[list[str]]:
    """Rows that differ only in their fault as one row."""
    faults: dict[tuple[str, ...], list[str]] = {}
    for fault, *rest in rows:
        faults.setdefault(tuple(rest), []).append(fault)
    return [["; ".join(names), *rest] for rest, names in faults.items()]


def models_page(loaded: Sequence[models.Model]) -> str:
    """Every model with its recorded result."""
    usual = {
        pair for m in loaded if m.expect == "holds" for pair in models.replaced_in(m.config).items()
    }

    def changed(model: models.Model) -> str:
        replaced = models.replaced_in(model.config).items()
        names = [name for name, by in replaced if (name, by) not in usual]
        line = re.search(r"^ *Missing = \{(.*)\}", model.config, re.MULTILINE)
        timers = [f"timer {name}" for name in re.findall(r"\w+", line[1])] if line else []
        return ", ".join(f"`{name}`" for name in (*names, *timers))

    return templates.page(
        PAGES / "models.md.j2", models=loaded, alone=models.ALONE, checks=checks, changed=changed
    )


def _first_page() -> str:
    """The README up to its commands, with links from docs/."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8").split("\n## Model-check it")[0]
    return re.sub(r"\]\((?!https?:|#)(docs/)?", lambda m: "](" if m[1] else "](../", readme)


def _details(results: Path) -> str:
    from automcm_evaluation.sweeps import report

    return report.page(report.load(results))
