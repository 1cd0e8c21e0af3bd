"""The suite's cases as tests of pytest.

The suite is run once, at the first of its tests, with those cases that are left after deselection;
then each test tells the verdict on its own.  Workers of pytest-xdist share one run: the first that
needs it makes it, the others wait for it.
"""

from __future__ import annotations

import fcntl
import json
import math
import shlex
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from automcm_conformance.adapter.kit_paths import fresh_folder
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import ProtocolError
from automcm_conformance.exchange.results import CaseResult, Report
from automcm_conformance.report import report
from automcm_conformance.suite import purposes, suite_run, verdicts
from automcm_spec.graph.oracle import OracleError
from automcm_spec.support import files, scratch
from automcm_spec.vocabulary.rules import RULES

NAME = "automcm"
"""Of the collector; a node id is ``automcm::AMCM/RCV/NEG/BI-03``."""


class Cases:
    """The hooks of a session with an adapter.

    Raises UsageError if an option says nothing that can be used.
    """

    def __init__(self, config: pytest.Config) -> None:
        def option(name: str) -> Any:
            given = config.getoption(f"automcm_{name}")
            return config.getini(f"automcm_{name}") if given is None else given

        for name in (*RULES, *purposes.LEVELS):
            config.addinivalue_line("markers", f"{name}: cases of this rule or level (automcm)")
        everything = purposes.load()
        self._all = len(everything)
        try:
            self._command = shlex.split(option("adapter"))
            self._chosen = purposes.select(everything, option("select"))
            self._limit_s, self._seed = float(option("limit") or 10), int(option("seed") or 1)
            if not self._command or not 0.01 <= self._limit_s < math.inf or self._seed < 0:
                raise ValueError("a command, a --automcm-limit from 0.01, a --automcm-seed from 0")
            file = option("expect")
            self._expected = verdicts.expectations(Path(file), everything) if file else {}
        except (ValueError, OSError) as error:
            raise pytest.UsageError(f"automcm: {error}") from None
        worker: dict[str, Any] = getattr(config, "workerinput", {})
        self._folder = Path(worker.get("automcm_folder") or option("out") or fresh_folder())
        self._shared: str = worker.get("automcm_shared", "")
        """The folder that the workers of pytest-xdist share; empty without them."""
        self._scratch = ExitStack()
        """Removes that folder, in the process that made it."""
        arguments = config.args_source == pytest.Config.ArgsSource.ARGS
        self._asked: bool = worker.get(
            "automcm_asked", not arguments or bool(config.getoption("automcm_adapter"))
        )
        """The cases are wanted, whatever paths stand on the command line."""
        self._made: Report | str | None = None
        """The report, or why there is none."""
        self._untold = False
        """That there is none was found here, and no test has failed for it yet."""

    # -- which tests there are

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self, session: pytest.Session) -> None:
        """Take the ids of cases out of the arguments: pytest would look for files."""
        prefix, arguments = f"{NAME}::", session.config.args
        ids = [text[len(prefix) :] for text in arguments if text.startswith(prefix)]
        arguments[:] = [text for text in arguments if not text.startswith(prefix)]
        try:
            if ids:
                self._chosen = purposes.select(self._chosen, filter(None, ids))
            elif not self._asked:
                self._chosen = []
        except ValueError as error:
            raise pytest.UsageError(f"automcm: {error}") from None

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(
        self, session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        """Add the cases, before anybody deselects."""
        suite = Suite.from_parent(session, name=NAME, nodeid=NAME, cases=self)
        collected = config.hook.pytest_make_collect_report(collector=suite)
        config.hook.pytest_collectreport(report=collected)
        items.extend(collected.result)

    def tests(self, suite: Suite) -> Iterator[Case]:
        """The cases that were chosen, as tests."""
        for purpose in self._chosen:
            case = Case.from_parent(suite, name=purpose.id, cases=self)
            for name in (*purpose.rules, purpose.level):
                case.add_marker(name)
            if suite.config.pluginmanager.hasplugin("xdist"):
                case.add_marker(pytest.mark.xdist_group(NAME))
            case.user_properties += [("rules", ", ".join(purpose.rules)), ("level", purpose.level)]
            yield case

    # -- the run

    def verdict(self, test: Case) -> CaseResult:
        """The verdict on a case.

        Without a report the first test fails, and the others are skipped.
        """
        if self._made is None:
            names = {item.name for item in test.session.items if isinstance(item, Case)}
            with self._alone():
                self._made = self._stored()
                if self._made is None:
                    self._made = self._run(names)
                    self._untold = isinstance(self._made, str)
                    self._store(self._made)
        if isinstance(self._made, Report):
            return next(case for case in self._made.cases if case.id == test.name)
        if self._untold:
            self._untold = False
            pytest.fail(self._made, pytrace=False)
        pytest.skip("there is no run: see the case of automcm that failed")

    def _run(self, names: set[str]) -> Report | str:
        """Run the suite with these cases and write the report; if there is none, why."""
        chosen = [purpose for purpose in self._chosen if purpose.id in names]
        partly = len(chosen) < self._all
        started, clock = datetime.now(UTC), time.monotonic()
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            made = suite_run.conform(
                self._command,
                chosen,
                self._folder,
                limit_s=self._limit_s,
                seed=self._seed,
                say=lambda text: None,
                selectors=[purpose.id for purpose in chosen] if partly else [],
                expected=self._expected,
            )
            made.started = started.isoformat(timespec="seconds")
            made.seconds = round(time.monotonic() - clock, 1)
            report.write(made, self._folder)
        except (AdapterError, ProtocolError, OracleError, OSError) as error:
            return "\n  ".join([f"no run: {error}", *map(repr, getattr(error, "stderr", ()))])
        if "interrupted" in made.problems:
            raise KeyboardInterrupt
        return made

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """No other worker is in here; one that dies in here is out."""
        if not self._shared:
            yield
            return
        with open(Path(self._shared, "lock"), "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _stored(self) -> Report | str | None:
        """What a worker has stored, if one has."""
        if not self._shared:
            return None
        good, bad = Path(self._shared, "report.json"), Path(self._shared, "why")
        return report.load(good) if good.exists() else bad.read_text() if bad.exists() else None

    def _store(self, made: Report | str) -> None:
        if isinstance(made, Report) and self._shared:
            files.write(Path(self._shared, "report.json"), json.dumps(made.as_dict()))
        elif isinstance(made, str) and self._shared:
            files.write(Path(self._shared, "why"), made)

    # -- pytest-xdist, and the end

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """A worker is about to start."""
        self._shared = self._shared or str(self._scratch.enter_context(scratch.folder("pytest")))
        node.workerinput["automcm_shared"] = self._shared
        node.workerinput["automcm_folder"] = str(self._folder)
        node.workerinput["automcm_asked"] = self._asked

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """The verdict, and where the report is."""
        made = self._made or self._stored()
        if isinstance(made, Report):
            terminalreporter.section("AutoMCM conformance")
            terminalreporter.line(report.conformance(made)[1])
            for problem in made.problems:
                terminalreporter.line(f"Problem: {report.visible(problem)}")
            terminalreporter.line(f"Report: {self._folder / 'report.html'}")

    def pytest_unconfigure(self, config: pytest.Config) -> None:
        """The folder that the workers shared goes."""
        self._scratch.close()


class Suite(pytest.Collector):
    """Holds the cases."""

    def __init__(self, *, cases: Cases, **rest: Any) -> None:
        super().__init__(**rest)
        self._cases = cases

    def collect(self) -> Iterator[Case]:
        """The cases."""
        return self._cases.tests(self)


class Case(pytest.Item):
    """One case."""

    def __init__(self, *, cases: Cases, **rest: Any) -> None:
        super().__init__(**rest)
        self._cases = cases

    def runtest(self) -> None:
        """The verdict, in pytest's words: what is expected and not PASS is an xfail."""
        case = self._cases.verdict(self)
        why = report.why(case)
        if not case.expected:
            pytest.fail(f"{why}\n{report.as_text(case)}", pytrace=False)
        if case.verdict == "SKIP":
            pytest.skip(why)
        if case.verdict != "PASS":
            pytest.xfail(why)

    def reportinfo(self) -> tuple[Path, None, str]:
        """The case stands in no file."""
        return self.config.rootpath / NAME, None, self.name
