"""``automcm verify``: model-check, generate, compare.  One report, whatever happens."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from automcm_cli import generated, spec, verify_pages
from automcm_conformance import compare, coverage
from automcm_conformance.replay import replay
from automcm_spec import agreement, forms, generate, models, oracle, sany, simulate
from automcm_spec.tlc import TlcError
from automcm_spec.toolchain import ToolError

BEHAVIOURS = ((30, 40, False), (70, 40, True))
"""How many random behaviours of the closed models are replayed, how long, and which kind."""
SEED = 7


@dataclass
class Report:
    """What ``automcm verify`` found.  ``errors`` are tools and inputs that did not work."""

    profile: str
    models_too: bool = True
    """Models are checked, not the reference compared alone."""
    verdicts: list[models.Verdict] = field(default_factory=list)
    oracle: dict[str, Any] = field(default_factory=dict)
    compared: dict[str, compare.Comparison] = field(default_factory=dict)
    compiled: dict[str, agreement.Agreement] = field(default_factory=dict)
    """The compiled station against TLC's graphs."""
    coverage: coverage.Coverage | None = None
    behaviours: int = 0
    behaviour_differences: list[str] = field(default_factory=list)
    drift: list[str] = field(default_factory=list)
    pages: list[str] = field(default_factory=list)
    """Counterexamples that should not be, each as a page (docs/trace-format.md)."""
    errors: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def transitions_only(self) -> set[str]:
        """Graphs of which only the transitions are compared."""
        return {generate.TWO_PEERS.name} if self.profile == "quick" else set()

    @property
    def divergences(self) -> list[dict[str, Any]]:
        """Of all comparisons, as in ``--json``."""
        found = [d.as_dict() for c in self.compared.values() for d in c.divergences]
        return found + [{"behaviour": text} for text in self.behaviour_differences]

    @property
    def all_errors(self) -> list[str]:
        """Each error once, those of single models too."""
        return list(dict.fromkeys([str(v.error) for v in self.verdicts if v.error] + self.errors))

    @property
    def ok(self) -> bool:
        """Whether everything is as it must be."""
        return (
            not self.errors
            and not self.drift
            and (bool(self.verdicts) or not self.models_too)
            and all(verdict.ok for verdict in self.verdicts)
            and bool(self.compared)
            and not self.divergences
            and bool(self.compiled)
            and not any(a.differences for a in self.compiled.values())
            and self.coverage is not None
            and not self.coverage.uncovered
        )

    @property
    def exit_code(self) -> int:
        """0 as expected, 1 a verdict against, 3 something did not run."""
        return 3 if self.errors else spec.exit_code(self.verdicts) or int(not self.ok)

    def as_dict(self) -> dict[str, Any]:
        """The JSON of ``--json``."""
        rules = self.coverage or coverage.Coverage(by_test={})
        return {
            "ok": self.ok,
            "profile": self.profile,
            "models_too": self.models_too,
            "models": [spec.as_dict(verdict) for verdict in self.verdicts],
            "oracle": self.oracle,
            "reference": {
                "states_compared": sum(c.states for c in self.compared.values()),
                "inputs_compared": sum(c.inputs for c in self.compared.values()),
                "divergences": self.divergences,
                "rules_covered": sorted(rules.covered),
                "rules_uncovered": rules.uncovered,
                "rules_by_test": rules.by_test,
                "behaviours_replayed": self.behaviours,
            },
            "compiled": {
                "states_compared": sum(a.states for a in self.compiled.values()),
                "inputs_compared": sum(a.inputs for a in self.compiled.values()),
                "differences": [str(d) for a in self.compiled.values() for d in a.found],
            },
            "drift": self.drift,
            "pages": self.pages,
            "errors": self.all_errors,
            "seconds": {name: round(value, 1) for name, value in self.seconds.items()},
        }


def reference(constants: dict[str, Any]) -> compare.Adapter:
    """The reference behind its in-process adapter."""
    from automcm.adapter import Reference

    return Reference(constants)


@contextmanager
def _without(constants: dict[str, Any], rule: str) -> Iterator[compare.Adapter]:
    from automcm.adapter import Reference, without

    with without(rule) as rules:
        yield Reference(constants, rules)


def _walk(data: bytes, transitions_only: bool) -> compare.Comparison:
    graph = oracle.parse(data, "oracle")
    return compare.walk(graph, reference(graph.constants), transitions_only=transitions_only)


def _agree(data: bytes, transitions_only: bool) -> agreement.Agreement:
    graph = oracle.parse(data, "oracle")
    station = forms.open_station(graph.constants)
    return agreement.compare(graph, station, transitions_only=transitions_only)


def _cover(data: bytes) -> coverage.Coverage:
    graph = oracle.parse(data, "oracle")
    return coverage.rules(graph, lambda rule: _without(graph.constants, rule))


def _behave() -> tuple[int, list[str]]:
    found = [
        behaviour
        for number, depth, lively in BEHAVIOURS
        for behaviour in simulate.behaviours(number, depth, SEED, lively=lively)
    ]
    answers = (replay(behaviour, lambda: reference(simulate.CONSTANTS)) for behaviour in found)
    return len(found), [answer for answer in answers if answer]


def run(
    profile: str = "quick",
    say: Callable[[str], None] = lambda text: None,
    *,
    models_too: bool = True,
) -> Report:
    """Model-check, write the oracle out, compare.  Never raises for what it examines: a spec
    that does not parse, a missing Java or a full disk ends up in the report's errors.  Raises
    ValueError for an unknown profile."""
    if profile not in models.PROFILES:
        raise ValueError(spec.unknown(profile, models.PROFILES, "profile"))
    report = Report(profile, models_too)
    try:
        if models_too:
            _models(report, say)
        data = _oracle(report, say)
        _compare(report, data, say)
    except (TlcError, ToolError, models.ModelError, oracle.OracleError, OSError) as error:
        report.errors.append(str(error))
    except sany.Refused as error:
        report.errors.append(str(error))
    except ValueError as error:
        report.errors.append(f"oracle: {error}")
    return report


@contextmanager
def _timed(report: Report, name: str) -> Iterator[None]:
    started = time.monotonic()
    try:
        yield
    finally:
        report.seconds[name] = time.monotonic() - started


def _models(report: Report, say: Callable[[str], None]) -> None:
    chosen = models.of_profile(models.load(), report.profile)

    def done(verdict: models.Verdict) -> None:
        report.verdicts.append(verdict)
        say(f"models {len(report.verdicts)}/{len(chosen)}: {verdict.model.cfg} {verdict.outcome}")

    with _timed(report, "models"):
        say(f"models 0/{len(chosen)}")
        models.check_all(chosen, jobs=2, on_done=done)
    order = [m.cfg for m in chosen]
    report.verdicts.sort(key=lambda verdict: order.index(verdict.model.cfg))
    report.drift += generated.counterexample_drift(report.verdicts)
    report.pages = [str(path) for path in verify_pages.write(report.verdicts)]


def _oracle(report: Report, say: Callable[[str], None]) -> bytes:
    with _timed(report, "oracle"):
        say("oracle: one station, one peer")
        data, _ = generate.build(generate.ONE_PEER)
        fresh = oracle.dump(data)
        graph = oracle.parse(fresh, "oracle")
        report.oracle = {
            "states": len(graph.states),
            "transitions": graph.transitions,
            "refusals": graph.refusals,
            "spec_hash": graph.spec_hash,
        }
        report.drift += generated.drift(report.profile, fresh, say)
    return fresh


def _compare(report: Report, one_peer: bytes, say: Callable[[str], None]) -> None:
    with _timed(report, "comparison"), ProcessPoolExecutor(2) as pool:
        say("comparison: every state, every input")
        data = {generate.ONE_PEER.name: one_peer}
        for graph in (generate.TIGHT, generate.TWO_PEERS):
            try:
                found = oracle.content(graph.path)
                oracle.parse(found, graph.path, generate.spec_hash())
            except oracle.OracleError as error:
                report.drift.append(str(error))
                continue
            data[graph.name] = found
        # The largest first: it takes half of the time.
        ordered = sorted(data, key=lambda name: -len(data[name]))
        begun = {
            name: pool.submit(_walk, data[name], name in report.transitions_only)
            for name in ordered
        }
        agreed = {
            name: pool.submit(_agree, data[name], name in report.transitions_only)
            for name in ordered
        }
        covered = pool.submit(_cover, one_peer)
        behaved = pool.submit(_behave)
        report.compared = {name: begun[name].result() for name in data}
        report.compiled = {name: agreed[name].result() for name in data}
        say("comparison: every rule taken away")
        report.coverage = covered.result()
        report.behaviours, report.behaviour_differences = behaved.result()
