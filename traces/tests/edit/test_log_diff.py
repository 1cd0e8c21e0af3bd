"""Two logs side by side: what is free is no difference, and the first difference is found."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from edits import Edited, edited

from automcm_spec.support.bad_input import BadInput
from automcm_traces.edit.log_diff import StationDiff, diff, text

Json = Any
CORPUS = Path(__file__).parents[2] / "corpus"
PAIR = CORPUS / "pair"
FOUR = CORPUS / "four-vehicles"
INDEX = {e["file"]: e for e in json.loads((CORPUS / "index.json").read_text())}


def one(a: Path, b: Path) -> StationDiff:
    (found,) = diff([a], [b]).stations
    return found


def everywhere(value: Json, change: Callable[[str, Json], Json], name: str = "") -> Json:
    """A record with each of its fields changed."""
    value = change(name, value)
    if isinstance(value, dict):
        return {key: everywhere(inner, change, key) for key, inner in value.items()}
    if isinstance(value, list):
        return [everywhere(inner, change) for inner in value]
    return value


def of(logs: Path) -> list[Path]:
    return sorted(logs.glob("*.ndjson"))


@pytest.mark.parametrize("folder", [PAIR, FOUR], ids=["pair", "four-vehicles"])
def test_a_run_is_the_same_as_itself(folder: Path) -> None:
    found = diff(of(folder), of(folder))
    assert found.same
    assert len(found.stations) == len(of(folder))
    assert all(c.steps > 10 and c.apart_ms == 0 for c in found.stations)


def test_lost_records_are_a_warning(tmp_path: Path) -> None:
    *lines, end = PAIR.joinpath("1001.ndjson").read_text().splitlines()
    lost = tmp_path / "lost.ndjson"
    lost.write_text("\n".join([*lines, json.dumps(json.loads(end) | {"lost_records": 3}), ""]))
    found = diff([PAIR / "1001.ndjson"], [lost])
    assert found.same and found.as_dict()["warnings"] == [f"{lost}: lost 3 records"]
    assert list(text(found))[-1] == f"warning: {lost}: lost 3 records"


@pytest.mark.parametrize("path", of(FOUR), ids=lambda path: path.stem)
def test_numbers_times_cams_and_the_order_of_effects_are_free(path: Path, tmp_path: Path) -> None:
    def number(name: str, value: Json) -> Json:
        if name == "session" and isinstance(value, list):
            return [value[0], value[1] + 70]
        if name == "marks":
            return [[p, n + 70] for p, n in value]
        if name == "tx":
            station, count = value.split(":")
            return f"{station}:{int(count) + 1000}"
        return value + 123 if name in ("t_ms", "deadline") else value

    def free(log: Edited) -> None:
        records = [everywhere(record, number) for record in log.records]
        records = [r for r in records if "CAM" not in str(r.get("message", ""))[:200]]
        steps: list[list[Json]] = [[]]
        for record in records[1:-1]:
            if record["ev"] in ("receive", "command") or record.get("op") == "expire":
                steps.append([])
            steps[-1].append(record)
        turned = [r for step in steps for r in [*step[:1], *reversed(step[1:])]]
        log.records = [records[0], *turned, records[-1]]

    def without_cams(log: Edited) -> None:
        # A CAM also arms the cam timer anew: of that nothing is left if the CAM is not there.
        log.records = [
            r
            for r in log.records
            if r.get("timer", {}).get("name") != "cam" or r.get("op") == "expire"
        ]

    plain = edited(path, tmp_path / "plain", without_cams)
    other = edited(plain, tmp_path / "other", free)
    found = one(plain, other)
    assert found.difference is None, list(text(diff([plain], [other])))
    assert found.steps > 10


def test_stations_of_other_ids_are_aligned(tmp_path: Path) -> None:
    ids = {1001: 7, 2002: 8}

    def number(name: str, value: Json) -> Json:
        if name == "tx":
            station, count = value.split(":")
            return f"{ids[int(station)]}:{count}"
        if name in ("src", "dst", "station", "to", "target"):
            return ids.get(value, value)
        if name == "session" and isinstance(value, list):
            return [ids[value[0]], value[1]]
        return value

    def rename(log: Edited) -> None:
        log.records = [everywhere(record, number) for record in log.records]

    others = [edited(path, tmp_path / "b", rename) for path in of(PAIR)]
    assert not diff(of(PAIR), others).same
    assert diff(of(PAIR), others).only_b == [str(path) for path in others]
    assert diff(of(PAIR), others, ids).same


def test_which_of_two_messages_of_a_step_has_the_lower_seq_is_free(tmp_path: Path) -> None:
    path, swap = PAIR / "1001.ndjson", {2: 3, 3: 2}

    def two(change: dict[int, int]) -> Callable[[Edited], None]:
        """A step that sends two new messages, and an Ack of each."""

        def edit(log: Edited) -> None:
            fin = json.loads(json.dumps(log.at(log.find("send", type="Fin"))))
            ack = json.loads(json.dumps(log.at(log.find("receive", type="Ack"))))
            start = log.find("command", name="request")
            for n, to in ((2, 2002), (3, 3003)):
                fin["message"] |= {"dst": to, "seq": change.get(n, n)}
                ack["message"] |= {"src": to, "of": {"type": "Fin", "seq": change.get(n, n)}}
                ack["t_ms"] = fin["t_ms"] = log.at(start)["t_ms"]
                log.records.insert(start + n - 2, json.loads(json.dumps(fin)))
                log.records.insert(start + 2 * n - 3, json.loads(json.dumps(ack)))
            log.records = [*log.records[: start + 4], log.records[-1]]

        return edit

    a = edited(path, tmp_path / "a", two({}))
    b = edited(path, tmp_path / "b", two(swap))
    skipped = edited(path, tmp_path / "c", two({2: 2, 3: 4}))
    assert one(a, b).difference is None
    assert one(a, skipped).difference is not None


CAMS = ("cam_of_another", "mark_kept", "mark_missing")
SEEDED = [
    entry
    for file, entry in INDEX.items()
    if file.startswith("bad/")
    and entry["source"].startswith("pair-")
    and entry["verdict"] == "diverges"
]


@pytest.mark.parametrize("entry", SEEDED, ids=[Path(e["file"]).stem for e in SEEDED])
def test_every_seeded_fault_is_the_first_difference(entry: dict[str, Json]) -> None:
    bad, base = CORPUS / entry["file"], PAIR / f"{entry['source'][5:]}.ndjson"
    found = one(base, bad)
    if Path(entry["file"]).stem in CAMS:
        assert found.difference is None
        return
    d = found.difference
    if Path(entry["file"]).stem in ("copy_too_late", "window_closed_early", "forged_message"):
        # Times and transmission ids are free; a deadline is not.
        assert d is None or d.a is None or d.a.fields.get("timer")
        return
    assert d is not None
    lines = [event.line for step in d.steps[-1] for event in step.events]
    assert entry["line"] in lines or entry["line"] - 1 in lines
    assert f"DIFFERS after {found.steps} step" in next(text(diff([base], [bad])))


@pytest.mark.parametrize(
    ("type_", "field", "first"), [("Prescription", "hold_ms", 1001), ("Intention", "x", 2002)]
)
def test_the_station_that_differs_first_is_named(
    type_: str, field: str, first: int, tmp_path: Path
) -> None:
    """Its message is another one, and who receives it differs later."""

    def other(log: Edited) -> None:
        for record in log.records:
            if record.get("message", {}).get("type") == type_:
                record["message"][field] = 1

    others = [edited(path, tmp_path / "b", other) for path in of(PAIR)]
    found = diff(of(PAIR), others)
    assert [c.station for c in found.stations if c.difference] == [1001, 2002]
    assert found.first == first


def test_the_first_difference_may_be_an_event_that_only_b_has(tmp_path: Path) -> None:
    one, two = of(PAIR)
    less = edited(one, tmp_path / "a", lambda log: log.drop(log.find("indication")))
    late = edited(two, tmp_path / "b", lambda log: log.drop(log.find("indication", 3)))
    found = diff([less, two], [one, late])
    assert [c.station for c in found.stations if c.difference] == [1001, 2002]
    assert found.first == 1001


def test_another_phase_after_the_same_is_a_difference_if_both_say_it(tmp_path: Path) -> None:
    def phase(log: Edited) -> None:
        record = log.at(log.find("command", name="accept"))
        assert record["phase"] == "ACTUATING"
        record["phase"] = "WAITING"

    def silent(log: Edited) -> None:
        for record in log.records:
            record.pop("phase", None)

    other = edited(PAIR / "2002.ndjson", tmp_path / "b", phase)
    d = one(PAIR / "2002.ndjson", other).difference
    assert d is not None
    assert d.fields == (("phase", "ACTUATING", "WAITING"),)
    other = edited(PAIR / "2002.ndjson", tmp_path / "c", silent)
    assert one(PAIR / "2002.ndjson", other).difference is None


def test_a_station_that_only_one_side_has_is_a_difference() -> None:
    found = diff(of(PAIR), of(PAIR)[1:])
    assert (found.same, found.only_a, found.only_b) == (False, [str(of(PAIR)[0])], [])
    found = diff(of(PAIR)[1:], of(PAIR))
    assert (found.same, found.only_a, found.only_b) == (False, [], [str(of(PAIR)[0])])


def test_times_are_told_relative_to_the_first_step(tmp_path: Path) -> None:
    def later(log: Edited) -> None:
        line = log.find("command", name="complete")
        for record in log.records[1:-1]:
            record["t_ms"] += 1000
        for record in log.records[line - 1 : -1]:
            record["t_ms"] += 17
        for record in log.records:
            if record.get("op") == "arm":
                record["deadline"] += 1000 + (17 if record["seq"] >= line - 1 else 0)

    other = edited(PAIR / "1001.ndjson", tmp_path / "b", later)
    found = one(PAIR / "1001.ndjson", other)
    assert (found.difference, found.apart_ms) == (None, 17)
    assert "17 ms apart" in "\n".join(text(diff([PAIR / "1001.ndjson"], [other]), times=True))


def test_only_what_both_promise_is_compared(tmp_path: Path) -> None:
    def fewer(log: Edited) -> None:
        log.at(1)["complete"] = ["command", "receive", "restart", "send"]
        log.records = [r for r in log.records if r.get("ev") not in ("timer", "indication")]

    other = edited(PAIR / "2002.ndjson", tmp_path / "b", fewer)
    found = one(PAIR / "2002.ndjson", other)
    assert found.skipped == ("indication", "timer")
    assert found.difference is None
    assert found.steps > 5


def test_a_field_of_an_indication_that_one_log_lacks_is_no_difference(tmp_path: Path) -> None:
    def bare(log: Edited) -> None:
        del log.at(log.find("indication", name="verify"))["indication"]["prescription"]

    def wrong(log: Edited) -> None:
        log.at(log.find("indication", name="verify"))["indication"]["proposal"] += 1

    for change, fields in ((bare, []), (wrong, ["indication.proposal"])):
        other = edited(PAIR / "2002.ndjson", tmp_path / change.__name__, change)
        d = one(PAIR / "2002.ndjson", other).difference
        assert [name for name, *_ in (d.fields if d else ())] == fields


def test_parameters_that_differ_are_told() -> None:
    found = one(PAIR / "1001.ndjson", FOUR / "1001.ndjson")
    assert ("t_advertise", 600, 2100) in found.parameters
    assert "t_advertise 600 | 2100" in "\n".join(text(diff(of(PAIR), of(FOUR))))


def test_two_logs_of_one_station_and_an_unreadable_one_are_refused() -> None:
    with pytest.raises(BadInput, match="is also the station of"):
        diff([PAIR / "2002.ndjson", CORPUS / "bad/ack_twice.ndjson"], of(PAIR))
    with pytest.raises(BadInput, match="empty"):
        diff(of(PAIR), [CORPUS / "bad/empty.ndjson"])
