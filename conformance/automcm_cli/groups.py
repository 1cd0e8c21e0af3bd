"""The groups of commands; what is not wanted is not imported."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from typer.core import TyperGroup
from typer.main import get_group

from automcm_cli.common import CODES

GROUPS = {
    "trace": ("trace", "Logs: what happened, and was it allowed?"),
    "spec": ("spec_commands", "The specification: its models, and how far to trust them."),
    "bench": ("bench_commands", "What the reference costs."),
    "vectors": ("vectors", "Test vectors for the trajectory kernels."),
    "simulate": ("simulate", "Scenarios on a simulated road."),
    "experiment": ("experiment", "The paper's evaluation, and what it does not have."),
    "link": ("link", "Links between stations."),
    "conform": ("conform_commands", "A station in any language against the specification."),
}
"""The module of each, which has its ``app``, and what it is about."""


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


class _Later(Group):
    """A group that is imported when one of its commands is wanted."""

    def __init__(self, name: str, module: str, about: str) -> None:
        super().__init__(
            name=name, help=about, epilog=CODES, no_args_is_help=True, rich_markup_mode=None
        )
        self._module = module
        del self.commands

    def __getattr__(self, name: str) -> Any:
        if name != "commands":
            raise AttributeError(name)
        app = import_module(f"automcm_cli.{self._module}").app
        app.rich_markup_mode = None
        self.commands = get_group(app).commands
        return self.commands


class Groups(Group):
    """The whole program: commands of its own, and the groups."""

    def __init__(self, *, commands: dict[str, Any], **more: Any) -> None:
        groups = {name: _Later(name, *about) for name, about in GROUPS.items()}
        super().__init__(commands=commands | groups, **more)
