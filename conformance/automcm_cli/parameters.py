"""Parameters from the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from automcm.parameters import Parameters


def chosen(settings: Sequence[str]) -> Parameters:
    """The defaults, changed by ``NAME=VALUE``.  A bad one is a usage error that names it."""
    from automcm.parameters import ParameterError, Parameters

    names = [field.name for field in fields(Parameters)]
    values: dict[str, int] = {}
    for text in settings:
        name, _, value = text.partition("=")
        if name not in names:
            raise typer.BadParameter(f"{name}: no such parameter; there are {', '.join(names)}")
        try:
            values[name] = int(value)
        except ValueError:
            raise typer.BadParameter(f"{name}: an integer is needed, not {value!r}") from None
    try:
        return Parameters(**values)
    except ParameterError as error:
        raise typer.BadParameter(str(error)) from None
