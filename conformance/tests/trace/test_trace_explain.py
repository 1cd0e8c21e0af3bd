"""``automcm trace explain`` at the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm

CORPUS = Path(__file__).resolve().parents[3] / "traces" / "corpus" / "four-vehicles"
LOGS = sorted(str(path) for path in CORPUS.iterdir())


@pytest.fixture
def wrong(tmp_path: Path) -> Path:
    """NEG-2: an Acceptance of another proposal than was prescribed."""
    path = tmp_path / "wrong.ndjson"
    text = (CORPUS / "3003.ndjson").read_text()
    at = text.index('"type":"Acceptance"')
    path.write_text(text[:at] + text[at:].replace('"proposal":1', '"proposal":2', 1))
    return path


def explained(*args: str | Path) -> tuple[int, Any]:
    answer = automcm("trace", "explain", *args, "--json", "-")
    return answer.exit_code, json.loads(answer.output)


def test_a_divergence_is_exit_1_and_leaves_its_prefix(wrong: Path, tmp_path: Path) -> None:
    code, told = explained(wrong, "--out", tmp_path / "out")
    assert code == 1
    asked = {"verdict", "file", "line", "event", "rule", "expected", "guard", "possible_states"}
    assert asked <= told.keys() and told["number_of_sessions"] == len(told["sessions"]) == 1
    assert (told["verdict"], told["rule"]) == ("diverges", "NEG-2")
    assert "OnAccept" in told["guard"] and told["possible_states"] == 1 and told["of_last_input"]
    prefix = Path(told["prefix"])
    assert prefix.parent == tmp_path / "out" and told["replay"].startswith("automcm trace replay")
    assert explained(prefix, "--out", tmp_path / "out")[1]["line"] == told["line"]


def test_a_prefix_that_cannot_be_written_is_told(wrong: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("no folder")
    answer = automcm("trace", "explain", wrong, "--out", tmp_path / "out")
    assert answer.exit_code == 1 and "could not be written" in answer.output


def test_a_log_may_come_from_standard_input(wrong: Path, tmp_path: Path) -> None:
    here = explained(wrong, "--out", tmp_path / "out")[1]
    arguments = ["trace", "explain", "-", "--json", "-", "--out", str(tmp_path / "again")]
    answer = automcm(*arguments, input=wrong.read_bytes())
    told = json.loads(answer.output)
    assert answer.exit_code == 1 and told["file"] == "-"
    assert Path(told["prefix"]).read_bytes() == Path(here["prefix"]).read_bytes()
    assert {name: told[name] for name in ("line", "event", "rule", "expected")} == {
        name: here[name] for name in ("line", "event", "rule", "expected")
    }


def test_logs_of_one_name_leave_a_prefix_each(wrong: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = tmp_path / "other" / wrong.name
    other.write_bytes(wrong.read_bytes().replace(b'"run":"seed-', b'"run":"other-'))
    logs = explained(wrong, other, "--out", tmp_path / "out")[1]["logs"]
    runs = [json.loads(Path(log["prefix"]).read_text().splitlines()[0])["run"] for log in logs]
    assert len(set(runs)) == 2


def test_a_prefix_does_not_overwrite_a_log_that_is_given(wrong: Path, tmp_path: Path) -> None:
    (log,) = explained(wrong, wrong, "--out", tmp_path)[1]["logs"][:1]
    given = Path(log["prefix"])
    given.write_bytes(Path(LOGS[0]).read_bytes())
    (tmp_path / "loop").symlink_to("loop")
    explained(wrong, given, tmp_path / "loop", "--out", tmp_path / ".." / tmp_path.name)
    assert given.read_bytes() == Path(LOGS[0]).read_bytes()


def test_several_logs_are_judged_together() -> None:
    code, told = explained(*LOGS)
    assert code == 0 and told["system"]["verdict"] == "allowed"
    assert [log["verdict"] for log in told["logs"]] == ["allowed"] * 4
    assert {p["outcome"] for p in told["system"]["properties"]} == {"holds"}


def test_a_folder_stands_for_its_logs(tmp_path: Path) -> None:
    assert explained(CORPUS)[1] == explained(*LOGS)[1]
    answer = automcm("trace", "explain", tmp_path)
    assert answer.exit_code == 3 and "contains no log" in answer.output


def test_the_worst_verdict_is_the_exit_code(wrong: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.ndjson").write_text("")
    out = ("--out", tmp_path / "out")
    assert explained(tmp_path / "empty.ndjson")[0] == 3
    assert explained(tmp_path / "empty.ndjson", LOGS[0])[0] == 3
    assert explained(tmp_path / "empty.ndjson", wrong, *out)[0] == 1


@pytest.mark.parametrize("damage", [[], [b"\x00\xff\x7frubbish\n"]], ids=["a gap", "rubbish"])
def test_what_diverges_before_a_log_is_damaged_does(
    damage: list[bytes], wrong: Path, tmp_path: Path
) -> None:
    lines = wrong.read_bytes().splitlines(keepends=True)
    wrong.write_bytes(b"".join([*lines[:80], *damage, *lines[83:]]))
    code, told = explained(wrong, "--out", tmp_path / "out")
    assert (code, told["verdict"], told["line"]) == (1, "diverges", 54)


def test_a_log_cut_before_a_restart_is_judged_from_there(tmp_path: Path) -> None:
    """A divergence after it has a prefix and can be shrunk, but not be replayed."""
    source = CORPUS.parent / "behaviours" / "restarts" / "005-1001.ndjson"
    lines = [json.loads(line) for line in source.read_text().splitlines()]
    restart = next(n for n, line in enumerate(lines) if line.get("ev") == "restart")
    answer = next(n for n in range(restart, len(lines)) if is_answer(lines[n]))
    kept = [lines[0], *lines[4:answer], *lines[answer + 1 :]]
    for line in kept[answer - 3 :]:
        line["seq"] -= 1
    path = tmp_path / "cut.ndjson"
    path.write_text("".join(json.dumps(line) + "\n" for line in kept))
    code, told = explained(path, "--out", tmp_path / "out")
    assert (code, told["verdict"], told["judged_from"]) == (1, "diverges", restart - 2)
    assert "replay" not in told
    assert explained(Path(told["prefix"]), "--out", tmp_path / "out")[1]["line"] == told["line"]
    small = tmp_path / "small" / "cut.ndjson"
    assert automcm("trace", "shrink", path, "--out", small.parent).exit_code == 0
    code, again = explained(small, "--out", tmp_path / "out")
    assert (code, again["rule"]) == (1, told["rule"])
    assert json.loads(small.read_text().splitlines()[0])["begins"] == "running"
    refused = automcm("trace", "replay", small, "--out", tmp_path, "--", "automcm", "adapter")
    assert refused.exit_code == 4 and "mid-session" in refused.output


def is_answer(line: Any) -> bool:
    return bool(line.get("ev") == "send" and line["message"]["type"] != "CAM")
