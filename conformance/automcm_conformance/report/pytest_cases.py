"""The suite's cases as pytest tests.

The first test runs the suite once, with the cases that remain after deselection; then each test
reports the verdict on its case.  Workers of pytest-xdist share one run: the first worker that
needs it runs the suite, the others wait.
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
"""The name of the collector; a node id is ``automcm::AMCM/RCV/NEG/BI-03``."""


class Cases:
    """The pytest hooks of a session with an adapter.

    Raises UsageError for an invalid option.
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
            if not self._command:
                raise ValueError("--automcm-adapter must be a command")
            if not 0.01 <= self._limit_s < math.inf:
                raise ValueError("--automcm-limit must be at least 0.01 seconds")
            if self._seed < 0:
                raise ValueError("--automcm-seed must be at least 0")
            file = option("expect")
            self._expected = verdicts.expectations(Path(file), everything) if file else {}
        except (ValueError, OSError) as error:
            raise pytest.UsageError(f"automcm: {error}") from None
        worker: dict[str, Any] = getattr(config, "workerinput", {})
        self._folder = Path(worker.get("automcm_folder") or option("out") or fresh_folder())
        self._shared: str = worker.get("automcm_shared", "")
        """The folder that the workers of pytest-xdist share; empty without them."""
        self._scratch = ExitStack()
        """Removes that folder, in the process that created it."""
        arguments = config.args_source == pytest.Config.ArgsSource.ARGS
        self._collect_all: bool = worker.get(
            "automcm_asked", not arguments or bool(config.getoption("automcm_adapter"))
        )
        """Whether the cases are collected, whatever paths the command line has."""
        self._result: Report | str | None = None
        """The report, or the error of the run."""
        self._unreported = False
        """The run failed in this process, and no test has failed because of it yet."""

    # -- collection

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self, session: pytest.Session) -> None:
        """Remove the ids of cases from the arguments, because pytest would look for files."""
        prefix, arguments = f"{NAME}::", session.config.args
        ids = [text[len(prefix) :] for text in arguments if text.startswith(prefix)]
        arguments[:] = [text for text in arguments if not text.startswith(prefix)]
        try:
            if ids:
                self._chosen = purposes.select(self._chosen, filter(None, ids))
            elif not self._collect_all:
                self._chosen = []
        except ValueError as error:
            raise pytest.UsageError(f"automcm: {error}") from None

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(
        self, session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        """Add the cases before tests are deselected."""
        suite = Suite.from_parent(session, name=NAME, nodeid=NAME, cases=self)
        collected = config.hook.pytest_make_collect_report(collector=suite)
        config.hook.pytest_collectreport(report=collected)
        items.extend(collected.result)

    def tests(self, suite: Suite) -> Iterator[Case]:
        """The selected cases as tests."""
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

        If the run failed, the first test fails and the others are skipped.
        """
        if self._result is None:
            names = {item.name for item in test.session.items if isinstance(item, Case)}
            with self._exclusive():
                self._result = self._stored()
                if self._result is None:
                    self._result = self._run(names)
                    self._unreported = isinstance(self._result, str)
                    self._store(self._result)
        if isinstance(self._result, Report):
            return next(case for case in self._result.cases if case.id == test.name)
        if self._unreported:
            self._unreported = False
            pytest.fail(self._result, pytrace=False)
        pytest.skip("the suite could not be run; see the automcm case that failed")

    def _run(self, names: set[str]) -> Report | str:
        """Run the suite with these cases and write the report.  Returns it, or the error."""
        chosen = [purpose for purpose in self._chosen if purpose.id in names]
        partly = len(chosen) < self._all
        started, clock = datetime.now(UTC), time.monotonic()
        try:
            files.folder(self._folder, named=True)
            result = suite_run.conform(
                self._command,
                chosen,
                self._folder,
                limit_s=self._limit_s,
                seed=self._seed,
                notify=lambda text: None,
                selectors=[purpose.id for purpose in chosen] if partly else [],
                expected=self._expected,
            )
            result.started = started.isoformat(timespec="seconds")
            result.seconds = round(time.monotonic() - clock, 1)
            report.write(result, self._folder)
        except (AdapterError, ProtocolError, OracleError, OSError) as error:
            lines = [f"the suite could not be run: {error}"]
            return "\n  ".join([*lines, *map(repr, getattr(error, "stderr", ()))])
        if "interrupted" in result.problems:
            raise KeyboardInterrupt
        return result

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        """Lock out other workers.  The system releases the lock if this worker dies."""
        if not self._shared:
            yield
            return
        with open(Path(self._shared, "lock"), "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _stored(self) -> Report | str | None:
        """The result that a worker has stored, or None."""
        if not self._shared:
            return None
        good, bad = Path(self._shared, "report.json"), Path(self._shared, "why")
        return report.load(good) if good.exists() else bad.read_text() if bad.exists() else None

    def _store(self, result: Report | str) -> None:
        if isinstance(result, Report) and self._shared:
            files.write(Path(self._shared, "report.json"), json.dumps(result.as_dict()))
        elif isinstance(result, str) and self._shared:
            files.write(Path(self._shared, "why"), result)

    # -- pytest-xdist, and the end of the session

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Pass the settings to a worker before it starts."""
        self._shared = self._shared or str(self._scratch.enter_context(scratch.folder("pytest")))
        node.workerinput["automcm_shared"] = self._shared
        node.workerinput["automcm_folder"] = str(self._folder)
        node.workerinput["automcm_asked"] = self._collect_all

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the verdict and the path of the report."""
        result = self._result or self._stored()
        if isinstance(result, Report):
            terminalreporter.section("AutoMCM conformance")
            terminalreporter.line(report.conformance(result)[1])
            for problem in result.problems:
                terminalreporter.line(f"Problem: {report.visible(problem)}")
            terminalreporter.line(f"Report: {self._folder / 'report.html'}")

    def pytest_unconfigure(self, config: pytest.Config) -> None:
        """Remove the folder that the workers share."""
        self._scratch.close()


class Suite(pytest.Collector):
    """The collector of the cases."""

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
        """Report the verdict to pytest: an expected verdict other than PASS is an xfail."""
        case = self._cases.verdict(self)
        why = report.why(case)
        if not case.expected:
            pytest.fail(f"{why}\n{report.as_text(case)}", pytrace=False)
        if case.verdict == "SKIP":
            pytest.skip(why)
        if case.verdict != "PASS":
            pytest.xfail(why)

    def reportinfo(self) -> tuple[Path, None, str]:
        """The location of the case, which is in no file."""
        return self.config.rootpath / NAME, None, self.name
