"""The groups of commands.  A group is imported when one of its commands is used."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from types import MethodType
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_group

from automcm_cli.shared.common import say
from automcm_spec.support.bad_input import printable

_MAINTENANCE = "automcm_maintenance"
"""The package of the commands that only a clone of the repository has."""
GROUPS = {
    "trace": (
        ["automcm_cli.trace.trace_commands"],
        "Show, check, compare and convert logs of stations.",
    ),
    "spec": (
        ["automcm_cli.spec.spec_commands", f"{_MAINTENANCE}.spec_mutation.spec_commands"],
        "Check, simulate and mutate the TLA+ models.",
    ),
    "bench": (
        [f"{_MAINTENANCE}.benches.bench_commands"],
        "Benchmarks of the reference, the kit and the log tools.",
    ),
    "vectors": (
        ["automcm_cli.reference.vector_commands"],
        "Test vectors for the trajectory kernels and for signed messages.",
    ),
    "simulate": (
        ["automcm_cli.reference.simulate_command"],
        "Run scenarios on a simulated road, and in the traffic of SUMO.",
    ),
    "experiment": (
        ["automcm_evaluation.sweeps.experiment_commands"],
        "Run the experiments of the evaluation.",
    ),
    "keys": (["automcm_cli.reference.keys_commands"], "Keys and certificates of stations."),
    "link": (["automcm_cli.reference.station_commands"], "Simulate the radio between stations."),
    "conform": (
        ["automcm_cli.conform.conform", f"{_MAINTENANCE}.code_mutation.certify"],
        "Test a station in any language against the specification.",
    ),
}
"""For each group: its modules, each with an ``app``, and its help text."""
_TOP = f"{_MAINTENANCE}.verify.repository_commands"
_ONLY_IN_A_CLONE = (
    *("bench", "certify", "experiment", "generate", "mutate", "pages", "prove", "verify"),
)


def _installed(module: str) -> bool:
    return find_spec(module.partition(".")[0]) is not None


def _commands(modules: Sequence[str]) -> dict[str, Any]:
    """The commands of those modules that are installed."""
    commands: dict[str, Any] = {}
    for module in filter(_installed, modules):
        app = import_module(module).app
        app.rich_markup_mode = None
        commands |= get_group(app).commands
    return commands


def _sentence(error: typer.BadParameter) -> str:
    """What is wrong with a value, in our words where pydantic rejected it."""
    errors = getattr(error.__cause__, "errors", None)
    if errors is None:
        return error.message
    first = errors(include_url=False)[0]
    given, kind = first["input"], first["type"].removesuffix("_parsing")
    limits = {"greater_than_equal": ("ge", "at least"), "less_than_equal": ("le", "at most")}
    if kind in limits:
        limit, words = limits[kind]
        return f"must be {words} {first['ctx'][limit]}, not {given}"
    if kind in ("int", "float", "int_from_float"):
        return f"{given!r} is not a {'number' if kind == 'float' else 'whole number'}"
    return str(first["msg"]).removeprefix("Value error, ")


def _format_help(command: Any, ctx: Any, formatter: Any) -> None:
    """The help of a command: how it is called, an example, then the rest."""
    command.format_usage(ctx, formatter)
    command.format_epilog(ctx, formatter)
    command.format_help_text(ctx, formatter)
    command.format_options(ctx, formatter)


class Group(TyperGroup):
    """A group whose flags default to False, and whose usage errors are one line.

    For a default of None, typer imports pydantic, which takes 0.1 s.
    """

    def invoke(self, ctx: Any) -> Any:
        """Run the command.  A usage error may contain the name of a file."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = printable(_sentence(error))
            raise

    def get_params(self, ctx: Any) -> list[Any]:
        """All parameters, including ``--help``."""
        params = super().get_params(ctx)
        for param in params:
            if param.default is None:
                param.default = False
        return params

    def get_command(self, ctx: Any, name: str) -> Any:
        """The command.  Exits with code 3 if the command requires a clone of the repository."""
        found = super().get_command(ctx, name)
        if found is None and name in _ONLY_IN_A_CLONE:
            path = f"{ctx.command_path} {name}".partition(" ")[2]
            text = f"{path}: only available in a clone of the repository, not in the package"
            say(text, err=True)
            raise typer.Exit(3)
        if found is not None and not isinstance(found, Group):
            vars(found)["format_help"] = MethodType(_format_help, found)
        return found


class _LazyGroup(Group):
    """A group that is imported when one of its commands is used."""

    def __init__(self, name: str, modules: Sequence[str], about: str) -> None:
        super().__init__(name=name, help=about, no_args_is_help=True, rich_markup_mode=None)
        self._modules = modules
        del self.commands

    def __getattr__(self, name: str) -> Any:
        if name != "commands":
            raise AttributeError(name)
        self.commands = _commands(self._modules)
        return self.commands


class Groups(Group):
    """The top level: its own commands and the groups."""

    def __init__(self, *, commands: dict[str, Any], **more: Any) -> None:
        groups = {
            name: _LazyGroup(name, modules, about)
            for name, (modules, about) in GROUPS.items()
            if any(map(_installed, modules))
        }
        super().__init__(commands=commands | _commands([_TOP]) | groups, **more)
