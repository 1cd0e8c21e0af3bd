"""Sends the lines of a recorded failure to a station again: ``conform replay``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from automcm_conformance.adapter.adapter import Adapter, LineByLine
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import ProtocolError
from automcm_conformance.exchange import records
from automcm_conformance.exchange.exchange import Mismatch, Step


@dataclass(frozen=True)
class ReplayedFailure:
    """The verdict on one recorded exchange; ``sent`` holds the steps up to its end."""

    case: str
    rule: str
    verdict: Literal["PASS", "FAIL", "ERROR"]
    what: str
    sent: list[Step]
    stderr: Sequence[str] = ()

    @property
    def exit_code(self) -> int:
        """That of ``conform replay``."""
        return {"PASS": 0, "FAIL": 1, "ERROR": 3}[self.verdict]

    def as_dict(self) -> dict[str, str]:
        """For ``--json``."""
        return {"case": self.case, "verdict": self.verdict, "what": self.what}


def replay_failure(file: Path, command: Sequence[str], limit_s: float) -> ReplayedFailure:
    """Send the lines of a replay file to the adapter that ``command`` starts.

    Raises BadInput for the file, and the errors of starting the adapter.
    """
    about, steps = records.read_replay(file)
    station = Adapter(list(command), limit_s)
    verdict: Literal["PASS", "FAIL", "ERROR"] = "PASS"
    what, stderr, unanswered = "", list[str](), False
    try:
        records.replayed(steps, LineByLine(station))
    except Mismatch as error:
        verdict, what = "FAIL", str(error)
        if about["what"].endswith(f": {what}"):
            what = about["what"]  # it begins with the defect of the message
    except ProtocolError as error:
        verdict, what = "ERROR", str(error)
    except AdapterError as error:
        verdict, what, stderr = "ERROR", str(error), error.stderr
        unanswered = not error.answers
    finally:
        station.stop()
    sent = steps[: sum(1 for step in steps if step.answer) + unanswered]
    return ReplayedFailure(about["case"], about["rule"], verdict, what, sent, stderr)
