"""Copies of a message fold into one, and nothing else does."""

from __future__ import annotations

import pytest

from automcm_traces.system.copy_folding import Key, folded


def folds(text: str) -> str:
    """Of items such as ``a1``: message ``a``, part ``1``; ``-1`` is a timer, ``!`` has no key, and
    ``a1=`` changes the phase."""

    def key(item: str) -> Key | None:
        message = None if item[0] == "-" else item[0]
        return None if item == "!" else Key(message, item[1], item[2:] == "=")

    return " ".join(f"{f.first}x{f.times}" for f in folded(text.split(), key))


@pytest.mark.parametrize(
    ("items", "expected"),
    [
        ("", ""),
        ("a1 a1 a1", "a1x3"),
        ("a1 a2 a1 a2", "a1x2 a2x2"),
        ("a1 b1 a1", "a1x1 b1x1 a1x1"),
        ("a1 ! a1", "a1x1 !x1 a1x1"),
        ("a1 a1= a1", "a1x1 a1=x2"),
        ("a1 -1 a1 -1= a1 -1", "a1x2 -1x1 -1=x1 a1x1 -1x1"),
        ("-1 -1 a1 -1 a1 -1 b1", "-1x1 -1x1 a1x2 -1x2 b1x1"),
    ],
)
def test_copies_fold_unless_something_comes_between(items: str, expected: str) -> None:
    assert folds(items) == expected
