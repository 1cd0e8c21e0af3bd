"""Options shared by the commands that run, test or hear a station on UDP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from automcm_cli.shared.common import usage
from automcm_spec.vocabulary.parameters import DEFAULTS, ParameterError, Parameters

Remote = Annotated[
    bool, typer.Option("--allow-remote", help="Allow addresses that other hosts can reach.")
]
Broadcast = Annotated[str, typer.Option(help="HOST:PORT on which all stations listen.")]
Host = Annotated[str, typer.Option(help="Local address to send from.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="A parameter of the station, such as t_timeout=1000.  Repeatable."),
]
EVERYONE = "127.255.255.255:47100"


def adjusted(settings: Sequence[str] | None) -> Parameters:
    """The default parameters with the changes ``NAME=VALUE``.

    An unknown name or a bad value is a usage error.
    """
    values: dict[str, int] = {}
    for text in settings or ():
        name, _, value = text.partition("=")
        if name not in DEFAULTS:
            raise typer.BadParameter(
                f"there is no parameter {name!r}; the parameters are {', '.join(DEFAULTS)}"
            )
        try:
            values[name] = int(value)
        except ValueError:
            raise typer.BadParameter(f"{name} must be an integer, not {value!r}") from None
    with usage(ParameterError):
        return Parameters(**values)
