"""The fates of the messages in files that are exported one by one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

from automcm_spec.log_format.reader import header_of
from automcm_traces.explain.log_table import Logs, TableRow


def arrow_rows(paths: Sequence[Path]) -> Iterator[tuple[Path, TableRow]]:
    """The rows with arrows, each with its file.

    Logs of one run are judged together; if two of them are of one station, each alone. Raises
    BadInput for a file without a header.
    """
    runs: dict[str, list[tuple[int, Path]]] = defaultdict(list)
    for path in paths:
        header = header_of(path)
        runs[header.run].append((header.station, path))
    for logs in runs.values():
        file_of = dict(logs)
        groups = [file_of] if len(file_of) == len(logs) else [{s: path} for s, path in logs]
        for group in groups:
            for row in Logs(list(group.values())).rows():
                if row.arrows:
                    yield group[row.station], row
