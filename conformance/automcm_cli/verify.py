"""``automcm verify``: model-check, generate, compare.  One report, whatever happens."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from automcm_cli import generated, model_pages, spec
from automcm_conformance import compare
from automcm_conformance.replay import replay
from automcm_spec import agreement, children, compiler, forms, generate, models, oracle, simulate
from automcm_spec.rules import RULES
from automcm_spec.tlc import TlcError
from automcm_spec.toolchain import ToolError

BEHAVIOURS = ((30, 40, False), (70, 40, True))
"""How many random behaviours of the closed models are replayed, how long, and which kind."""
SEED = 7


class NotLoaded(Exception):
    """The reference cannot be imported; the text says why."""


@dataclass
class Report:
    """What ``automcm verify`` found.  ``errors`` are tools and inputs that did not work."""

    profile: str
    models_too: bool = True
    """Models are checked, not the reference compared alone."""
    rule: str | None = None
    """The short loop: only the small graph, and only this rule taken away."""
    verdicts: list[models.Verdict] = field(default_factory=list)
    oracle: dict[str, Any] = field(default_factory=dict)
    compared: dict[str, compare.Comparison] = field(default_factory=dict)
    compiled: dict[str, agreement.Agreement] = field(default_factory=dict)
    """The compiled station against TLC's graphs; not with ``rule``."""
    coverage: compare.Coverage | None = None
    """None too if the reference differs: then a difference shows whatever is taken away."""
    behaviours: int = 0
    behaviour_differences: list[str] = field(default_factory=list)
    drift: list[str] = field(default_factory=list)
    pages: list[str] = field(default_factory=list)
    """Counterexamples that should not be, each as a page (docs/trace-format.md)."""
    unnoticed: bool = False
    """The specification's graph is not the committed one, and no model noticed."""
    errors: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def transitions_only(self) -> set[str]:
        """Graphs of which only the transitions are compared."""
        return {generate.TWO_PEERS.name} if self.profile == "quick" else set()

    @property
    def divergences(self) -> list[dict[str, Any]]:
        """Of all comparisons, as in ``--json``; those of the rule asked for first."""
        found = [d for c in self.compared.values() for d in c.divergences]
        found.sort(key=lambda d: d.rule != self.rule)
        return [d.as_dict() for d in found] + [
            {"behaviour": text} for text in self.behaviour_differences
        ]

    @property
    def all_errors(self) -> list[str]:
        """Each error once, those of single models too."""
        return list(dict.fromkeys([str(v.error) for v in self.verdicts if v.error] + self.errors))

    @property
    def pairs(self) -> int:
        """How many pairs of state and input the rule asked for decides."""
        return sum(c.decided[self.rule or ""] for c in self.compared.values())

    @property
    def undecided(self) -> bool:
        """The rule asked for decides nothing in the small graph, and is not missed there."""
        covered = self.coverage.covered if self.coverage else {}
        told = bool(self.pairs or self.divergences or self.rule in covered)
        return self.rule is not None and bool(self.compared) and not told

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
            and (bool(self.compiled) or self.rule is not None)
            and not any(a.differences for a in self.compiled.values())
            and self.coverage is not None
            and not self.coverage.uncovered
            and not self.undecided
        )

    @property
    def exit_code(self) -> int:
        """0 as expected, 1 a verdict against, 3 something did not run, 4 the rule asked for
        decides nothing."""
        if self.errors:
            return 3
        if self.undecided:
            return 4
        return spec.exit_code(self.verdicts) or int(not self.ok)

    def as_dict(self) -> dict[str, Any]:
        """The JSON of ``--json``."""
        rules = self.coverage or compare.Coverage(by_test={})
        return {
            "ok": self.ok,
            "profile": self.profile,
            "models_too": self.models_too,
            "rule": self.rule,
            "unnoticed": self.unnoticed,
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


def _without(constants: dict[str, Any], rule: str) -> compare.Adapter:
    from automcm.adapter import Reference, without

    return Reference(constants, without(rule))


def _walk(data: bytes, transitions_only: bool) -> compare.Comparison:
    graph = oracle.parse(data, "oracle")
    return compare.walk(graph, reference(graph.constants), transitions_only=transitions_only)


def _agree(data: bytes, transitions_only: bool) -> agreement.Agreement:
    graph = oracle.parse(data, "oracle")
    station = forms.open_station(graph.constants)
    return agreement.compare(graph, station, transitions_only=transitions_only)


def _cover(data: bytes, wanted: Collection[str]) -> compare.Coverage:
    graph = oracle.parse(data, "oracle")
    return compare.covered(graph, lambda rule: _without(graph.constants, rule), wanted=wanted)


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
    rule: str | None = None,
) -> Report:
    """Model-check, write the oracle out, compare, look for drift.  With ``rule``, only
    compare, in the small graph.

    Never raises for what it examines: a spec that does not parse, a reference that cannot be
    imported, a missing Java or a full disk ends up in the report's errors.  Raises ValueError for
    an unknown profile.
    """
    if profile not in models.PROFILES:
        raise ValueError(spec.unknown(profile, models.PROFILES, "profile"))
    report = Report(profile, models_too, rule)
    try:
        if rule is not None:
            _compare_rule(report, rule, say)
            return report
        if models_too:
            _models(report, say)
        data = _oracle(report, generate.ONE_PEER, say)
        _compare(report, data, say)
        _drift(report, data, say)
    except (
        TlcError,
        ToolError,
        models.ModelError,
        oracle.OracleError,
        OSError,
        NotLoaded,
    ) as error:
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
    report.pages = [str(path) for path in model_pages.failed(report.verdicts)]


def _oracle(report: Report, graph: generate.Graph, say: Callable[[str], None]) -> bytes:
    with _timed(report, "oracle"):
        say(f"oracle: {graph.name}")
        data, _ = generate.build(graph, short=graph is generate.SMALL)
        fresh = oracle.dump(data)
        written = oracle.parse(fresh, "oracle")
        report.oracle = {
            "states": len(written.states),
            "transitions": written.transitions,
            "refusals": written.refusals,
            "spec_hash": written.spec_hash,
        }
    return fresh


def _compare_rule(report: Report, rule: str, say: Callable[[str], None]) -> None:
    """The short loop: every input in every state of the small graph, and the rule taken away."""
    _load_reference()
    data = _oracle(report, generate.SMALL, say)
    with _timed(report, "comparison"):
        say("comparison: every state, every input")
        report.compared = {generate.SMALL.name: _walk(data, False)}
        if not report.divergences:
            report.coverage = _cover(data, [rule])


def _load_reference() -> None:
    """Raises NotLoaded: what it is changed into need not even be importable."""
    try:
        importlib.import_module("automcm.adapter")
    except Exception as error:
        text = f"the reference cannot be imported: {type(error).__name__}: {error}"
        raise NotLoaded(text) from error


def _drift(report: Report, one_peer: bytes, say: Callable[[str], None]) -> None:
    with _timed(report, "generated files"):
        say("generated files")
        report.drift += generated.drift(report.profile, one_peer, say, report.verdicts)
        report.unnoticed = (
            bool(report.verdicts)
            and all(verdict.ok for verdict in report.verdicts)
            and generated.graph_changed(one_peer)
        )


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(2, initializer=children.end_with_parent)


def _compare(report: Report, one_peer: bytes, say: Callable[[str], None]) -> None:
    _load_reference()
    with _timed(report, "comparison"), _pool() as pool:
        say("comparison: every state, every input")
        data = {generate.ONE_PEER.name: one_peer}
        for graph in (generate.TIGHT, generate.TWO_PEERS):
            try:
                found = oracle.content(graph.path)
                oracle.parse(found, graph.path, generate.spec_hash())
            except oracle.OracleError as error:
                report.drift.append(generated.said(error))
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
            for name in (ordered if compiler.is_fresh() else ())  # else it is drift
        }
        covered = pool.submit(_cover, one_peer, RULES)
        behaved = pool.submit(_behave)
        report.compared = {name: begun[name].result() for name in data}
        report.compiled = {name: agreed[name].result() for name in agreed}
        say("comparison: every rule taken away")
        differs = report.compared[generate.ONE_PEER.name].differences
        report.coverage = None if differs else covered.result()
        report.behaviours, report.behaviour_differences = behaved.result()
