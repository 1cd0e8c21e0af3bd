"""The positions of all road users beside the logs, for the road of a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from automcm_spec.log_format.reader import Log
from automcm_spec.support.bad_input import BadInput, errors_of
from automcm_traces.system.event_order import Node

Json = Any
Positive = Annotated[int, Field(ge=1)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class _User(_Strict):
    number: int
    equipped: bool
    length_mm: Positive
    width_mm: Positive


class _Frame(_Strict):
    number: list[int]
    x_mm: list[int]
    y_mm: list[int]
    heading_mrad: list[int]

    @model_validator(mode="after")
    def _even(self) -> _Frame:
        if len({len(self.number), len(self.x_mm), len(self.y_mm), len(self.heading_mrad)}) > 1:
            raise ValueError("number, x_mm, y_mm and heading_mrad must be of the same length")
        return self


class _Traffic(_Strict):
    every_ms: Positive
    users: list[_User]
    frames: list[_Frame]


def of(path: Path | None, nodes: Sequence[Node], logs: Sequence[Log]) -> Json:
    """The part of the file during the shown events; None without a file.

    Frame n of the file is at n · ``every_ms`` on the clock of the first log.  Raises BadInput.
    """
    if path is None:
        return None
    try:
        found = _Traffic.model_validate_json(path.read_bytes())
    except OSError as error:
        raise BadInput(path, 0, "", f"cannot be read: {error.strerror}") from None
    except ValidationError as error:
        raise BadInput(path, 0, *errors_of(error)[0]) from None
    times = [logs[i].events[k][1].t_ms for i, k in nodes]
    first_frame = min(times, default=0) // found.every_ms
    last = max(times, default=0) // found.every_ms + 1
    plain = found.model_dump()
    return plain | {
        "first_ms": first_frame * found.every_ms,
        "frames": plain["frames"][first_frame : last + 1],
    }
