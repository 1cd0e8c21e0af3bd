"""Parameters from the command line."""

from __future__ import annotations

from collections.abc import Sequence

import typer

from automcm_cli.shared.common import usage
from automcm_spec.vocabulary.parameters import DEFAULTS, ParameterError, Parameters


def chosen(settings: Sequence[str]) -> Parameters:
    """The defaults, changed by ``NAME=VALUE``.  A bad one is a usage error that names it."""
    values: dict[str, int] = {}
    for text in settings:
        name, _, value = text.partition("=")
        if name not in DEFAULTS:
            raise typer.BadParameter(f"{name}: no such parameter; there are {', '.join(DEFAULTS)}")
        try:
            values[name] = int(value)
        except ValueError:
            raise typer.BadParameter(f"{name}: an integer is needed, not {value!r}") from None
    with usage(ParameterError):
        return Parameters(**values)
