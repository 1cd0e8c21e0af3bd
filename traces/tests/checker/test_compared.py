"""The table of the compared fields: each of them, changed, is found, and no other."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from merged_runs import records, rewritten, simulated
from tlc_engine import explain_batch

from automcm.links.simulated_radio import Channel
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary import application, messages
from automcm_spec.vocabulary.application import names
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.checker.compared import COMPARED
from automcm_traces.explain import explain as explanation
from automcm_traces.explain.explain import explain, verdict_of

Json = Any
Records = list[dict[str, Json]]
Place = tuple[str, str, str]
"""A kind of event, the name in it (of a message, a timer, an indication), and a field."""
IN_ADAPTERS = {"intentions": "stations", "prescription": "prescribed", "acceptance": "selected"}
"""What a log of the reference has, and what an adapter tells instead."""
AFTER = 20
"""Of a changed log so many events are left after the change."""
FREE = {"backoff", "forget"}
"""The timers whose deadlines the specification does not tell."""


def as_adapters_tell(logs: list[Records]) -> list[Records]:
    logs = copy.deepcopy(logs)
    for told in (r["indication"] for log in logs for r in log if r.get("ev") == "indication"):
        for mine, its in IN_ADAPTERS.items():
            if mine in told:
                value = told.pop(mine)
                told[its] = sorted(m["src"] for m in value) if its == "stations" else value[its]
    return logs


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Records]:
    """A refusal, then an agreement; an application that does not answer; nobody but a stranger."""
    drivers = [
        {
            station: Straight(target=2002, refuse_first=1, maneuver_ms=1000)
            for station in (1001, 2002)
        },
        {1001: Straight(), 2002: Straight(think_ms=600)},
        {1001: Straight()},
    ]
    found = []
    for seed, run in enumerate(drivers, 3):
        folder = tmp_path_factory.mktemp("logs")
        simulation = Simulation(seed=seed, channel=Channel(loss=0.1), logs=folder)
        for station, driver in run.items():
            simulation.add(station, driver, Parameters(t_cam=500))
        for at in (500, 600):
            simulation.request(1001, at=at)
        simulation.run(until=9000)
        found += map(records, sorted(folder.iterdir()))
    end_5 = copy.deepcopy(found[0])
    n = next(n for n, r in enumerate(end_5) if r.get("ev") == "receive" and "dst" in r["message"])
    end_5[n]["message"]["v"] = 2
    del end_5[n + 1 : -1], end_5[n]["phase"], end_5[n]["role"]
    told = {"name": "discarded", "rule": "END-5"}
    event = {"rec": "event", "t_ms": end_5[n]["t_ms"], "ev": "indication", "indication": told}
    end_5.insert(n + 1, event)
    return [*found, *as_adapters_tell(found), end_5]


def other(field: str, value: Json) -> Json:
    """Another value that is as well formed."""
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case str():
            others = {"rule": "CMD-1", "op": "stop", "name": "undecided", "type": "Fin"}
            found = others.get(field, "abort" if value == "timeout" else "timeout")
            return found if found != value else "expire" if field == "op" else "finished"
        case []:
            return [[9, 9]]
        case list():
            return value[:-1] if field == "intentions" else [*value[:-1], other("", value[-1])]
    if value.keys() == {"name"}:  # a timer
        return {"name": "hold" if value["name"] == "cam" else "cam"}
    last = next(reversed(value))
    return value | {last: other(last, value[last])}


def changed(log: Records) -> Iterator[tuple[Place, int, Records]]:
    """The log with one field of one event changed, for each field of each event."""
    for n, record in enumerate(log[:-1]):
        kind = record.get("ev")
        part = {"send": "message", "indication": "indication"}.get(str(kind), "")
        inner = record[part] if part else record
        name = str(inner.get("type", inner.get("name", kind)))
        if kind == "timer":
            name = record["op"]
        for field in inner if part else ("op", "timer", "deadline") if kind == "timer" else ():
            free = record.get("timer", {}).get("name") in FREE and field == "deadline"
            if field not in inner or field == "v" or (name, field) == ("CAM", "type") or free:
                continue
            value = other(field, inner[field])
            event = {**record, part: {**inner, field: value}} if part else {**record, field: value}
            if field == "op":
                event.pop("deadline", None)
            yield (str(kind), name, field), n + 1, [*log[:n], event, *log[n + 1 : n + AFTER]]
        for field, value in (("phase", "x"), ("role", "x"), ("rule", "x"), ("late_ms", 1)):
            if kind in ("receive", "command", "timer", "restart") and field in record:
                edited = [*log[:n], {**record, field: value}, *log[n + 1 : n + AFTER]]
                yield (kind, "", field), n + 1, edited


def is_compared(place: Place) -> bool:
    kind, name, field = place
    timer = kind == "timer" and field in COMPARED["timer"]
    told = kind == "indication" and field in COMPARED["indication"]
    sent = kind == "send" and field in COMPARED["send CAM" if name == "CAM" else "send"]
    return timer or told or sent or field in COMPARED["every event"]


@pytest.fixture(scope="module")
def cases(logs: list[Records], tmp_path_factory: pytest.TempPathFactory) -> dict[Place, Any]:
    """For each place the first log in which it is changed: the line, the rule, and the log."""
    folder = tmp_path_factory.mktemp("changed")
    found: dict[Place, tuple[int, str, Log]] = {}
    for log in logs:
        for place, line, edited in changed(log):
            if place not in found:
                rule = log[line - 1].get("indication", {}).get("rule", "")
                path = folder / f"{len(found)}.ndjson"
                found[place] = line, rule, rewritten(path, copy.deepcopy(edited))
    return found


def test_each_field_of_the_table_is_compared_and_no_other(
    logs: list[Records],
    cases: dict[Place, tuple[int, str, Log]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The search for what would have been allowed takes most of the time.
    monkeypatch.setattr(explanation, "explained", lambda found, diverges, track: found)
    for n, log in enumerate(logs):
        assert explain(rewritten(tmp_path / f"{n}", copy.deepcopy(log))).verdict == "allowed"
    for place, (line, rule, log) in cases.items():
        verdict = explain(log)
        assert verdict.verdict == ("diverges" if is_compared(place) else "allowed"), place
        if place[0] == "indication" and verdict.verdict == "diverges":
            assert (verdict.finding.at.line, verdict.finding.rule) == (line, rule), place
    changed = {(kind, field) for kind, _, field in cases if is_compared((kind, _, field))}
    assert {field for kind, field in changed if kind == "indication"} == {*COMPARED["indication"]}
    assert {field for kind, field in changed if kind == "timer"} >= {*COMPARED["timer"]}
    assert {field for kind, field in changed if kind == "send"} >= {
        *(*COMPARED["send"], *COMPARED["send CAM"])
    }
    told = {name for kind, name, _ in cases if kind == "indication"}
    assert told == {*names(application.Indication)}


def test_the_table_and_the_page_name_all_fields_of_messages_and_indications() -> None:
    page = (Path(__file__).parents[3] / "docs/trace-format.md").read_text()
    section = page.split("### What is compared")[1].split("\n###")[0]
    for field in {field for fields in COMPARED.values() for field in fields}:
        assert f"`{field}`" in section, field
    own = {field for m in get_args(messages.Message) for field in m.model_fields}
    assert own - {"v", "length_mm", "width_mm"} == {*COMPARED["send"]} - {"hold"}


@pytest.mark.slow
def test_tlc_finds_the_same(cases: dict[Place, tuple[int, str, Log]]) -> None:
    logs = [log for _, _, log in cases.values()]
    for place, mine, its in zip(cases, map(explain, logs), explain_batch(logs), strict=True):
        found = [(v.verdict, v.finding.at.line, v.finding.rule) for v in (mine, its)]
        assert found[0] == found[1], (place, mine.finding, its.finding)


def test_the_order_of_intentions_is_not_compared_whatever_the_ids(tmp_path: Path) -> None:
    log, *_ = simulated(tmp_path, 1, 9, 10, until=6000)
    assert verdict_of(log).verdict == "allowed"
