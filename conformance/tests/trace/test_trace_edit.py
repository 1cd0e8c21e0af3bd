"""``automcm trace shrink``, ``diff`` and ``export`` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_stage import automcm

CORPUS = Path(__file__).parents[3] / "traces/corpus"
LEASE = str(CORPUS / "bad/lease_longer.ndjson")
PAIR = [str(CORPUS / "pair/1001.ndjson"), str(CORPUS / "pair/2002.ndjson")]


def test_a_shrunk_log_diverges_as_the_long_one(tmp_path: Path) -> None:
    answer = automcm("trace", "shrink", LEASE, "--late", "60", "--out", tmp_path)
    assert answer.exit_code == 0, answer.output
    assert "15 of 83 events are left" in answer.output
    assert "\x1b" not in answer.output
    small = tmp_path / "lease_longer.ndjson"
    assert answer.output.splitlines()[-1] == f"automcm trace explain --late 60 {small}"
    told = automcm("trace", "explain", small, "--json", "-", "--out", tmp_path)
    assert told.exit_code == 1
    verdict = json.loads(told.output)
    assert (verdict["verdict"], verdict["rule"], verdict["line"]) == ("diverges", "NEG-2", 16)


def test_shrink_says_as_json_what_it_wrote(tmp_path: Path) -> None:
    answer = automcm("trace", "shrink", LEASE, "--json", "-", "--out", tmp_path)
    told = json.loads(answer.output)
    assert (told["rule"], told["line_before"], told["line"]) == ("NEG-2", 59, 16)
    (log,) = told["logs"]
    assert (log["events_before"], log["events"], log["file"]) == (83, 15, LEASE)
    assert Path(log["written"]).read_bytes().count(b"\n") == 17


def test_shrink_does_not_write_over_what_it_was_given(tmp_path: Path) -> None:
    path = tmp_path / "a.ndjson"
    text = Path(LEASE).read_bytes()
    path.write_bytes(text)
    answer = automcm("trace", "shrink", path, "--out", tmp_path)
    assert answer.exit_code == 2
    assert path.read_bytes() == text


@pytest.mark.parametrize(
    ("logs", "code", "words"),
    [
        (PAIR, 1, "nothing to shrink"),
        ([str(CORPUS / "bad/empty.ndjson")], 3, "empty file"),
        ([str(CORPUS / "bad/seq_gap.ndjson")], 4, "CANNOT TELL"),
        (["nowhere.ndjson"], 3, "no such file"),
    ],
)
def test_shrink_needs_something_wrong(
    logs: list[str], code: int, words: str, tmp_path: Path
) -> None:
    answer = automcm("trace", "shrink", *logs, "--out", tmp_path / "out")
    assert answer.exit_code == code
    assert words in answer.output
    assert not (tmp_path / "out").exists()


def test_diff_says_the_same_and_where_not() -> None:
    answer = automcm("trace", "diff", PAIR[1], PAIR[1], "--times")
    assert answer.exit_code == 0
    assert answer.output.splitlines()[0] == "2002: the same, 23 steps"
    answer = automcm("trace", "diff", PAIR[1], LEASE)
    assert answer.exit_code == 1
    assert "duration_ms: 20000 | 21000" in answer.output
    assert "\x1b" not in answer.output
    assert all(len(line) <= 80 for line in answer.output.splitlines() if " | " in line)


def test_diff_as_json() -> None:
    answer = automcm("trace", "diff", PAIR[1], LEASE, "--json", "-")
    told = json.loads(answer.output)
    assert (told["same"], told["first"]) == (False, 2002)
    (station,) = told["stations"]
    assert station["difference"]["a"] == {"line": 59, "t_ms": 1374, "event": "arm lease +20000"}
    assert station["difference"]["fields"] == [{"field": "duration_ms", "a": 20000, "b": 21000}]


def test_diff_takes_folders_and_pairs_of_stations() -> None:
    pair, four = str(CORPUS / "pair"), str(CORPUS / "four-vehicles")
    assert automcm("trace", "diff", pair, pair).exit_code == 0
    answer = automcm("trace", "diff", pair, four, "--stations", "2002=3003")
    assert answer.exit_code == 1
    assert "2002.ndjson: only B has this station" in answer.output


@pytest.mark.parametrize("pairs", [["1001"], ["a=b"], ["1001=1", "1002=1"]])
def test_pairs_of_stations_that_make_no_sense_are_wrong_usage(pairs: list[str]) -> None:
    options = [part for pair in pairs for part in ("--stations", pair)]
    answer = automcm("trace", "diff", PAIR[0], PAIR[1], *options)
    assert answer.exit_code == 2


def test_diff_names_a_file_that_cannot_be_read() -> None:
    answer = automcm("trace", "diff", PAIR[0], CORPUS / "bad/rubbish.ndjson")
    assert answer.exit_code == 3
    assert "rubbish.ndjson" in answer.output


def test_export_writes_what_other_tools_read(tmp_path: Path) -> None:
    for to, name in (("mermaid", "1001.mmd"), ("svg", "1001.svg"), ("itf", "2002.itf.json")):
        options = ["--to", to, "--out", str(tmp_path), "--json", "-"]
        answer = automcm("trace", "export", CORPUS / "pair", *options)
        assert answer.exit_code == 0, answer.output
        assert str(tmp_path / name) in json.loads(answer.output)["written"]
        assert (tmp_path / name).stat().st_size > 1000


def test_export_to_mcap_and_back(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    options = ["--to", "mcap", "--out", str(tmp_path)]
    assert automcm("trace", "export", *PAIR, *options).exit_code == 0
    options = ["--to", "logs", "--out", str(tmp_path)]
    answer = automcm("trace", "export", tmp_path / "1001.mcap", *options)
    assert answer.exit_code == 0
    assert (tmp_path / "2002.ndjson").read_bytes() == Path(PAIR[1]).read_bytes()


def test_a_picture_of_two_runs_is_refused(tmp_path: Path) -> None:
    logs = [PAIR[0], str(CORPUS / "four-vehicles/2002.ndjson")]
    options = ["--to", "svg", "--out", str(tmp_path)]
    answer = automcm("trace", "export", *logs, *options)
    assert answer.exit_code == 3 and "run" in answer.output


def test_itf_of_a_folder_is_refused_in_words(tmp_path: Path) -> None:
    answer = automcm("trace", "itf", tmp_path)
    assert answer.exit_code == 3 and "is a directory; expected a log" in answer.output


def test_export_names_what_it_cannot_read(tmp_path: Path) -> None:
    options = ["--out", str(tmp_path / "out")]
    answer = automcm("trace", "export", CORPUS / "bad/empty.ndjson", *options)
    assert answer.exit_code == 3
    assert "empty.ndjson" in answer.output
