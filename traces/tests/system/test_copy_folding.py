"""Copies of a message fold into one, and nothing else does."""

from __future__ import annotations

from pathlib import Path

import pytest

from automcm_spec.log_format.log import Send
from automcm_traces.explain.log_table import Filter, FilteredRows, Logs, TableRow
from automcm_traces.system.copy_folding import Fold, Key, folded, key_of

CORPUS = Path(__file__).parents[2] / "corpus"


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


@pytest.mark.parametrize("run", ["pair", "four-vehicles"])
def test_folding_keeps_each_row_and_only_copies_share_a_fold(run: str) -> None:
    logs = Logs(sorted((CORPUS / run).glob("*.ndjson")))
    rows = list(FilteredRows(logs, Filter()))

    def key(row: TableRow) -> Key | None:
        return None if row.event is None else key_of(row.station, row.event, row.notes)

    found: list[Fold[TableRow]] = list(folded(rows, key))
    assert sum(fold.times for fold in found) == len(rows) > len(found) + 10
    for fold in found:
        one, other = fold.first.event, fold.last.event
        if isinstance(one, Send) and isinstance(other, Send):
            assert one.message == other.message and fold.first.notes == fold.last.notes
