"""``automcm trace shrink``, ``diff`` and ``export`` from the command line.

What they print is in test_pages_code.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_stage import automcm

CORPUS = Path(__file__).parents[3] / "traces/corpus"
LEASE = CORPUS / "bad/lease_longer.ndjson"
WINDOW = CORPUS / "bad/window_too_long.ndjson"
"""It takes no time to shrink."""
PAIR = [CORPUS / "pair/1001.ndjson", CORPUS / "pair/2002.ndjson"]


def test_a_shrunk_log_diverges_as_the_long_one(tmp_path: Path) -> None:
    shrunk = automcm("trace", "shrink", WINDOW, "--late", "60", "--json", "-", "--out", tmp_path)
    told = json.loads(shrunk.output)
    assert shrunk.exit_code == 0
    assert (told["rule"], told["line_before"], told["line"]) == ("ADV-1", 4, 3)
    (log,) = told["logs"]
    assert (log["events_before"], log["events"], log["file"]) == (92, 2, str(WINDOW))
    small = Path(log["written"])
    assert small == tmp_path / WINDOW.name and small.read_bytes().count(b"\n") == 4
    explained = automcm("trace", "explain", small, "--json", "-", "--out", tmp_path)
    verdict = json.loads(explained.output)
    assert explained.exit_code == 1
    assert (verdict["verdict"], verdict["rule"], verdict["line"]) == ("diverges", "ADV-1", 3)


def test_shrink_does_not_write_over_what_it_was_given(tmp_path: Path) -> None:
    path = tmp_path / "a.ndjson"
    path.write_bytes(WINDOW.read_bytes())
    assert automcm("trace", "shrink", path, "--out", tmp_path).exit_code == 2
    assert path.read_bytes() == WINDOW.read_bytes()


PICTURE = ["--to", "svg"]


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["shrink", *PAIR], 1, "nothing to shrink"),
        (["shrink", CORPUS / "bad/empty.ndjson"], 3, "empty file"),
        (["shrink", CORPUS / "bad/seq_gap.ndjson"], 4, "CANNOT TELL"),
        (["shrink", "nowhere.ndjson"], 3, "no such file"),
        (["export", PAIR[0], CORPUS / "four-vehicles/2002.ndjson", *PICTURE], 3, "run"),
        (["export", CORPUS / "bad/empty.ndjson"], 3, "empty.ndjson"),
        (["itf", CORPUS], 3, "is a directory; expected a log"),
    ],
)
def test_logs_that_will_not_do(words: list[str], code: int, says: str, tmp_path: Path) -> None:
    answer = automcm("trace", *words, "--out", tmp_path / "out")
    assert answer.exit_code == code and says in answer.output
    assert not (tmp_path / "out").exists()


def test_diff_as_json() -> None:
    answer = automcm("trace", "diff", PAIR[1], LEASE, "--json", "-")
    told = json.loads(answer.output)
    assert (answer.exit_code, told["same"], told["first"]) == (1, False, 2002)
    (station,) = told["stations"]
    assert station["difference"]["a"] == {"line": 59, "t_ms": 1374, "event": "arm lease +20000"}
    assert station["difference"]["fields"] == [{"field": "duration_ms", "a": 20000, "b": 21000}]


def test_diff_takes_folders_and_pairs_of_stations() -> None:
    pair, four = CORPUS / "pair", CORPUS / "four-vehicles"
    assert automcm("trace", "diff", pair, pair).exit_code == 0
    answer = automcm("trace", "diff", pair, four, "--stations", "2002=3003")
    assert answer.exit_code == 1
    assert "2002.ndjson: only B has this station" in answer.output
    answer = automcm("trace", "diff", PAIR[0], CORPUS / "bad/rubbish.ndjson")
    assert answer.exit_code == 3 and "rubbish.ndjson" in answer.output


@pytest.mark.parametrize("pairs", [["1001"], ["a=b"], ["1001=1", "1002=1"]])
def test_pairs_of_stations_that_make_no_sense_are_wrong_usage(pairs: list[str]) -> None:
    options = [part for pair in pairs for part in ("--stations", pair)]
    assert automcm("trace", "diff", *PAIR, *options).exit_code == 2


def test_export_writes_what_other_tools_read(tmp_path: Path) -> None:
    for to, name in (("mermaid", "1001.mmd"), ("svg", "1001.svg"), ("itf", "2002.itf.json")):
        options = ["--to", to, "--out", tmp_path, "--json", "-"]
        answer = automcm("trace", "export", CORPUS / "pair", *options)
        assert answer.exit_code == 0, answer.output
        assert str(tmp_path / name) in json.loads(answer.output)["written"]
        assert (tmp_path / name).stat().st_size > 1000
    answer = automcm("trace", "export", *PAIR, "--out", tmp_path / "1001.svg")
    assert answer.exit_code == 3 and f"{tmp_path}/1001.svg: File exists" in answer.output


def test_a_log_of_any_name_becomes_itf(tmp_path: Path) -> None:
    for name in ("a.log", "a.json"):
        (tmp_path / name).write_bytes(PAIR[0].read_bytes())
        assert automcm("trace", "itf", tmp_path / name, "--out", tmp_path / name[2:]).exit_code == 0
        assert (tmp_path / name[2:] / "a.itf.json").stat().st_size > 1000


def test_export_to_mcap_and_back(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    assert automcm("trace", "export", *PAIR, "--to", "mcap", "--out", tmp_path).exit_code == 0
    back = ["--to", "logs", "--out", tmp_path]
    file = tmp_path / "1001.mcap"
    assert automcm("trace", "export", file, file, *back).exit_code == 0
    assert (tmp_path / "2002.ndjson").read_bytes() == PAIR[1].read_bytes()
    other = ["trace", "export", CORPUS / "four-vehicles/1001.ndjson", "--out", tmp_path / "b"]
    assert automcm(*other, "--to", "mcap").exit_code == 0
    answer = automcm("trace", "export", file, tmp_path / "b/1001.mcap", *back)
    assert answer.exit_code == 2 and "named 1001.ndjson" in " ".join(answer.output.split())
