"""Write a log: the one module of this package an implementation in Python needs."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, cast

from pydantic import ValidationError

from automcm_traces.format.log import RECORD, SCHEMA, first_problem, not_plain


class Sink(Protocol):
    """Takes whole lines: a binary stream, or something like one."""

    def write(self, line: bytes, /) -> object:
        """Take one line."""

    def flush(self) -> None:
        """Let nothing wait."""


class LogWriter:
    """Writes the log of one station, every line validated and flushed at once.

    Used as a context manager it writes the end itself: ``clean``, or ``crash`` if an exception
    passes. Fields come out in the order of the format; the inside of messages and of other free
    objects in the order the caller gave.

    Every method raises ValueError for what the format does not allow (nothing is written then and
    no number is used up) and OSError if writing fails.
    """

    def __init__(
        self,
        target: str | Path | Sink,
        *,
        run: str,
        station: int,
        implementation: str,
        version: str,
        spec_hash: str | None = None,
        parameters: Mapping[str, int] | None = None,
        complete: Iterable[str] = (),
    ) -> None:
        """Write the header.

        `target` is a path (overwritten) or a sink, which stays open at the end.
        `parameters` and `complete` are those of the header; the order of `complete` is free.
        """
        self._seq = 0
        self._t_ms = 0
        self._ended = False
        header = _line(
            {
                "rec": "header",
                "schema": SCHEMA,
                "run": run,
                "station": station,
                "implementation": {"name": implementation, "version": version},
                "spec": None if spec_hash is None else {"name": "Station", "hash": spec_hash},
                "parameters": dict(parameters or {}),
                "complete": sorted(set(complete)),
            }
        )
        self._own = open(target, "wb") if isinstance(target, str | Path) else None  # noqa: SIM115
        self._sink: Sink = self._own or cast(Sink, target)
        self._put(header)

    def event(self, ev: str, t_ms: int, /, **fields: object) -> int:
        """Write one event and return its `seq`.

        `t_ms` is the station's monotonic clock. A field given as None was not observed and is
        left out.
        """
        self._refuse_if_ended()
        seq = self._seq + 1
        line = _line({"rec": "event", "seq": seq, "t_ms": t_ms, "ev": ev, **fields})
        if t_ms < self._t_ms:
            raise ValueError(f"t_ms goes back from {self._t_ms} to {t_ms}")
        self._put(line)
        self._seq, self._t_ms = seq, t_ms
        return seq

    def end(self, reason: str, lost_records: int = 0) -> None:
        """Write the end, and close the file if this writer opened it."""
        self._refuse_if_ended()
        line = {"rec": "end", "seq": self._seq, "reason": reason, "lost_records": lost_records}
        self._put(_line(line))
        self._ended = True
        if self._own is not None:
            self._own.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if not self._ended:
            self.end("clean" if error is None else "crash")

    def _refuse_if_ended(self) -> None:
        if self._ended:
            raise ValueError("the log has ended")

    def _put(self, line: bytes) -> None:
        self._sink.write(line)
        self._sink.flush()


def _line(fields: Mapping[str, object]) -> bytes:
    """The canonical line of a record; raises ValueError if the format does not allow it."""
    observed = {key: value for key, value in fields.items() if value is not None}
    if odd := not_plain(observed):
        raise ValueError(": ".join(odd))
    try:
        record = RECORD.validate_json(json.dumps(observed))
    except ValidationError as error:
        raise ValueError(": ".join(first_problem(error))) from None
    ordered = record.model_dump(by_alias=True, exclude_none=True)
    for last in ("rule", "phase", "role"):
        if last in ordered:
            ordered[last] = ordered.pop(last)
    return json.dumps(ordered, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"
