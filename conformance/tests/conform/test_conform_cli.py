"""``automcm conform`` and ``automcm adapter``: output, files and exit codes."""

from __future__ import annotations

import json
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from broken_stations import REFERENCE
from cli_stage import automcm
from junitparser import JUnitXml

from automcm.adapters.adapter_lines import HELLO
from automcm_conformance.report import report
from automcm_traces.explain.explain import verdicts_of

Json = Any
CASE = "AMCM/STA/END/BI-19"
OTHER = "AMCM/RCV/ADV/TI-03"
CARELESS = [
    sys.executable,
    "-c",
    """
import json, sys
from automcm.adapters.adapter_lines import Kit
kit = Kit()
for line in sys.stdin:
    command = json.loads(line)
    if command["cmd"] == "stop":
        break
    command.get("message", {}).pop("unknown", None)
    print(json.dumps(kit.answer(command)), flush=True)
""",
]
"""A station that overlooks an unknown field in a message (END-5)."""


@dataclass
class Done:
    code: int
    out: str
    folder: Path

    @property
    def report(self) -> Json:
        return json.loads((self.folder / "report.json").read_text())


def conform(folder: Path, *arguments: str, command: list[str] = REFERENCE) -> Done:
    answer = automcm("conform", "run", *arguments, "--out", folder, "--", *command)
    return Done(answer.exit_code, answer.output, folder)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Done:
    return conform(tmp_path_factory.mktemp("good"), CASE, OTHER)


@pytest.fixture(scope="module")
def bad(tmp_path_factory: pytest.TempPathFactory) -> Done:
    return conform(tmp_path_factory.mktemp("bad"), CASE, OTHER, command=CARELESS)


# -- run


def test_a_run_that_passes(good: Done) -> None:
    assert good.code == 0, good.out
    assert "automcm reference" in good.out and "Every verdict is as expected" in good.out
    found = good.report
    assert found["exit_code"] == 0 and found["counts"]["PASS"] == 2
    assert found["selectors"] == [CASE, OTHER] and found["seed"] == 1
    assert found["implementation"]["command"] == REFERENCE
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", found["started"])
    assert report.load(good.folder / "report.json").counts["PASS"] == 2
    logs = [good.folder / case["log"] for case in found["cases"]]
    assert {verdict.verdict for verdict in verdicts_of(logs)} == {"allowed"}
    assert {path.name for path in good.folder.iterdir()} == {
        *("report.json", "report.html", "junit.xml", "logs")
    }


def test_a_run_that_fails(bad: Done) -> None:
    assert bad.code == 1, bad.out
    assert re.search(rf"FAIL +{CASE}", bad.out) and "Unexpected: 1 of 2 cases" in bad.out
    assert "END-5: " in bad.out, "the failure itself is shown"
    (case,) = [case for case in bad.report["cases"] if case["verdict"] == "FAIL"]
    (failure,) = case["failures"]
    assert (bad.folder / failure["replay"]).exists()
    assert "conform replay" in failure["command"] and failure["replay"] in failure["command"]
    suites = list(JUnitXml.fromfile(str(bad.folder / "junit.xml")))
    assert sum(each.tests for each in suites) == 2
    assert sum(each.failures for each in suites) == 1


def test_the_log_of_a_failure_is_also_a_page_that_the_report_links_to(bad: Done) -> None:
    failed, passed = sorted(bad.report["cases"], key=lambda case: case["verdict"])
    assert not passed["page"] and failed["page"] == failed["log"].replace(".ndjson", ".html")
    page = (bad.folder / failed["page"]).read_text()
    assert f"<title>{CASE}: FAIL</title>" in page, "a malformed message"
    data = json.loads(page.split('id="data">')[1].split("</script>")[0])
    what = failed["failures"][0]["what"]
    (log,), (judged,) = data["logs"], data["runs"][0]["verdicts"]
    assert log["diverges"] >= 0, "the page opens there"
    assert judged["verdict"] == "diverges"
    assert data["note"].startswith("The verdict is that of the kit") == (what in judged["event"])
    assert f'"file":"{failed["log"]}"' in page and str(bad.folder) not in page
    assert f'<a href="{failed["page"]}">' in (bad.folder / "report.html").read_text()


def test_json_on_standard_output_is_all_there_is(tmp_path: Path) -> None:
    options = ["--json", "-", "--out", tmp_path / "r"]
    done = automcm("conform", "run", CASE, *options, "--", *CARELESS)
    assert done.exit_code == 1 and done.stderr == ""
    assert json.loads(done.stdout) == json.loads((tmp_path / "r" / "report.json").read_text())


def test_json_that_cannot_be_written_is_3_and_the_report_is_there(tmp_path: Path) -> None:
    done = conform(tmp_path / "r", CASE, "--json", str(tmp_path / "no" / "where.json"))
    assert done.code == 3 and "where.json" in done.out
    assert done.report["counts"]["PASS"] == 1


def test_only_what_failed_last_time_runs_again(
    tmp_path: Path, good: Done, bad: Done, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    runs = Path("runs")
    failed = ("conform", "run", "--failed", "--", *CARELESS)
    assert "there is no report of this command" in automcm(*failed).output
    for name, done in (("bad", bad), ("good", good)):
        (runs / name).mkdir(parents=True)
        shutil.copy(done.folder / "report.json", runs / name)
    answer = automcm(*failed)
    assert answer.exit_code == 1
    (folder,) = {*runs.iterdir()} - {runs / "bad", runs / "good"}
    assert folder.name in answer.output and (folder / "report.html").exists()
    found = json.loads((folder / "report.json").read_text())
    assert [case["id"] for case in found["cases"]] == [CASE]
    again = automcm("conform", "run", OTHER, "--failed", "--", *CARELESS)
    assert again.exit_code == 0 and "no case failed last time" in again.output


def test_the_folder_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    assert conform(tmp_path / "file", CASE).code == 3
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["run", CASE], "after --"),
        (["run", CASE, "--"], "after --"),
        (["replay", "x.json"], "after --"),
        (["check-adapter"], "after --"),
        (["run", "AMCM/RVC", "--", "true"], "AMCM/RCV"),
        (["run", "NEG-44", "--", "true"], "NEG-4"),
        (["run", "MOST", "--", "true"], "MUST"),
        (["list", "AMCM/RCV/NEG/BI-99"], "AMCM/RCV/NEG/BI-0"),
        (["list", "--explain", "nonsense"], "no case has this id"),
        (["run", "--limit", "0", "--", "true"], "--limit"),
        (["run", "--limit", "nan", "--", "true"], "--limit"),
        (["run", "--seed", "-1", "--", "true"], "--seed"),
    ],
    ids=" ".join,
)
def test_usage_errors_are_2(arguments: list[str], says: str) -> None:
    answer = automcm("conform", *arguments)
    assert answer.exit_code == 2, answer.output
    assert says in " ".join(answer.output.split())


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (["/no/such/adapter"], "/no/such/adapter cannot be started"),
        ([sys.executable, "-c", "import sys; sys.exit('no station here')"], "exit code 1"),
    ],
)
def test_no_hello_is_3(tmp_path: Path, command: list[str], says: str) -> None:
    done = conform(tmp_path, CASE, command=command)
    assert done.code == 3 and says in done.out
    assert ("no station here" in done.out) == ("station" in command[-1])
    assert not (tmp_path / "report.json").exists()


def test_an_adapter_that_breaks_is_3_with_a_report(tmp_path: Path) -> None:
    code = f"input(); print({json.dumps(json.dumps(HELLO))}, flush=True); input(); 1 / 0"
    done = conform(tmp_path, CASE, command=[sys.executable, "-c", code])
    assert done.code == 3
    assert done.report["counts"]["ERROR"] == 1 and "ZeroDivisionError" in done.out


@pytest.mark.slow
def test_what_is_expected_is_no_failure(tmp_path: Path) -> None:
    file = tmp_path / "known.toml"
    file.write_text(f'"{CASE}" = {{verdict = "FAIL", because = "ticket 12"}}\n')
    done = conform(tmp_path / "bad", CASE, "--expect", str(file), command=CARELESS)
    assert done.code == 0, done.out
    (case,) = done.report["cases"]
    assert (case["verdict"], case["expected"], case["because"]) == ("FAIL", True, "ticket 12")
    done = conform(tmp_path / "good", CASE, "--expect", str(file))
    assert done.code == 1 and "FAIL was expected" in done.out


@pytest.mark.parametrize("text", [None, "= 1"])
def test_a_bad_file_of_expectations_is_3(tmp_path: Path, text: str | None) -> None:
    file = tmp_path / "known.toml"
    if text is not None:
        file.write_text(text)
    done = conform(tmp_path / "r", CASE, "--expect", str(file))
    assert done.code == 3 and "known.toml" in done.out.replace("\n", "")
    assert not (tmp_path / "r").exists()


# -- list


def test_list_names_the_cases() -> None:
    listed = json.loads(automcm("conform", "list", "--json", "-").output)
    assert len(listed) > 200
    assert set(listed[0]) == {"id", "level", "rules", "given", "when", "then", "bug", "cost"}
    some = automcm("conform", "list", "NEG-4")
    assert some.exit_code == 0 and "AMCM/RCV/NEG/BI-04" in some.output
    assert CASE not in some.output and "\x1b" not in some.output


def test_explain_says_all_of_one_case() -> None:
    answer = automcm("conform", "list", "--explain", "AMCM/RCV/NEG/BI-04")
    assert answer.exit_code == 0
    words = ["conform", "list", "--explain", "AMCM/RCV/NEG/BI-04", "--json", "-"]
    (case,) = json.loads(automcm(*words).output)
    for name in ("given", "when", "then", "bug", "cost"):
        assert f"{name:>6}  " in answer.output
        assert case[name].split()[-1] in answer.output
    assert "NEG-4, END-4" in answer.output


# -- replay


def test_a_replay_fails_again_and_passes_on_the_reference(bad: Done, tmp_path: Path) -> None:
    (file,) = (bad.folder / "replay").iterdir()
    again = automcm("conform", "replay", file, "--", *CARELESS)
    assert again.exit_code == 1 and f"FAIL {CASE}" in again.output
    odd = "Intention with unknown 1: "
    assert odd in bad.out and f"END-5: {odd}" in again.output, "what is wrong with the message"
    other = tmp_path / "other.json"
    told = json.loads(file.read_text())
    for what, rule in (("phase", "END-5"), (f"{told['what']}; more", "NEG-4")):
        other.write_text(json.dumps(told | {"rule": "NEG-4", "what": what}))
        assert f"{rule}: " in automcm("conform", "replay", other, "--", *CARELESS).output
    right = automcm("conform", "replay", file, "--json", "-", "--", *REFERENCE)
    assert right.exit_code == 0
    assert json.loads(right.output) == {"case": CASE, "verdict": "PASS", "what": ""}


def test_a_replay_that_breaks_shows_what_led_to_it(bad: Done) -> None:
    (file,) = (bad.folder / "replay").iterdir()
    odd = "if 'unknown' in line: print('no room', file=sys.stderr); sys.exit(7)"
    broken = [*CARELESS[:2], CARELESS[2].replace("command.get(", f"{odd}\n    command.get(")]
    answer = automcm("conform", "replay", file, "--", *broken)
    assert answer.exit_code == 3
    lines = answer.output.split(f"ERROR {CASE}  END-5: ")[0].splitlines()
    assert "reset: a new station" in lines[0] and "kit      receive" in "".join(lines[-2:])
    said = " ".join(answer.output.split())
    assert "exit code 7" in said and "stderr no room" in said
    data = automcm("conform", "replay", file, "--json", "-", "--", *broken)
    assert data.exit_code == 3 and json.loads(data.stdout)["verdict"] == "ERROR"


def test_a_file_that_is_no_replay_is_3(tmp_path: Path) -> None:
    """What may be wrong in one is in test_answers."""
    (tmp_path / "replay.json").write_text('{"format": "automcm.replay/2"}')
    for name, says in (("none", "No such file"), ("replay", "format: must be 'automcm.replay/1'")):
        answer = automcm("conform", "replay", tmp_path / f"{name}.json", "--", *REFERENCE)
        assert answer.exit_code == 3 and says in answer.output


# -- check-adapter, new, report


def test_check_adapter_as_json() -> None:
    wrong = [sys.executable, "-c", "input(); print('{}', flush=True); input()"]
    answer = automcm("conform", "check-adapter", "--limit", "5", "--json", "-", "--", *wrong)
    assert answer.exit_code == 1
    assert "error" in {finding["level"] for finding in json.loads(answer.output)}


def test_a_new_adapter_is_in_a_new_folder(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    answer = automcm("conform", "new", "--language", "python", folder)
    assert answer.exit_code == 0 and f"automcm conform run -- {folder / 'run'}" in answer.output
    again = automcm("conform", "new", folder)
    assert again.exit_code == 2 and "not an empty folder" in " ".join(again.output.split())
    assert automcm("conform", "new", "--language", "ada", tmp_path / "ada").exit_code == 2


def test_reports_side_by_side(tmp_path: Path, good: Done, bad: Done) -> None:
    page = tmp_path / "both.html"
    files = [str(done.folder / "report.json") for done in (good, bad)]
    answer = automcm("conform", "report", *files, "--out", page)
    assert answer.exit_code == 0 and str(page) in answer.output.replace("\n", "")
    assert page.read_text().count("automcm reference") >= 2
    (tmp_path / "x.json").write_text("{}")
    for arguments in (
        [str(tmp_path / "none.json"), "--out", str(page)],
        [str(tmp_path / "x.json"), f"--out={page}"],
        [*files, "--out", str(tmp_path / "no" / "where.html")],
    ):
        answer = automcm("conform", "report", *arguments)
        assert answer.exit_code == 3 and "report: " in answer.output
    assert automcm("conform", "report").exit_code == 2
