"""A pytest plugin: all tests run with the seeded bug that SEEDED_BUG names (``quick_kills.py``).

The bug is in this process alone: a station in a process of its own stays right.
"""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from sys import path
from typing import Any, cast

import pytest

_bug = ExitStack()


@pytest.hookimpl(trylast=True)
def pytest_configure() -> None:
    """Put the changed rows into the table of rules, and patch what no table holds."""
    path.insert(0, str(Path(__file__).parent))
    from seeded_bugs import BUGS

    from automcm.core.rules import RULES

    changed = _bug.enter_context(BUGS[os.environ["SEEDED_BUG"]].change())
    cast(dict[str, Any], RULES).update(changed)


def pytest_unconfigure() -> None:
    """Take the patch back."""
    _bug.close()
