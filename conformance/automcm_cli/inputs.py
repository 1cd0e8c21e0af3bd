"""Which rows of the reference decide an input of a graph."""

from __future__ import annotations

from typing import Any

Json = Any


def kind(value: Json) -> str:
    """The key of the reference's RULES for an input."""
    match value[0]:
        case "receive":
            return f"receive {value[1][0]}"
        case "cam":
            return "receive CAM"
        case "expire":
            return f"expire {value[1][0]}"
        case "command":
            return f"command {value[1]}"
    return "restart"
