"""The system properties against TLC: a counterexample that breaks one, taken as the states of
stations over time, is found to break it here too."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from edits import HEADER

from automcm_spec.log_format.log import Header
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.json_forms import input_of
from automcm_spec.vocabulary.rules import kind
from automcm_traces.export.itf import ItfState, from_itf
from automcm_traces.system import properties
from automcm_traces.system.duration_properties import Checked
from automcm_traces.system.hazards import Hazard, hazard
from automcm_traces.system.log_clocks import Span
from automcm_traces.system.log_merge import merge
from automcm_traces.system.timeline import Moment, Session, Timeline, key_of
from automcm_traces.system.world import World

FOLDER = Path(__file__).parents[2] / "counterexamples"
D, L = 1, 4
"""Delay and CamLoss of the timed counterexamples, in ticks."""


def log_of(station: int) -> Log:
    """A log that says nothing, but promises everything and ends."""
    parameters = {"t_resend": 2 * D + 1, "t_cam_loss": L}
    header = Header.model_validate(HEADER | {"station": station, "parameters": parameters})
    end: Any = type("End", (), {"lost_records": 0, "reason": "clean"})()
    return Log(f"{station}", header, [], end, False, [])


class Behaviour(World):
    """A behaviour of the specification: one clock, and every state known."""

    def __init__(self, name: str) -> None:
        self.states = from_itf(json.loads((FOLDER / f"{name}.itf.json").read_text()))
        n = len(list(self.states[0].values["st"]))  # type: ignore[call-overload]
        super().__init__(merge([log_of(station) for station in range(1, n + 1)]))
        for station in range(1, n + 1):
            self.timelines[station] = self._timeline(station)

    @property
    def lines(self) -> list[Timeline]:
        return list(self.timelines.values())

    def _timeline(self, station: int) -> Timeline:
        line, ticks = Timeline(station, f"{station}"), 0
        timed = any("clock" in state.values for state in self.states)
        before: Any = None
        for n, state in enumerate(self.states):
            ticks += state.meta.get("input") == ["tick"] if timed else 1
            x = list(state.values["st"])[station - 1]  # type: ignore[call-overload]
            line.moments.append(moment(n, ticks, station, x, before, state))
            line.last = (n, n, ticks if timed else ticks + 1)  # and so it stays for a while
            before = x
        return line

    def elapsed(self, a: int, t_a: int, b: int, t_b: int) -> Span:
        return Span(t_b - t_a, t_b - t_a, t_b - t_a)

    def before(self, a: int, at_a: int, b: int, at_b: int) -> bool:
        return at_a < at_b

    @property
    def acceptances(self) -> dict[tuple[int, int, Session, int], int]:
        found: dict[tuple[int, int, Session, int], int] = {}
        for n, state in enumerate(self.states):
            for m in state.values["net"]:  # type: ignore[attr-defined]
                if m["type"] == "Acceptance" and m["accepted"]:
                    found.setdefault((m["src"], m["dst"], tuple(m["session"]), m["proposal"]), n)
        return found

    @property
    def received(self) -> dict[tuple[int, int, str], int]:
        found: dict[tuple[int, int, str], int] = {}
        for n, state in enumerate(self.states):
            for m in state.values["received"]:  # type: ignore[attr-defined]
                found.setdefault((m["dst"], m["src"], key_of(dict(m))), n)
        return found

    def hazards(self) -> list[Hazard]:
        periods = (s for line in self.lines for s in line.periods("ACTUATING", "prescriber"))
        return [h for h in (hazard(self, s) for s in periods) if h is not None]


def session_of(x: Any) -> Session | None:
    session = tuple(x["session"])
    return None if session == (0, 0) else session  # type: ignore[return-value]


def moment(n: int, t: int, station: int, x: Any, before: Any, state: ItfState) -> Moment:
    mine = state.meta.get("station") == station
    given: Any = state.meta.get("input")
    heard = given[1] if mine and given[0] == "receive" else None
    gone = before["outbox"] - x["outbox"] if before is not None else []
    acked = [(e["to"], key_of({"dst": e["to"], **e})) for e in gone] if heard else []
    own = {f: x[f] for f in x if f != "outbox"}
    kept = frozenset(e for e in x["outbox"] if e["session"] == x["session"])
    return Moment(
        n,
        n,
        t,
        x["phase"],
        x["role"],
        session_of(x),
        x["target"],
        x["proposal"],
        kind(input_of(list(given))) if mine else "nothing",
        src=heard[1] if heard else 0,
        about=tuple(heard[3]) if heard else None,
        acked=tuple(acked) if heard and heard[0] == "Ack" else (),
        own=(own, kept),
    )


def broken(findings: Iterable[Checked]) -> list[str]:
    return [text for holds, text in findings if holds is not True]


ALL = {
    "S-1": lambda b: properties.one_session(b.lines),
    "S-2": lambda b: properties.commitment(b.lines),
    "S-3": properties.accepted,
    "S-4": properties.agreement,
    "S-5": lambda b: ((h.excused, h.fault) for h in b.hazards()),
    "S-6": properties.acknowledged,
    "S-7": lambda b: properties.no_cross_effect(b.lines),
    "S-8": properties.exclusive,
}
UNTIMED = {
    "no_busy_refusal": "S-1",
    "busy_overwrites_commitment": "S-2",
    "no_proposal_number": "S-3",
    "memory_dropped": "S-4",
    "no_quarantine": "S-4",
    "no_session_number": "S-5",
    "retarget": "S-5",
    "abandoned_acceptance": "S-5",
    "any_lease_order": "S-5",
    "bare_ack": "S-6",
    "ack_from_anybody": "S-6",
    "no_session_number_crosses": "S-7",
    "no_break_off": "S-8",
    "own_word_first": "S-8",
}


@pytest.mark.parametrize(("name", "wanted"), UNTIMED.items())
def test_what_breaks_a_property_in_the_specification_breaks_it_here(name: str, wanted: str) -> None:
    behaviour = Behaviour(name)
    assert broken(ALL[wanted](behaviour)), name
    texts = [hazard.text() for hazard in behaviour.hazards()]
    named = any(text.startswith("HAZARD WITHOUT EXCUSE (S-5)") for text in texts)
    assert named or wanted != "S-5"


@pytest.mark.parametrize(("name", "wanted"), UNTIMED.items())
def test_and_it_is_not_broken_one_step_before(name: str, wanted: str) -> None:
    """A shortest counterexample breaks its property with its last step only."""
    behaviour = Behaviour(name)
    behaviour.states.pop()
    for line in behaviour.lines:
        line.moments.pop()
        at = line.moments[-1].at
        line.last = (at, at, line.moments[-1].t_ms + 1)
    assert broken(ALL[wanted](behaviour)) == []


@pytest.mark.parametrize("name", ["plain_cams", "silent_cam_loss", "bound_less_one"])
def test_t_2_a_hazard_lasts_as_many_ticks_as_tlc_counts(name: str) -> None:
    behaviour = Behaviour(name)
    (found,) = behaviour.hazards()
    assert found.length is not None and found.excused and found.open
    ticks = behaviour.states[-1].values["hazard"]
    assert found.length.low == found.length.high == ticks
    assert found.bound is not None and found.bound.ms == D + L
    assert isinstance(ticks, int) and (found.outcome == "exceeds") == (ticks > D + L)
    assert (name == "plain_cams") == (found.outcome == "exceeds")
