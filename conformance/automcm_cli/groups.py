"""The groups of commands; what is not wanted is not imported."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_group

from automcm_cli.shared.common import CODES

_MAINTENANCE = "automcm_maintenance"
"""The package of the commands that only a clone of the repository has."""
GROUPS = {
    "trace": (["automcm_cli.trace.trace_commands"], "Logs: what happened, and was it allowed?"),
    "spec": (
        ["automcm_cli.spec.spec_commands", f"{_MAINTENANCE}.spec_commands"],
        "The specification: its models, and how far to trust them.",
    ),
    "bench": ([f"{_MAINTENANCE}.benches.bench_commands"], "What the reference costs."),
    "vectors": (
        ["automcm_cli.reference.vector_commands"],
        "Test vectors for the trajectory kernels.",
    ),
    "simulate": (["automcm_cli.reference.simulate_command"], "Scenarios on a simulated road."),
    "experiment": (
        ["automcm_cli.reference.experiment_commands"],
        "The paper's evaluation, and what it does not have.",
    ),
    "link": (["automcm_cli.reference.link_commands"], "Links between stations."),
    "conform": (
        ["automcm_cli.conform.conform_commands", f"{_MAINTENANCE}.code_mutation.certify"],
        "A station in any language against the specification.",
    ),
}
"""The modules of each, which have an ``app``, and what it is about."""
_TOP = f"{_MAINTENANCE}.repository_commands"
_ONLY_IN_A_CLONE = ("bench", "certify", "generate", "mutate", "pages", "verify")


def _installed(module: str) -> bool:
    return find_spec(module.partition(".")[0]) is not None


def _commands(modules: Sequence[str]) -> dict[str, Any]:
    """The commands of these modules, without those that are not installed."""
    commands: dict[str, Any] = {}
    for module in filter(_installed, modules):
        app = import_module(module).app
        app.rich_markup_mode = None
        commands |= get_group(app).commands
    return commands


class Group(TyperGroup):
    """A group whose flags are False unless given.

    Of a None, typer has pydantic make a flag, which takes 0.1 s to import.
    """

    def get_params(self, ctx: Any) -> list[Any]:
        """All of them, with ``--help``."""
        params = super().get_params(ctx)
        for param in params:
            if param.default is None:
                param.default = False
        return params

    def get_command(self, ctx: Any, name: str) -> Any:
        """The command; ends with code 3 if only a clone of the repository has it."""
        found = super().get_command(ctx, name)
        if found is None and name in _ONLY_IN_A_CLONE:
            path = f"{ctx.command_path} {name}".partition(" ")[2]
            typer.echo(f"{path}: needs a checkout of the repository, not the package", err=True)
            raise typer.Exit(3)
        return found


class _Later(Group):
    """A group that is imported when one of its commands is wanted."""

    def __init__(self, name: str, modules: Sequence[str], about: str) -> None:
        super().__init__(
            name=name, help=about, epilog=CODES, no_args_is_help=True, rich_markup_mode=None
        )
        self._modules = modules
        del self.commands

    def __getattr__(self, name: str) -> Any:
        if name != "commands":
            raise AttributeError(name)
        self.commands = _commands(self._modules)
        return self.commands


class Groups(Group):
    """The whole program: commands of its own, and the groups."""

    def __init__(self, *, commands: dict[str, Any], **more: Any) -> None:
        groups = {
            name: _Later(name, modules, about)
            for name, (modules, about) in GROUPS.items()
            if any(map(_installed, modules))
        }
        super().__init__(commands=commands | _commands([_TOP]) | groups, **more)
