"""The pages of the commands: help, options and example of each, generated from the code."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from typer.main import get_command

from automcm_cli.shared.common import CODES
from automcm_maintenance.documents.repository import PAGES, markdown_table
from automcm_spec.support import markdown

_HEADS = ("argument or option", "default", "meaning")
_VALUES = {int: "N", float: "X", str: "TEXT", Path: "PATH"}


def texts() -> dict[str, str]:
    """The pages by name: one for each group of commands, and one of the others."""
    from automcm_cli.main import app

    main: Any = get_command(app)
    top = main.commands
    groups = {name: group for name, group in sorted(top.items()) if hasattr(group, "commands")}
    pages = {
        f"cli-{name}.md": _page(group.commands, ("automcm", name), groups=[], about=_about(group))
        for name, group in groups.items()
    }
    others = {name: command for name, command in top.items() if name not in groups}
    return {"cli.md": _page(others, ("automcm",), codes=CODES, groups=list(groups))} | pages


def _page(commands: dict[str, Any], path: tuple[str, ...], **values: Any) -> str:
    shown = [_shown((*path, name), command) for name, command in sorted(commands.items())]
    return markdown.page(PAGES / "cli.md.j2", path=path, commands=shown, **values).rstrip() + "\n"


def _shown(path: tuple[str, ...], command: Any) -> dict[str, Any]:
    """The template values of a command."""
    name = " ".join(path)
    context = command.context_class(command, info_name=name)
    example, _, rest = command.epilog.removeprefix("Example: ").removesuffix(".").partition(".  ")
    rows = [_row(each) for each in command.params if not each.hidden]
    return {
        "path": path,
        "about": _about(command),
        "usage": " ".join([name, *command.collect_usage_pieces(context)]),
        "options": markdown_table(_HEADS, rows, left=_HEADS) if rows else "",
        "example": example,
        "further": _plain(rest.strip()),
    }


def _about(command: Any) -> list[str]:
    return [_plain(line.strip()) for line in (command.help or "").strip().splitlines()]


def _row(each: Any) -> tuple[str, str, str]:
    """The table row of a parameter: its syntax, its default and its meaning."""
    if not each.opts[0].startswith("-"):
        typed = each.metavar or each.name.upper()
    else:
        value = "" if each.is_flag or each.is_bool_flag else " " + _value(each)
        typed = ", ".join([*(f"{opt}{value}" for opt in each.opts), *each.secondary_opts])
    meaning = _plain(" ".join((each.help or "").split()))
    nothing = each.default is None or each.default is False or each.default in ((), [], "")
    default = "" if nothing else f"`{_default(each)}`"
    return (
        f"`{typed}`",
        "required" if each.required else default,
        " ".join(filter(None, (meaning, _bounds(each)))),
    )


def _bounds(each: Any) -> str:
    """The bounds of a number in a sentence, unless the help explains the lower bound 0."""
    least, most = each.min, each.max
    if least is not None and most is not None:
        return f"From {least} to {most}."
    if most is not None:
        return f"At most {most}."
    return "" if least is None or "(0 = " in each.help else f"At least {least}."


def _plain(text: str) -> str:
    """The text with the characters of Markdown emphasis and of HTML tags escaped."""
    return text.replace("*", "\\*").replace("<", "&lt;")


def _default(each: Any) -> str:
    """The default; for a flag, the option's name."""
    if each.default is True:
        return str(each.opts[0])
    return (
        ", ".join(map(str, each.default)) if isinstance(each.default, list) else str(each.default)
    )


def _value(each: Any) -> str:
    """The placeholder of an option's value."""
    if each.metavar:
        return str(each.metavar)
    of = each.type_descriptor.annotation
    if get_origin(of) is list:
        (of,) = get_args(of)
    if get_origin(of) is Literal:
        return "|".join(map(str, get_args(of)))
    return _VALUES.get(of, "VALUE")
