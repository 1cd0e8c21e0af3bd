"""``automcm simulate`` and ``automcm bench``: output and files."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from cli_stage import automcm

from automcm_cli.reference import simulate_command
from automcm_evaluation.traffic_experiment.traffic_sweep import COLLISIONS
from automcm_simulation.road import figures

PLOTS = ("speed-over-position.png", "speed-over-position.svg", "space-time.png", "space-time.svg")


def run(*args: str) -> tuple[int, str]:
    done = automcm(*args)
    return done.exit_code, done.stdout


def test_the_lane_change_is_told_and_drawn(tmp_path: Path) -> None:
    code, said = run("simulate", "lane-change", "--seconds", "20", "--out", str(tmp_path))
    assert code == 0
    for line in (
        "prescribes 3 to drive 20 km/h slower",
        "B           accepts",
        "has changed lanes",
    ):
        assert line in said
    for name in PLOTS:
        assert (tmp_path / name).stat().st_size > 5000 and name in said
    assert sorted(path.name for path in tmp_path.glob("*.ndjson"))[0] == "1.ndjson"


@pytest.mark.slow
def test_the_same_seed_gives_the_same_pictures(tmp_path: Path) -> None:
    for name in "ab":
        run("simulate", "lane-change", "--seconds", "12", "--out", str(tmp_path / name))
    for name in PLOTS[1::2]:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_json_holds_the_story_and_the_ends(tmp_path: Path) -> None:
    args = ["--vehicles", "2", "--speed", "50", "--out", str(tmp_path), "--json", "-"]
    code, said = run("simulate", "lane-change", *args)
    report = json.loads(said)
    assert code == 0 and report["done"] and set(report["vehicles"]) == {"prescriber", "B"}
    assert report["story"][0]["what"] == "signals for lane 1"
    assert report["vehicles"]["B"]["slowest_kmh"] < 35


def test_without_messages_the_receiver_stops(tmp_path: Path) -> None:
    args = ["--vehicles", "2", "--uncoordinated", "--out", str(tmp_path), "--json", "-"]
    code, said = run("simulate", "lane-change", *args)
    assert code == 0 and json.loads(said)["vehicles"]["B"]["slowest_kmh"] == 0


@pytest.mark.slow
def test_drives_are_counted_by_what_b_does() -> None:
    code, said = run("simulate", "drives", "--drives", "4", "--json", "-")
    report = json.loads(said)
    assert code == 0 and report["bad"] == [] and report["drives"] == 4
    assert sum(kind["drives"] for kind in report["kinds"].values()) == 4


def test_app_2_a_bad_drive_is_exit_code_1_and_named_by_its_seed() -> None:
    args = ["--drives", "2", "--seed", "1", "--without", "any"]
    code, said = run("simulate", "drives", *args)
    assert (
        code == 1 and "seed 1, " in said and "seed 2, " not in said and "braking 8.0 m/s²" in said
    )
    code, _ = run("simulate", "drives", "--without", "eyes")
    assert code == 2


def test_a_lane_change_that_is_not_done_is_exit_code_1(tmp_path: Path) -> None:
    args = ["--loss", "1", "--seconds", "9", "--out", str(tmp_path)]
    assert run("simulate", "lane-change", *args)[0] == 1


def test_a_folder_that_cannot_be_written_is_exit_code_3(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert run("simulate", "lane-change", "--out", str(tmp_path / "file"))[0] == 3


@pytest.mark.slow
def test_without_matplotlib_there_are_no_plots_and_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "available", lambda: False)
    done = automcm("simulate", "lane-change", "--out", tmp_path)
    assert done.exit_code == 0 and "install automcm[plot]" in done.output


def test_traffic_without_sumo_is_exit_code_3_and_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    earlier = tmp_path / "1.ndjson"
    earlier.write_text("a log")
    monkeypatch.setitem(sys.modules, "sumo", None)
    done = automcm("simulate", "traffic", "--out", tmp_path)
    assert done.exit_code == 3 and "pip install 'automcm[sumo]'" in done.output
    assert earlier.exists()


def test_an_unknown_scenario_is_a_usage_error_that_lists_them(tmp_path: Path) -> None:
    done = automcm("simulate", "traffic", "--scenario", "fly", "--out", tmp_path)
    assert done.exit_code == 2 and "lane-change-4" in done.output
    assert automcm("simulate", "traffic", "--penetration", "2").exit_code == 2


def test_every_hazard_that_must_not_be_is_counted(capsys: pytest.CaptureFixture[str]) -> None:
    """The record lists the first five."""
    hazards = {"bound_ms": 1540, "lengths": {"none": [3] * 6, "cam_loss": [40, 1541]}, "wrong": []}
    record = {
        "collisions": dict.fromkeys(COLLISIONS, 0),
        "hazards": hazards,
        "sessions": dict.fromkeys(("requested", "agreed", "completed"), 0),
        "radio": {"sent_bytes": 1, "cam_age_ms": {"p95": 2}, "longest_delay_ms": 50},
        "outcome": {},
    }
    simulate_command._say_traffic(record, Path("out"), None)
    said = capsys.readouterr().out
    assert "8, longest 1541 ms, 7 unexcused (S-5) or beyond B = 1540 ms" in said
    assert "T-2 and TLC assume less than 50 ms" in said
    record["radio"]["longest_delay_ms"] = 49
    simulate_command._say_traffic(record, Path("out"), None)
    assert "assume less" not in capsys.readouterr().out
