"""Shared by commands that start an adapter: its command, time limit, cases and folder."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from automcm_cli.shared.common import usage

if TYPE_CHECKING:
    from automcm_conformance.suite.purposes import Purpose

COMMAND = "automcm.command"
Limit = Annotated[
    float, typer.Option(help="Time limit for an answer, in seconds of real time.", min=0.01)
]


class WithCommand(TyperCommand):
    """A command that takes the adapter's command after ``--``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take all arguments after ``--`` as the adapter's command, including options."""
        if "--" in args:
            at = args.index("--")
            args, ctx.meta[COMMAND] = args[:at], args[at + 1 :]
        return super().parse_args(ctx, args)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Add the adapter's command to the usage line."""
        return [*super().collect_usage_pieces(ctx), "-- COMMAND..."]


def command_of(ctx: typer.Context) -> list[str]:
    """The command after ``--``."""
    command: list[str] = ctx.meta.get(COMMAND, [])
    if not command:
        raise typer.BadParameter("the adapter is missing: give its command after --")
    return command


def purposes_of(selectors: Sequence[str]) -> list[Purpose]:
    """The cases that the selectors match; all cases without selectors.

    A selector that matches no case is a usage error.
    """
    from automcm_conformance.suite import purposes

    with usage(ValueError):
        return purposes.select(purposes.load(), selectors)


def fresh_folder() -> Path:
    """A new folder runs/<time>, with a number appended if that exists."""
    stem = datetime.now().strftime("%Y-%m-%dT%H-%M-%S")
    names = (stem if n == 1 else f"{stem}-{n}" for n in count(1))
    return next(folder for name in names if not (folder := Path("runs") / name).exists())
