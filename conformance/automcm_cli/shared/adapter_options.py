"""What commands share that start an adapter: its command, its time limit, cases, a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from automcm_cli.shared.common import usage

if TYPE_CHECKING:
    from automcm_conformance.suite.purposes import Purpose

COMMAND = "automcm.command"
Limit = Annotated[float, typer.Option(help="Real seconds an answer may take.", min=0.01)]


class WithCommand(TyperCommand):
    """What stands after ``--`` is the command of the adapter, or the address of a WebSocket."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """What stands behind ``--`` is the command, whatever it looks like."""
        if "--" in args:
            at = args.index("--")
            args, ctx.meta[COMMAND] = args[:at], args[at + 1 :]
        return super().parse_args(ctx, args)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """The command stands in the line of usage."""
        return [*super().collect_usage_pieces(ctx), "-- COMMAND..."]


def command_of(ctx: typer.Context) -> list[str]:
    """The command after ``--``, or the address (ws://...) alone."""
    command: list[str] = ctx.meta.get(COMMAND, [])
    if not command:
        raise typer.BadParameter(
            "the command of the adapter, or its ws:// address, is missing; it stands after --"
        )
    return command


def purposes_of(selectors: Sequence[str]) -> list[Purpose]:
    """The cases that these select; all without any.  A usage error names what selects nothing."""
    from automcm_conformance.suite import purposes

    with usage(ValueError):
        return purposes.select(purposes.load(), selectors)


def fresh_folder() -> Path:
    """runs/<time>, with a number behind it if it is there."""
    from automcm_conformance.adapter import kit_paths

    with usage(FileExistsError):
        return kit_paths.fresh_folder()
