"""``automcm trace html``: one file, and one clear error where there cannot be one."""

import json
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli_stage import automcm

from automcm_cli.trace import trace_logs
from automcm_traces.export import itf_log
from automcm_traces.viewer import page_part

TRACES = Path(__file__).parents[3] / "traces"
CORPUS = TRACES / "corpus"


def test_the_page_is_written_whatever_the_verdict(tmp_path: Path) -> None:
    log, out = CORPUS / "bad" / "busy_accepted.ndjson", tmp_path / "new" / "page.html"
    run = automcm("trace", "html", log, "--out", out, "--json", "-")
    assert run.exit_code == 0, run.output
    told = json.loads(run.stdout)
    assert told["written"] == str(out) and told["bytes"] == out.stat().st_size
    explained = automcm("trace", "explain", log, "--out", tmp_path, "--json", "-")
    wanted = json.loads(explained.stdout)
    del wanted["prefix"], wanted["replay"]
    assert told["logs"] == [wanted]


def test_logs_that_cannot_be_shown_are_named_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "rubbish").write_bytes(bytes(range(256)))
    two = [CORPUS / "pair" / "1001.ndjson", CORPUS / "four-vehicles" / "2002.ndjson"]
    for logs, words in (
        ([tmp_path / "rubbish"], "rubbish:1"),
        ([tmp_path / "nothing"], "no such file"),
        (two, "must be of run"),
    ):
        code, _, err = html_of(*logs)
        assert code == 3 and words in err and err.count("\n") == 1


def test_the_page_does_not_overwrite_the_traffic(tmp_path: Path) -> None:
    traffic = tmp_path / "t.json"
    traffic.write_text("{}")
    for options in (["--out", traffic], ["--out", tmp_path / "p.html", "--json", traffic]):
        run = automcm("trace", "html", CORPUS / "pair", "--traffic", traffic, *options)
        assert run.exit_code == 2 and traffic.read_text() == "{}"


def test_two_runs_are_compared(tmp_path: Path) -> None:
    out, pair = tmp_path / "page.html", CORPUS / "pair"
    good, bad = str(CORPUS / "four-vehicles"), str(pair)
    run = automcm("trace", "html", good, "--compare", bad, "--out", out, "--json", "-")
    assert run.exit_code == 0, run.output
    told = json.loads(run.stdout)
    diff = automcm("trace", "diff", good, bad, "--json", "-")
    assert {**told["diff"], "first": 0} == {**json.loads(diff.stdout), "first": 0}
    assert [log["file"] for log in told["b"]["logs"]] == [
        str(pair / "1001.ndjson"),
        str(pair / "2002.ndjson"),
    ]


@pytest.mark.slow
def test_two_counterexamples_are_compared(tmp_path: Path) -> None:
    itf = [str(TRACES / "counterexamples" / f"{n}.itf.json") for n in ("no_lease", "no_decide")]
    out = tmp_path / "page.html"
    run = automcm("trace", "html", itf[0], "--compare", itf[1], "--out", out)
    assert run.exit_code == 0, run.output
    text = out.read_bytes()
    assert b"no_lease-1" in text and b"no_decide-1" in text and b"/scratch/" not in text


def test_runs_that_cannot_be_compared_are_refused(tmp_path: Path) -> None:
    pair, four = CORPUS / "pair", CORPUS / "four-vehicles" / "3003.ndjson"
    found = ["trace", "html", str(pair), "--out", str(tmp_path / "page.html")]
    run = automcm(*found, "--compare", four)
    assert run.exit_code == 3 and run.stderr.startswith("html: no station to compare: A has 1001,")
    assert run.stderr.count("\n") == 1
    run = automcm(*found, "--compare", four, "--stations", "2002=3003")
    assert run.exit_code == 0, run.output
    run = automcm(*found, "--stations", "2002=3003")
    assert run.exit_code == 2 and "is only allowed with --compare" in run.stderr


# -- what is read once, and what messages call it

LOG = CORPUS / "pair" / "1001.ndjson"
OTHER = CORPUS / "pair" / "2002.ndjson"


@contextmanager
def pipe_with(path: Path, data: bytes) -> Iterator[Path]:
    """A named pipe into which somebody writes once."""
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_bytes, args=[data], daemon=True)
    writer.start()
    yield path
    writer.join(10)


def html_of(*arguments: object, data: bytes | None = None) -> tuple[int, str, str]:
    """The exit code, standard output and standard error."""
    run = automcm("trace", "html", *arguments, input=data)
    assert run.exception is None or isinstance(run.exception, SystemExit), run.exception
    return run.exit_code, run.stdout, run.stderr


def test_a_log_through_a_pipe_gives_the_page_of_the_log(tmp_path: Path) -> None:
    page, again = tmp_path / "page.html", tmp_path / "again.html"
    html_of(LOG, OTHER, "--out", page)
    with pipe_with(tmp_path / "pipe", LOG.read_bytes()) as pipe:
        code, out, _ = html_of(pipe, OTHER, "--out", again, "--json", "-")
    assert code == 0 and json.loads(out)["logs"][0]["file"] == str(pipe)
    assert again.read_text() == page.read_text().replace(str(LOG), str(pipe))
    code, out, _ = html_of("-", "--out", again, "--json", "-", data=LOG.read_bytes())
    assert code == 0 and json.loads(out)["logs"][0]["file"] == "-"
    assert tempfile.gettempdir() not in again.read_text()


@pytest.mark.parametrize("command", ["explain", "lint", "show", "coverage", "export"])
def test_no_command_names_the_file_that_keeps_standard_input(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[Path] = []
    keep = trace_logs._kept
    monkeypatch.setattr(trace_logs, "_kept", lambda log: kept.append(keep(log)) or kept[-1])
    arguments = ["trace", command, "-", "--json", str(tmp_path / "told.json")]
    arguments += ["--out", str(tmp_path)] if command in ("explain", "export") else []
    for data in (b"rubbish", LOG.read_bytes(), OTHER.read_bytes() + b"rubbish\n"):
        run = automcm(*arguments, input=data)
        told = tmp_path / "told.json"
        written = told.read_text() if told.is_file() else ""
        for text in (run.stdout, run.stderr, written):
            assert os.fspath(kept[-1].parent) not in text
    assert len(kept) == 3


def test_diff_takes_a_log_through_a_pipe(tmp_path: Path) -> None:
    with pipe_with(tmp_path / "pipe", LOG.read_bytes()) as pipe:
        run = automcm("trace", "diff", pipe, LOG, "--json", "-")
    assert run.exit_code == 0, run.output
    assert [one["a"] for one in json.loads(run.stdout)["stations"]] == [str(pipe)]


def test_a_device_is_refused_and_not_read() -> None:
    code, _, err = html_of("/dev/zero")
    assert (code, err.count("\n")) == (3, 1) and err.startswith(
        "html: /dev/zero: must be a regular file"
    )


def test_a_log_of_a_counterexample_that_is_wrong_is_named_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(itf_log.Behaviour, "logs", lambda self: {1: b"rubbish\n"})
    itf = TRACES / "counterexamples" / "ack_from_anybody.itf.json"
    code, _, err = html_of(itf, "--out", tmp_path / "page.html")
    assert code == 3 and err.startswith("html: ack_from_anybody-1.ndjson:1: not JSON")


# -- a part of what is too long


def test_of_what_is_too_long_a_part_is_shown_and_the_options_that_choose_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = len(LOG.read_bytes().splitlines())
    monkeypatch.setattr(page_part, "MOST_EVENTS", lines - 3)
    out = tmp_path / "page.html"
    assert html_of(LOG, "--out", out)[0] == 0
    note = f"{LOG}: {lines} lines; a page shows at most {lines - 3} events. Choose a part with"
    assert note in out.read_text()
    code, _, err = html_of(LOG, "--out", out, "--compare", LOG)
    assert (code, err.count("\n")) == (3, 1) and "--from-line" in err and "--session" in err
    for part in (["--session", "1001/1"], ["--from-ms", 500], ["--to-ms", 500]):
        assert html_of(LOG, "--out", out, *part)[0] == 0
    for part in (["--from-line", 3], ["--to-line", lines - 2], ["--from-line", 9, "--to-line", 9]):
        assert html_of(LOG, "--out", out, *part)[0] == 0
    monkeypatch.setattr(page_part, "MOST_EVENTS", lines)
    assert html_of(LOG, "--out", out, "--compare", LOG)[0] == 3


def test_a_part_shows_these_lines(tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    code, _, _ = html_of(LOG, OTHER, "--out", out, "--from-line", 20, "--to-line", 30)
    assert code == 0 and f"A part: {LOG} lines 20 to 30, {OTHER} lines " in out.read_text()


def test_a_part_that_cannot_be_is_a_usage_error(tmp_path: Path) -> None:
    assert html_of(LOG, "--from-line", 9, "--to-line", 8)[0] == 2
    assert html_of(LOG, "--from-line", 0)[0] == 2
    assert html_of(LOG, "--from-ms", 9, "--to-ms", 8)[0] == 2
    assert html_of(LOG, "--from-ms", 9, "--to-line", 8)[0] == 2
    assert html_of(LOG, "--session", "1001")[0] == 2
    assert html_of(LOG, "--from-line", 9, "--compare", LOG)[0] == 2
    code, _, err = html_of(LOG, "--from-line", 9999, "--out", tmp_path / "page.html")
    assert (code, err.count("\n")) == (
        3,
        1,
    ) and "no readable event from line 9999 on" in err
    itf = TRACES / "counterexamples" / "ack_from_anybody.itf.json"
    code, _, err = html_of(itf, "--from-line", 2, "--out", tmp_path / "page.html")
    assert code == 3 and "a counterexample has none" in err
