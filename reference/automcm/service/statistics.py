"""The counters of a service.  No decision depends on them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from automcm.core.outcome import Received, ReceivedCam
from automcm.core.state import State
from automcm.core.station import Effects


@dataclass(slots=True)
class Statistics:
    """Counters of one service.

    ``unsendable`` counts messages that the codec cannot carry and that count as lost.  ``received``
    counts every received message.  ``malformed`` counts invalid ones (``oversized`` those that were
    too long), ``elsewhere`` those addressed to another station (MSG-1), ``broken`` those that broke
    the protocol (END-5), ``foreign`` those of another session (END-4), and ``repeated`` those of
    its session that changed nothing: copies and stale ones.  ``rejected`` counts, by reason, the
    datagrams that a secured link discarded, which are not counted elsewhere.  ``rules`` counts the
    deciding rules of all inputs.  ``latest_ms`` is the largest delay of an alarm.  ``out_of_step``
    counts the stations whose clocks were out of step at least once (APP-6).
    """

    sent: Counter[str] = field(default_factory=Counter)
    sent_bytes: int = 0
    unsendable: int = 0
    received: Counter[str] = field(default_factory=Counter)
    received_bytes: int = 0
    rules: Counter[str] = field(default_factory=Counter)
    malformed: int = 0
    oversized: int = 0
    elsewhere: int = 0
    broken: int = 0
    foreign: int = 0
    repeated: int = 0
    rejected: Counter[str] = field(default_factory=Counter)
    latest_ms: int = 0
    out_of_step: int = 0

    def count(self, effects: Effects, before: State) -> None:
        """Count one input that the station received in state ``before``."""
        self.rules[effects.rule] += 1
        match effects.input:
            case None:
                self.malformed += 1
            case Received(message):
                self.received[message.type] += 1
                if effects.rule == "MSG-1":
                    self.elsewhere += 1
                elif effects.rule == "END-5":
                    self.broken += 1
                elif message.session not in (before.session, effects.state.session):
                    self.foreign += 1
                elif effects.state is before:
                    self.repeated += 1
            case ReceivedCam():
                self.received["CAM"] += 1

    def as_dict(self) -> dict[str, Any]:
        """The counters for JSON, sorted."""
        out: dict[str, Any] = {}
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            out[name] = dict(sorted(value.items())) if isinstance(value, Counter) else value
        return out
