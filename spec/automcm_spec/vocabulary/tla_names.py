"""Converts TLA+ names to Python names."""

import keyword
import re

_TAKEN = {
    "EMPTY",
    "NoArm",
    "any",
    "all",
    "bool",
    "chain",
    "count",
    "frozenset",
    "index",
    "len",
    "product",
    "range",
    "self",
}


def snake(name: str) -> str:
    """The snake-case name: on_cam_loss for OnCamLoss."""
    return _free(re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower())


def local(name: str) -> str:
    """The name of a parameter or a bound variable."""
    return _free(f"{name}_" if name in ("l", "O", "I") else name)


def _free(name: str) -> str:
    return f"{name}_" if keyword.iskeyword(name) or name in _TAKEN else name
