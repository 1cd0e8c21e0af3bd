"""What a shell completes after ``automcm``: commands, options and values."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    ("typed", "value"),
    [
        ("spec check retar", "retarget"),
        ("spec list --property T-", "T-2"),
        ("spec list --profile f", "full"),
        ("conform run NEG-", "NEG-4"),
        ("conform new --language p", "python"),
        ("simulate traffic --scenario mer", "merge"),
        ("verify --rule PRE-", "PRE-5"),
    ],
)
def test_a_value_is_completed(typed: str, value: str) -> None:
    words = f"automcm {typed}"
    environment = os.environ | {
        "_AUTOMCM_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    program = Path(sys.executable).with_name("automcm")
    done = subprocess.run([program], env=environment, capture_output=True, text=True, check=False)
    assert value in done.stdout.split(), done
