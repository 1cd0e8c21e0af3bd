"""``automcm trace html``: one file, and one clear error where there cannot be one."""

import json
from pathlib import Path

from typer.testing import CliRunner

from automcm_cli.main import app

TRACES = Path(__file__).parents[2] / "traces"
CORPUS = TRACES / "corpus"


def test_the_page_is_written_whatever_the_verdict(tmp_path: Path) -> None:
    log, out = CORPUS / "bad" / "busy_accepted.ndjson", tmp_path / "new" / "page.html"
    run = CliRunner().invoke(app, ["trace", "html", str(log), "--out", str(out), "--json", "-"])
    assert run.exit_code == 0, run.output
    told = json.loads(run.stdout)
    assert told["written"] == str(out) and told["bytes"] == out.stat().st_size
    explained = CliRunner().invoke(
        app, ["trace", "explain", str(log), "--out", str(tmp_path), "--json", "-"]
    )
    wanted = json.loads(explained.stdout)
    del wanted["prefix"], wanted["replay"]
    assert told["logs"] == [wanted]


def test_a_folder_stands_for_the_logs_in_it(tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    run = CliRunner().invoke(
        app, ["trace", "html", str(CORPUS / "four-vehicles"), "--out", str(out)]
    )
    assert run.exit_code == 0 and run.stdout.startswith(f"{out}: ")
    assert b"4004.ndjson: ALLOWED" in out.read_bytes()


def test_a_counterexample_is_named_after_its_file(tmp_path: Path) -> None:
    itf = TRACES / "counterexamples" / "ack_from_anybody.itf.json"
    out = tmp_path / "page.html"
    run = CliRunner().invoke(app, ["trace", "html", str(itf), "--out", str(out), "--json", "-"])
    assert run.exit_code == 0, run.output
    names = {log["file"] for log in json.loads(run.stdout)["logs"]}
    assert names and all(name.startswith("ack_from_anybody-") for name in names)
    assert b"ack_from_anybody" in out.read_bytes() and b"/scratch/" not in out.read_bytes()


def test_what_is_no_log_is_named(tmp_path: Path) -> None:
    (tmp_path / "rubbish").write_bytes(bytes(range(256)))
    for path, words in (("rubbish", "rubbish:1"), ("nothing", "no such file")):
        run = CliRunner().invoke(app, ["trace", "html", str(tmp_path / path)])
        assert run.exit_code == 3 and words in run.stderr and "Traceback" not in run.stderr


def test_logs_of_two_runs_are_refused() -> None:
    logs = [str(CORPUS / "pair" / "1001.ndjson"), str(CORPUS / "four-vehicles" / "2002.ndjson")]
    run = CliRunner().invoke(app, ["trace", "html", *logs])
    assert run.exit_code == 3 and "but" in run.stderr and run.stderr.count("\n") == 1


def test_two_runs_are_compared(tmp_path: Path) -> None:
    out, pair = tmp_path / "page.html", CORPUS / "pair"
    good, bad = str(CORPUS / "four-vehicles"), str(pair)
    run = CliRunner().invoke(
        app, ["trace", "html", good, "--compare", bad, "--out", str(out), "--json", "-"]
    )
    assert run.exit_code == 0, run.output
    told = json.loads(run.stdout)
    diff = CliRunner().invoke(app, ["trace", "diff", good, bad, "--json", "-"])
    assert {**told["diff"], "first": 0} == {**json.loads(diff.stdout), "first": 0}
    assert [log["file"] for log in told["b"]["logs"]] == [
        str(pair / "1001.ndjson"),
        str(pair / "2002.ndjson"),
    ]


def test_two_counterexamples_are_compared(tmp_path: Path) -> None:
    itf = [str(TRACES / "counterexamples" / f"{n}.itf.json") for n in ("no_lease", "no_decide")]
    out = tmp_path / "page.html"
    run = CliRunner().invoke(app, ["trace", "html", itf[0], "--compare", itf[1], "--out", str(out)])
    assert run.exit_code == 0, run.output
    text = out.read_bytes()
    assert b"no_lease-1" in text and b"no_decide-1" in text and b"/scratch/" not in text


def test_runs_that_cannot_be_compared_are_refused(tmp_path: Path) -> None:
    pair, four = CORPUS / "pair", CORPUS / "four-vehicles" / "3003.ndjson"
    found = ["trace", "html", str(pair), "--out", str(tmp_path / "page.html")]
    run = CliRunner().invoke(app, [*found, "--compare", str(four)])
    assert run.exit_code == 3 and run.stderr.startswith("html: no station to compare: A has 1001,")
    assert run.stderr.count("\n") == 1
    run = CliRunner().invoke(app, [*found, "--compare", str(four), "--stations", "2002=3003"])
    assert run.exit_code == 0, run.output
    run = CliRunner().invoke(app, [*found, "--stations", "2002=3003"])
    assert run.exit_code == 2 and "only with --compare" in run.stderr
