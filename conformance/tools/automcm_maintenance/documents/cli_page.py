"""The pages of the commands: help, options and example of each, generated from the code."""

from __future__ import annotations

import re
from typing import Any

import typer
from typer.cli import get_docs_for_click
from typer.main import get_command

from automcm_cli.shared.common import CODES
from automcm_maintenance.documents.repository import PAGES
from automcm_spec.support import markdown

_CODE_OR_MARK = re.compile(r"(`[^`]*`|\*\*|^\*)|[<*]", re.MULTILINE)
"""Code and marks of Markdown, or a character that would be taken for one."""

_EXAMPLE = re.compile(r"^Example: (.+?)\.(?:  (.+))?$", re.MULTILINE)


def texts() -> dict[str, str]:
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
    main_page = markdown.page(PAGES / "cli.md.j2", codes=CODES, groups=groups, commands=single)
    return {"cli.md": main_page} | pages
