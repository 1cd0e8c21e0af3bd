"""Every command in the README and in docs/ is run by a test, or says here why it is not.

A command is a line of a block of code that begins with ``automcm``, ``.venv/bin/automcm`` or
``make``.  Each stands in ``TABLE``, and nothing else does.
"""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm
from first_hour import python_station
from page_texts import TEXTS
from typer.main import get_command

from automcm_cli.main import app
from automcm_evaluation.sweeps.catalogue import NAMES

ROOT = Path(__file__).resolve().parents[3]
LINE = re.compile(r"(?: {4,}|)(?:- run: )?(?:\.venv/bin/)?((?:automcm|make) (?!--).*)")
CORPUS = "traces/corpus"
PAIR = ROOT / CORPUS / "pair"


@dataclass(frozen=True)
class Run:
    """It is run here, and ends with this code; ``instead`` is what stands for placeholders."""

    code: int = 0
    instead: str = ""


@dataclass(frozen=True)
class By:
    """This test runs it, with less to do if it takes long: ``file.py::name``."""

    test: str


@dataclass(frozen=True)
class Parsed:
    """It is not run, for this reason; its options exist and accept the given values."""

    why: str


Way = Run | By | Parsed

STATION = By("test_demo.py::test_told_to_stop_while_it_listens_a_station_ends_well")
DEMO = By("test_demo.py::test_the_demonstration_ends_as_described")
BRIDGE = By("test_demo.py::test_driving_software_at_the_other_end_of_a_bridge")
LIVE = By("test_live.py::test_a_station_of_the_reference_over_sockets")
SHRINK = By("test_trace_edit.py::test_a_shrunk_log_diverges_as_the_long_one")
AGAIN = By("test_conform_cli.py::test_a_replay_fails_again_and_passes_on_the_reference")
SIDE = By("test_conform_cli.py::test_reports_side_by_side")
EXPLORE = By("test_explore.py::test_the_command_line")
EXPECT = By("test_conform_cli.py::test_what_is_expected_is_no_failure")
HOUR = By("test_first_hour.py::test_the_cases_of_the_page_pass")
MISTAKE = By("test_first_hour.py::test_the_mistake_of_the_page_is_found")
CHECK = By("test_cli.py::test_check_shows_and_writes_a_counterexample")
BENCHES = By("test_benches.py::test_each_bench_runs_and_has_a_baseline")
RENEWED = By("test_keys.py::test_certificates_are_renewed_while_a_session_runs")
ISSUED = By("test_keys.py::test_an_authority_issues_shows_and_revokes")
DRIVES = By("test_simulate_command.py::test_drives_are_counted_by_what_b_does")
DRAWN = By("test_simulate_command.py::test_the_lane_change_is_told_and_drawn")
PAGE = By("test_model_pages.py::test_a_page_shows_its_counterexample")
MUTANTS = By("test_mutants.py::test_the_command_reports")
PROOF = By("test_induction.py::test_all_is_proved")
ENCODINGS = By("test_bench.py::test_the_encodings_are_measured_on_the_same_model")
GUIDE = By("test_adding_a_rule.py::test_the_page_command_by_command")
FRESH = Parsed("minutes; make verify compares what it would write")
TRAFFIC = Parsed("needs SUMO: reference/tests/foreign_traffic.py runs it")
SEEDS = By("test_simulate_command.py::test_a_traffic_sweep_continues")
LONG = Parsed("a minute or more")
FOREIGN = Parsed("needs a compiler: conformance/tests/foreign.py runs it")
SHOWN = By("test_pages_code.py::test_an_excerpt_is_what_the_command_prints")
SWEEP = Parsed("minutes; test_experiment_cli.py runs a sweep that is short")
SYNOPSIS = Parsed("says what may be typed")

LOGS = "1001.ndjson 2002.ndjson"
TABLE: dict[str, Way] = {
    "automcm bench conform": BENCHES,
    "automcm bench conform --seconds 1": BENCHES,
    "automcm bench encodings --seconds 1": ENCODINGS,
    "automcm bench kernels": BENCHES,
    "automcm bench kernels --seconds 1": BENCHES,
    "automcm bench radio --seconds 1": BENCHES,
    "automcm bench security --seconds 1": BENCHES,
    "automcm bench station": BENCHES,
    "automcm bench station --seconds 1": BENCHES,
    "automcm bench traces": BENCHES,
    "automcm bench traces --seconds 1": BENCHES,
    "automcm bench traffic": BENCHES,
    "automcm bench traffic --seconds 1": BENCHES,
    "automcm bench window": BENCHES,
    "automcm bench window --seconds 1": BENCHES,
    "automcm conform certify --class timer --out runs/certificate": LONG,
    "automcm conform check-adapter -- ./my_adapter": Run(
        instead="conform check-adapter -- mine/run"
    ),
    "automcm conform check-adapter -- mine/run": Run(),
    "automcm conform explore 60 -- mine/run": EXPLORE,
    "automcm conform explore 60 --seed 7 -- ./my_adapter": EXPLORE,
    'automcm conform explore 600 --seed "$(date +%Y%m%d)" --out runs/explore -- mine/run': EXPLORE,
    "automcm conform explore SECONDS [--seed N] [--walks N] [--enough N]": SYNOPSIS,
    "automcm conform list --explain AMCM/RCV/NEG/BI-04": Run(),
    "automcm conform list NEG-4 --json -": Run(),
    "automcm conform live 7 -- automcm adapter": LIVE,
    "automcm conform live STATION [CASE...] [--broadcast HOST:PORT] [--host IP] [--jitter MS] "
    "[--set NAME=VALUE] [--json PATH] -- CMD": SYNOPSIS,
    "automcm conform new --language cpp mine-cpp": Run(),
    "automcm conform new --language cpp my_adapter": Run(
        instead="conform new --language cpp new-cpp"
    ),
    "automcm conform new --language python mine": Run(instead="conform new --language python new"),
    "automcm conform new --language python my_adapter": Run(),
    "automcm conform replay FILE -- mine/run": AGAIN,
    "automcm conform replay runs/x/replay/y-1.json -- ./my_adapter": AGAIN,
    "automcm conform report a.json b.json --out both.html": SIDE,
    "automcm conform run -- automcm adapter": LONG,
    "automcm conform run -- mine/run": LONG,
    "automcm conform run PRE-6 -- automcm adapter": Parsed("the rule is to be added before"),
    "automcm conform run --expect known.toml --out runs/suite -- mine/run": EXPECT,
    "automcm conform run AMCM/RCV -- python3 my_adapter.py": LONG,
    "automcm conform run AMCM/RCV/ADV/BV AMCM/RCV/NEG -- mine-cpp/run": FOREIGN,
    "automcm conform run AMCM/RCV/ADV/BV AMCM/RCV/NEG -- mine/run": HOUR,
    "automcm conform run AMCM/RCV/NEG/BI-05 -- mine/run": MISTAKE,
    "automcm conform run [SELECTOR...] [--quick] [--stop-after N] [--expect FILE]": SYNOPSIS,
    "automcm demo": DEMO,
    "automcm demo --close-early": DEMO,
    "automcm demo --kill B": DEMO,
    "automcm demo --loss 0.3": DEMO,
    "automcm demo --second-prescriber": DEMO,
    "automcm demo --secured": By("test_keys.py::test_a_demonstration_with_signed_messages"),
    "automcm drive --request-after 500": BRIDGE,
    "automcm drive --uri ws://127.0.0.1:9090": BRIDGE,
    "automcm drive --uri ws://192.0.2.7:9090 --token-file token": BRIDGE,
    "automcm experiment all --profile quick": SWEEP,
    **{f"automcm experiment {name} --profile quick --seed 1": SWEEP for name in NAMES},
    "automcm experiment render runs/evaluation": SWEEP,
    "automcm generate": FRESH,
    "automcm keys authority authority": ISSUED,
    "automcm keys issue authority keys-7 --id 7": ISSUED,
    "automcm keys issue authority keys-7 --renew": RENEWED,
    "automcm keys revoke authority --id 7": ISSUED,
    "automcm keys show keys-7": ISSUED,
    "automcm link relay --port 47200 --loss 0.2 --delay 5:40": DEMO,
    "automcm simulate drives --drives 20": DRIVES,
    "automcm simulate lane-change --vehicles 4 --speed 30": DRAWN,
    "automcm simulate traffic --scenario lane-change --vehicles 20": TRAFFIC,
    "automcm simulate traffic --scenario lane-change --vehicles 60 --radio ns3": TRAFFIC,
    "automcm simulate traffic --scenario merge --vehicles 20": TRAFFIC,
    "automcm simulate traffic-sweep --seeds 10": SEEDS,
    "automcm spec check --property T-2": LONG,
    "automcm spec check hazard_anything --json -": LONG,
    "automcm spec check no_busy_refusal": By(
        "test_pages_code.py::test_the_counterexample_of_the_page_is_what_is_printed"
    ),
    "automcm spec check one_by_three": Run(),
    "automcm spec check one_by_two two_by_one probe_system promise_kept": GUIDE,
    "automcm spec check rejoin --json -": CHECK,
    "automcm spec check retarget": CHECK,
    "automcm spec list": Run(),
    "automcm spec list --property T-2": Run(),
    "automcm spec mutate --only OnAck": MUTANTS,
    "automcm spec prove --step accept": PROOF,
    "automcm spec pages --out runs/counterexamples": PAGE,
    "automcm spec simulate two_by_three": LONG,
    "automcm station --id 1 --first --bridge 9090": BRIDGE,
    "automcm station --id 1 --first --bridge 9090 --host 192.0.2.7 --allow-remote "
    "--token-file token": BRIDGE,
    "automcm station --id 2 --first": STATION,
    "automcm station --id 7 --first": LIVE,
    "automcm station --id 7 --keys keys-7": RENEWED,
    "automcm station --id 7 --request-after 500": STATION,
    "automcm trace coverage logs/ --json coverage.json": Run(),
    "automcm trace diff run-1 run-2 --times": Run(),
    f"automcm trace diff {CORPUS}/pair/2002.ndjson {CORPUS}/bad/lease_longer.ndjson --times": SHOWN,
    f"automcm trace explain {LOGS}": Run(),
    "automcm trace explain 1.ndjson 2.ndjson": Run(instead=f"trace explain {LOGS}"),
    "automcm trace explain LOG...": Run(instead=f"trace explain {LOGS}"),
    "automcm trace explain runs/turn/1.ndjson runs/turn/2.ndjson runs/turn/3.ndjson": By(
        "test_pages_code.py::test_the_scenario_of_the_page_runs"
    ),
    "automcm trace explain small/wrong_proposal.ndjson": SHRINK,
    "automcm trace explain traces/corpus/bad/busy_accepted.ndjson": Run(1),
    f"automcm trace export {LOGS} --to mermaid": Run(),
    f"automcm trace export {LOGS} --to mermaid --out runs/export": Run(),
    f"automcm trace html {LOGS} --out page.html": Run(),
    "automcm trace html LOG... --out x.html": Run(instead=f"trace html {LOGS} --out x.html"),
    "automcm trace itf 1001.ndjson --out runs": Run(),
    "automcm trace itf FILE": Run(instead="trace itf 1001.ndjson"),
    "automcm trace itf traces/corpus/pair/2002.ndjson --out runs": Run(),
    "automcm trace itf traces/counterexamples/no_busy_refusal.itf.json --out runs": Run(),
    "automcm trace lint 1001.ndjson logs/": Run(),
    "automcm trace replay 2002.ndjson -- automcm adapter": Run(),
    "automcm trace replay LOG [--out DIR] [--seed N] [--limit S] [--json PATH] -- CMD": SYNOPSIS,
    f"automcm trace show {LOGS} --session 1001/1": Run(),
    f"automcm trace show {CORPUS}/pair/1001.ndjson {CORPUS}/pair/2002.ndjson --session 1001/1 "
    "--no-timers": SHOWN,
    f"automcm trace shrink {LOGS} --out small": SHRINK,
    f"automcm trace shrink {CORPUS}/bad/wrong_proposal.ndjson --out small": SHOWN,
    f"automcm trace watch {LOGS}": Run(),
    "automcm vectors check": By("test_vectors.py::test_the_command_agrees_with_the_reference"),
    "automcm vectors check --kernel collide": Run(),
    "automcm vectors check [--kernel KERNEL] [--json PATH]": SYNOPSIS,
    "automcm verify --profile full --json report.json": LONG,
    "automcm verify --no-models": GUIDE,
    "automcm verify --no-models --rule PRE-6": By(
        "test_adding_a_rule.py::test_the_short_loop_of_the_page"
    ),
    "make -C automcm .venv/ready": Parsed("it is what runs before every other target"),
    "make .venv/ready": Parsed("it is what runs before every other target"),
    "make generate": FRESH,
    "make test": Parsed("this test is a part of it"),
    "make verify": Parsed("minutes; .ci/run runs it"),
}


def commands() -> dict[str, str]:
    """Every command of the pages, and the first page that has it."""
    found: dict[str, str] = {}
    for path, page in TEXTS.items():
        fenced = False
        for line in page.splitlines():
            if line.lstrip().startswith("```"):
                fenced = not fenced
            elif (fenced or line.startswith("    ")) and (match := LINE.fullmatch(line)):
                command = re.sub(r"\s+#.*", "", match[1]).strip().removesuffix("\\").strip()
                found.setdefault(command.replace(".venv/bin/automcm", "automcm"), path.name)
    return found


COMMANDS = commands()
PROGRAM = get_command(app)
RUN = {
    way.instead or command.removeprefix("automcm "): way.code
    for command, way in TABLE.items()
    if isinstance(way, Run)
}
"""What is run, and its exit code.  The same once only."""


def test_every_command_of_the_pages_is_in_the_table_and_no_other() -> None:
    unknown = [f"{page}: {command}" for command, page in COMMANDS.items() if command not in TABLE]
    assert not unknown, "run it, name the test that runs it, or say why it is only parsed"
    assert sorted(set(TABLE) - set(COMMANDS)) == [], "no page has it any more"


def group_of(words: list[str]) -> tuple[Any, list[str]]:
    """The command that the first words name, and the other words."""
    command: Any = PROGRAM
    while words and hasattr(command, "commands"):
        assert words[0] in command.commands, f"no command {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    return command, words


AUTOMCM = [command for command in TABLE if command.startswith("automcm ")]


@pytest.mark.parametrize("command", AUTOMCM)
def test_its_options_exist_and_take_what_they_are_given(command: str) -> None:
    words = shlex.split(command.replace("$(date +%Y%m%d)", "20260101"))[1:]
    found, arguments = group_of(words)
    if TABLE[command] is SYNOPSIS:
        known = {option for each in found.params for option in each.opts}
        named = set(re.findall(r"--[a-z-]+", command.split(" -- ")[0]))
        assert named and named <= known
    else:
        found.make_context("automcm", arguments)


@pytest.mark.parametrize("command", [name for name in TABLE if name.startswith("make ")])
def test_make_has_the_target(command: str) -> None:
    target = command.split()[-1]
    assert re.search(rf"^{re.escape(target)}:", (ROOT / "Makefile").read_text(), re.MULTILINE)


def test_the_tests_named_are_there() -> None:
    for command, way in TABLE.items():
        if isinstance(way, By):
            file, name = way.test.split("::")
            (path,) = ROOT.glob(f"*/tests/**/{file}")
            assert f"\ndef {name}(" in path.read_text(), f"{command}: {way.test}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands name: logs, folders of them, an adapter."""
    made = tmp_path_factory.mktemp("commands")
    for name in ("1001.ndjson", "2002.ndjson"):
        shutil.copy(PAIR / name, made)
    for name in ("logs", "run-1", "run-2"):
        shutil.copytree(PAIR, made / name)
    (made / "traces").symlink_to(ROOT / "traces")
    python_station(made / "mine")
    return made


@pytest.mark.sweep(2)
@pytest.mark.parametrize("command", RUN)
def test_it_runs(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=":")
    answer = automcm(*shlex.split(command))
    assert answer.exit_code == RUN[command], answer.output
