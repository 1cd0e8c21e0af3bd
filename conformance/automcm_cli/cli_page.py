"""docs/cli.md: every command with its help, its options and its example, from the code."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from typer.main import get_command

from automcm_cli.common import CODES, markdown_table

_HEAD = f"""# The commands

Generated from the code by `make generate`; it is what `--help` of each command shows. `make
verify` fails when it is stale.

{CODES}

A verdict that could not be written is none. If standard output is full or closed, the exit code
is 3 and one line on standard error says why. If its reader has gone away (`| head`), the exit code
is 141 (128 + SIGPIPE), as of most programs, without a word. What cannot be written to standard
error changes no exit code. `station`, `drive`, `link relay` and `adapter --websocket` go on without
standard output. After 70 there is a traceback, and a line that says what to report.

What stands after `--` is the command of an adapter, or its address
([adapter.md](adapter.md#over-a-websocket)). Packages that a command needs beyond the plain
installation are named by it when they are missing.
"""
_HEADS = ("argument or option", "default", "meaning")
_VALUES = {int: "N", float: "X", str: "TEXT", Path: "PATH"}


def text() -> str:
    """The page."""
    from automcm_cli.main import app

    parts = [_HEAD]
    for path, command in _below(get_command(app), ("automcm",)):
        parts.append("\n".join(_section(path, command)))
    return "\n".join(parts)


def examples(page: str) -> list[str]:
    """The commands that the page shows as examples."""
    return [line[4:] for line in page.splitlines() if line.startswith("    automcm ")]


def _below(group: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Groups and commands, those without a group first, each in the order of their names."""
    for name in sorted(
        group.commands, key=lambda name: (hasattr(group.commands[name], "commands"), name)
    ):
        command = group.commands[name]
        yield (*path, name), command
        if hasattr(command, "commands"):
            yield from _below(command, (*path, name))


def _section(path: tuple[str, ...], command: Any) -> list[str]:
    name = " ".join(path)
    depth = "##" if len(path) == 2 else "###"
    said = [_plain(line.strip()) for line in (command.help or "").strip().splitlines()]
    if hasattr(command, "commands"):
        return [f"{depth} {name}", "", *said, ""]
    context = command.context_class(command, info_name=name)
    usage = " ".join([name, *command.collect_usage_pieces(context)])
    example, _, rest = command.epilog.removeprefix("Example: ").partition(".  ")
    further = _plain(rest.removesuffix(CODES).strip())
    rows = [_row(each) for each in command.params if not each.hidden]
    return [
        *(f"{depth} {name}", "", *said, "", f"`{usage}`", ""),
        *([markdown_table(_HEADS, rows, left=_HEADS), ""] if rows else []),
        *("Example:", "", f"    {example}", ""),
        *([further, ""] if further else []),
    ]


def _row(each: Any) -> tuple[str, str, str]:
    """What is typed, its default, and what it means."""
    if not each.opts[0].startswith("-"):
        typed = each.metavar or each.name.upper()
    else:
        value = "" if each.is_flag or each.is_bool_flag else " " + _value(each)
        typed = ", ".join([*(f"{opt}{value}" for opt in each.opts), *each.secondary_opts])
    bounds = [f"at least {each.min}"] if each.min is not None else []
    bounds += [f"at most {each.max}"] if each.max is not None else []
    many = " May be given several times." if each.opts[0].startswith("-") and each.multiple else ""
    meaning = _plain(" ".join((each.help or "").split())) + many
    nothing = each.default is None or each.default is False or each.default in ((), [], "")
    default = "" if nothing else f"`{_shown(each)}`"
    return (
        f"`{typed}`",
        "required" if each.required else default,
        meaning + (f" ({', '.join(bounds)})" if bounds else ""),
    )


def _plain(said: str) -> str:
    """What Markdown would take for emphasis or for a tag stays as it is."""
    return said.replace("*", "\\*").replace("<", "&lt;")


def _shown(each: Any) -> str:
    """The default; of a switch, the name that it goes by."""
    if each.default is True:
        return str(each.opts[0])
    return (
        ", ".join(map(str, each.default)) if isinstance(each.default, list) else str(each.default)
    )


def _value(each: Any) -> str:
    """What stands after an option."""
    if each.metavar:
        return str(each.metavar)
    of = each.type_descriptor.annotation
    if get_origin(of) is list:
        (of,) = get_args(of)
    if get_origin(of) is Literal:
        return "|".join(map(str, get_args(of)))
    return _VALUES.get(of, "VALUE")
