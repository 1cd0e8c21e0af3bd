"""Writes a log. This is the only module of the package that a Python implementation needs."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, cast

from pydantic import ValidationError

from automcm_spec.log_format.log import RECORD, SCHEMA
from automcm_spec.log_format.problems import not_plain, problems_of

_JSON = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"))
_LAST = ("rule", "phase", "role")


class Sink(Protocol):
    """A destination for complete lines, such as a binary stream."""

    def write(self, line: bytes, /) -> object:
        """Take one line."""

    def flush(self) -> None:
        """Write out all buffered lines."""


class LogWriter:
    """Writes the log of one station. Each line is flushed at once.

    As a context manager it writes the end record itself, with the reason ``clean``, or ``crash``
    after an exception. Fields are written in the order of the format. Fields inside messages and
    other free objects keep the caller's order.

    Every method raises ValueError for a record that the format does not allow; it then writes
    nothing and uses no `seq`. It raises OSError if writing fails.
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
        validated: bool = True,
        name: str = "",
    ) -> None:
        """Write the header.

        `target` is a path, which is overwritten, or a sink, which is not closed at the end.
        `parameters` and `complete` are the fields of the header; the order of `complete` does not
        matter. If not `validated`, the fields of events are written as they are; they must have the
        form and the order that the format demands. A `name` of the station is a vendor field.
        """
        self._event_line = _line if validated else _ordered
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
        self._put(_ordered(json.loads(header) | {"x_name": name}) if name else header)

    def event(self, ev: str, t_ms: int, /, **fields: object) -> int:
        """Write one event and return its `seq`.

        `t_ms` is the time of the station's monotonic clock. A field with the value None was not
        observed and is omitted.
        """
        self._refuse_if_ended()
        seq = self._seq + 1
        first = {"rec": "event", "seq": seq, "t_ms": t_ms, "late_ms": fields.pop("late_ms", None)}
        line = self._event_line({**first, "ev": ev, **fields})
        if t_ms < self._t_ms:
            raise ValueError(f"t_ms: must not decrease, from {self._t_ms} to {t_ms}")
        self._put(line)
        self._seq, self._t_ms = seq, t_ms
        return seq

    def end(self, reason: str, lost_records: int = 0) -> None:
        """Write the end record. Closes the file if this writer opened it."""
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
            raise ValueError("the end record is written: no record may follow it")

    def _put(self, line: bytes) -> None:
        self._sink.write(line)
        self._sink.flush()


def _line(fields: Mapping[str, object]) -> bytes:
    """A record as a canonical line; raises ValueError if the format does not allow it."""
    observed = {key: value for key, value in fields.items() if value is not None}
    if wrong := not_plain(observed):
        raise ValueError(": ".join(wrong))
    try:
        record = RECORD.validate_json(json.dumps(observed))
    except ValidationError as error:
        raise ValueError(": ".join(problems_of(error)[0])) from None
    return _ordered(RECORD.dump_python(record, by_alias=True, exclude_none=True))


def _ordered(fields: Mapping[str, object]) -> bytes:
    """The observed fields of a record as a canonical line."""
    names = [*(name for name in fields if name not in _LAST), *_LAST]
    observed = {name: fields[name] for name in names if fields.get(name) is not None}
    return _JSON.encode(observed).encode() + b"\n"
