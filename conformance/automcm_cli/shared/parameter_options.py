"""Parameters from the command line."""

from __future__ import annotations

from collections.abc import Sequence

import typer

from automcm_cli.shared.common import usage
from automcm_spec.vocabulary.parameters import DEFAULTS, ParameterError, Parameters


def chosen(settings: Sequence[str]) -> Parameters:
    """The default parameters with the changes ``NAME=VALUE``.

    An unknown name or a bad value is a usage error.
    """
    values: dict[str, int] = {}
    for text in settings:
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
