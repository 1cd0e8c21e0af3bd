"""``automcm verify``: model checking, generation and comparison, with a report in every case."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

from automcm_cli.spec import model_output
from automcm_maintenance.code_mutation import certificate_page
from automcm_maintenance.compilation import compiler
from automcm_maintenance.documents import counterexample_pages, generated_files
from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.induction import recorded_proof
from automcm_maintenance.induction.prove_commands import FAULTS
from automcm_maintenance.spec_mutation import mutant_results
from automcm_maintenance.verify import graph_comparison, kept_stages
from automcm_maintenance.verify.behaviour_replay import replay
from automcm_spec.graph import oracle, oracle_agreement, oracle_generation
from automcm_spec.model_checking import kept_results, models, tlc, tlc_simulation
from automcm_spec.model_checking.toolchain import ToolError
from automcm_spec.support import children
from automcm_spec.vocabulary import json_forms
from automcm_spec.vocabulary.rules import NO_GRAPH, RULES

if TYPE_CHECKING:
    from automcm_maintenance.verify.spec_mapping import Reference

BEHAVIOURS = ((30, 40, False), (70, 40, True))
"""The number, length and kind of random behaviours of the closed models that are replayed."""
SEED = 7
KEPT, CODE = generated_files.KEPT, generated_files.OF_GRAPH
COMPARED = (
    *CODE,
    "spec/simulation",
    "reference/automcm",
    "traces/automcm_traces",
    "traces/tools",
    "conformance",
)
"""What the comparisons depend on."""
WHOLE = ("docs", "spec", "reference", "traces", "conformance", "README.md", *CODE)
"""What the generated files depend on."""
T = TypeVar("T")


class NotLoaded(Exception):
    """The reference cannot be imported; the text gives the reason."""


@dataclass(kw_only=True)
class Comparisons:
    """The results of the comparisons."""

    compared: dict[str, graph_comparison.WalkResult] = field(default_factory=dict)
    compiled: dict[str, oracle_agreement.Agreement] = field(default_factory=dict)
    """The comparison of the compiled station with TLC's graphs; not with ``rule``."""
    coverage: graph_comparison.Coverage | None = None
    """Also None if the reference differs, because then every disabled rule shows a difference."""
    behaviours: int = 0
    behaviour_differences: list[str] = field(default_factory=list)
    drift: list[str] = field(default_factory=list)

    @property
    def clean(self) -> bool:
        """Whether everything is as expected."""
        differ = any(c.divergences for c in self.compared.values())
        differ = differ or any(a.differences for a in self.compiled.values())
        rules = self.coverage is not None and not self.coverage.uncovered
        return rules and not (differ or self.behaviour_differences or self.drift)


@dataclass(kw_only=True)
class VerifyReport(Comparisons):
    """The results of ``automcm verify``.  ``errors`` are failures of tools and inputs."""

    profile: str
    models_too: bool = True
    """Whether the models are checked; otherwise only the reference is compared."""
    rule: str | None = None
    """The rule of the short loop, which uses the small graph and disables only this rule."""
    verdicts: list[models.ModelVerdict] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    """The models that the quick profile leaves to *full*."""
    proof: recorded_proof.Proof | None = None
    oracle: dict[str, Any] = field(default_factory=dict)
    pages: list[str] = field(default_factory=list)
    """Unexpected counterexamples, each as a page (docs/trace-format.md)."""
    unnoticed: bool = False
    """Whether the specification's graph differs from the committed one, but no model does."""
    mutants: str = ""
    """That the results of spec mutate are stale, if they are; no error."""
    errors: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    """The duration of each stage; the models are checked beside the other stages."""
    elapsed: float = 0.0
    kept_stages: list[str] = field(default_factory=list)
    """The stages with a kept result."""
    fresh: bool = False

    @property
    def remakes(self) -> bool:
        """Whether stages that are no models run although nothing has changed."""
        return self.fresh or self.profile != "quick"

    @property
    def kept(self) -> int:
        """The number of models with a kept result, because none of its inputs has changed."""
        return sum(verdict.kept for verdict in self.verdicts)

    @property
    def graphs(self) -> tuple[oracle_generation.Graph, ...]:
        """The graphs that are compared, beside the one of the present specification."""
        larger = () if self.profile == "quick" else (oracle_generation.TWO_PEERS,)
        return (oracle_generation.TIGHT, *larger)

    @property
    def found(self) -> list[graph_comparison.Divergence]:
        """The divergences of all comparisons, those of the requested rule first."""
        found = [d for c in self.compared.values() for d in c.divergences]
        return sorted(found, key=lambda d: d.rule != self.rule)

    @property
    def divergences(self) -> list[dict[str, Any]]:
        """All differences for ``--json``."""
        behaviours = [{"behaviour": text} for text in self.behaviour_differences]
        return [d.as_dict() for d in self.found] + behaviours

    @property
    def all_errors(self) -> list[str]:
        """Each error once, including those of single models."""
        return list(dict.fromkeys([str(v.error) for v in self.verdicts if v.error] + self.errors))

    @property
    def pairs(self) -> int:
        """The number of pairs of state and input that the requested rule decides."""
        return sum(c.decided[self.rule or ""] for c in self.compared.values())

    @property
    def undecided(self) -> bool:
        """Whether the requested rule decides nothing in the small graph and has no effect there."""
        covered = self.coverage.covered if self.coverage else {}
        decided = bool(self.pairs or self.divergences or self.rule in covered)
        return self.rule is not None and bool(self.compared) and not decided

    @property
    def ok(self) -> bool:
        """Whether all results are as expected."""
        return (
            self.clean
            and not self.errors
            and (bool(self.verdicts) or not self.models_too)
            and all(verdict.ok for verdict in self.verdicts)
            and not (self.proof and self.proof.open)
            and bool(self.compared)
            and (bool(self.compiled) or self.rule is not None)
            and not self.undecided
        )

    @property
    def exit_code(self) -> int:
        """0 success, 1 a check failed, 3 a tool could not be run, 4 the requested rule decides
        nothing."""
        if self.errors:
            return 3
        if self.undecided:
            return 4
        return model_output.exit_code(self.verdicts) or int(not self.ok)

    def as_dict(self) -> dict[str, Any]:
        """The report for ``--json``."""
        rules = self.coverage or graph_comparison.Coverage()
        return {
            "ok": self.ok,
            "profile": self.profile,
            "models_too": self.models_too,
            "rule": self.rule,
            "unnoticed": self.unnoticed,
            "left_to_full": self.left,
            "kept_stages": self.kept_stages,
            "models": [model_output.as_dict(v) | {"kept": v.kept} for v in self.verdicts],
            "kept": self.kept,
            "proof": asdict(self.proof) if self.proof else None,
            "oracle": self.oracle,
            "reference": {
                "states_compared": sum(c.states for c in self.compared.values()),
                "inputs_compared": sum(c.inputs for c in self.compared.values()),
                "divergences": self.divergences,
                "rules_covered": sorted(rules.covered),
                "rules_uncovered": rules.uncovered,
                "rules_by_test": NO_GRAPH if self.coverage else {},
                "behaviours_replayed": self.behaviours,
            },
            "compiled": {
                "states_compared": sum(a.states for a in self.compiled.values()),
                "inputs_compared": sum(a.inputs for a in self.compiled.values()),
                "differences": [str(d) for a in self.compiled.values() for d in a.found],
            },
            "drift": self.drift,
            "pages": self.pages,
            "mutants": self.mutants,
            "errors": self.all_errors,
            "seconds": {name: round(value, 1) for name, value in self.seconds.items()},
        }


def _reference(constants: dict[str, Any], without: str = "") -> Reference:
    from automcm_maintenance.verify import spec_mapping

    return spec_mapping.Reference(constants, spec_mapping.without(without))


def _walk(data: bytes) -> graph_comparison.WalkResult:
    graph = oracle.parse(data, "oracle")
    return graph_comparison.walk(graph, _reference(graph.constants))


def _agree(data: bytes) -> oracle_agreement.Agreement:
    graph = oracle.parse(data, "oracle")
    return oracle_agreement.compare(graph, json_forms.open_station(graph.constants))


def _cover(data: bytes, wanted: Collection[str]) -> graph_comparison.Coverage:
    graph = oracle.parse(data, "oracle")
    return graph_comparison.covered(
        graph, lambda rule: _reference(graph.constants, rule), wanted=wanted
    )


def _behave() -> tuple[int, list[str]]:
    found = [
        behaviour
        for number, depth, lively in BEHAVIOURS
        for behaviour in tlc_simulation.behaviours(number, depth, SEED, lively=lively)
    ]
    answers = (
        replay(behaviour, lambda: _reference(tlc_simulation.CONSTANTS)) for behaviour in found
    )
    return len(found), [answer for answer in answers if answer]


def run(
    profile: str = "quick",
    notify: Callable[[str], None] = lambda text: None,
    *,
    models_too: bool = True,
    rule: str | None = None,
    fresh: bool = False,
) -> VerifyReport:
    """Check the models, write the oracle, compare, and find stale files.

    With ``rule``, only compare, in the small graph.  ``fresh``: ignore kept results, and make the
    graph anew even if the committed one is of this specification.  The larger profiles keep only
    results of models.

    Problems of the examined files become errors of the report: a specification that does not parse,
    a reference that cannot be imported, a missing Java, a full disk.
    """
    report = VerifyReport(profile=profile, models_too=models_too, rule=rule, fresh=fresh)
    started = time.monotonic()
    if rule is not None:
        with _errors(report):
            _compare_rule(report, rule, notify)
    else:
        _stages(report, notify)
    report.elapsed = time.monotonic() - started
    return report


def _stages(report: VerifyReport, notify: Callable[[str], None]) -> None:
    """Check the models and the proof beside the other stages, which use one core or two each."""
    stop = tlc.TlcStop()
    with ThreadPoolExecutor(2) as beside:
        checking = beside.submit(_models, report, notify, stop) if report.models_too else None
        proving = beside.submit(_proof, report) if report.models_too else None
        data = None
        try:
            with _errors(report):
                data = _oracle(report, oracle_generation.ONE_PEER, notify)
                _compare(report, data, notify)
                _drift(report, data, notify)
            for each in (checking, proving):
                with _errors(report):
                    if each is not None:
                        each.result()
        except BaseException:
            stop.now()
            raise
    with _errors(report):
        _of_models(report, data)
        report.mutants = _stale_results()


def _stale_results() -> str:
    """Which committed results of mutants are stale, and why."""
    found = []
    if mutant_results.load().stale:
        found.append((mutant_results.RESULTS, mutant_results.STALE))
    if certificate_page.stale(certificate_page.load()):
        found.append((certificate_page.RESULTS, certificate_page.STALE))
    return "; ".join(f"{path.relative_to(ROOT)} is stale: {why}" for path, why in found)


def _of_models(report: VerifyReport, one_peer: bytes | None) -> None:
    """What is said of the verdicts beside the verdicts."""
    report.pages = [str(path) for path in counterexample_pages.failed(report.verdicts)]
    report.drift += generated_files.counterexamples(report.verdicts).drift()
    report.unnoticed = (
        one_peer is not None
        and bool(report.verdicts)
        and all(verdict.ok for verdict in report.verdicts)
        and generated_files.graph_changed(one_peer)
    )


@contextmanager
def _errors(report: VerifyReport) -> Iterator[None]:
    """Failures of tools and inputs become errors of the report."""
    try:
        yield
    except (ToolError, models.ModelError, oracle.OracleError, NotLoaded, *FAULTS) as error:
        report.errors.append(str(error))
    except ValueError as error:
        report.errors.append(f"oracle: {error}")


def _kept(
    report: VerifyReport,
    name: str,
    parts: Sequence[str],
    make: Callable[[], T],
    clean: Callable[[T], bool],
) -> T:
    """The result of a stage, kept if the files that it depends on have not changed."""
    if report.remakes:
        return make()
    key = kept_stages.key(ROOT, *parts)
    found, earlier = kept_stages.kept(KEPT / f"{name}.stage", key, make, clean)
    if earlier:
        report.kept_stages.append(name)
    return found


@contextmanager
def _timed(report: VerifyReport, name: str) -> Iterator[None]:
    """A stage."""
    started = time.monotonic()
    try:
        yield
    finally:
        report.seconds[name] = time.monotonic() - started


def _models(report: VerifyReport, notify: Callable[[str], None], stop: tlc.TlcStop) -> None:
    loaded = models.load()
    chosen = models.of_profile(loaded, report.profile)
    if report.profile == "quick":
        report.left = [model.cfg for model in loaded if model.profile == "full"]
    with _timed(report, "models"):
        notify(f"models 0/{len(chosen)}")

        def done(verdict: models.ModelVerdict) -> None:
            report.verdicts.append(verdict)
            n = f"{len(report.verdicts)}/{len(chosen)}"
            how = " (kept)" if verdict.kept else ""
            notify(f"models {n}: {verdict.model.cfg} {verdict.outcome}{how}")

        kept_results.check_all(chosen, KEPT, fresh=report.fresh, on_done=done, stop=stop)
    report.verdicts.sort(key=lambda verdict: chosen.index(verdict.model))


def _proof(report: VerifyReport) -> None:
    """Prove I-1; in the quick profile only if the committed result is of other files."""
    committed = recorded_proof.committed()
    if report.profile == "quick" and committed:
        report.proof = committed
        return
    with _timed(report, "proof"):
        parts = recorded_proof.files()
        found = _kept(report, "proof", parts, _proved, lambda proof: not proof.open)
    report.proof = found
    if not found.open:
        report.drift += generated_files.proof(found).drift()


def _proved() -> recorded_proof.Proof:
    """In a process of its own, which shares no interpreter with the other stages."""
    with children.pool(1) as pool:
        return pool.submit(recorded_proof.prove).result()


def _oracle(
    report: VerifyReport, graph: oracle_generation.Graph, notify: Callable[[str], None]
) -> bytes:
    with _timed(report, "oracle"):
        notify(f"oracle: {graph.name}")

        def make() -> bytes:
            data, _ = oracle_generation.build(graph, short=graph is oracle_generation.SMALL)
            return oracle.dump(data)

        name = f"oracle {graph.name}"
        data = None
        if not report.remakes:
            with suppress(oracle.OracleError):  # it is made now
                data = _committed(graph)
                report.kept_stages.append(name)
        data = data or _kept(report, name, CODE, make, lambda data: True)
        written = oracle.parse(data, "oracle")
        report.oracle = {
            "states": len(written.states),
            "transitions": written.transitions,
            "refusals": written.refusals,
            "spec_hash": written.spec_hash,
        }
    return data


def _committed(graph: oracle_generation.Graph) -> bytes:
    """The graph in the repository.  Raises OracleError if it is not of this specification."""
    data = oracle.content(graph.path)
    oracle.parse(data, graph.path, oracle_generation.spec_hash())
    return data


def _compare_rule(report: VerifyReport, rule: str, notify: Callable[[str], None]) -> None:
    """The short loop: all inputs in all states of the small graph, also with the rule disabled."""
    _load_reference()
    data = _oracle(report, oracle_generation.SMALL, notify)
    with _timed(report, "comparison"):
        notify("comparison: every state, every input")
        report.compared = {oracle_generation.SMALL.name: _walk(data)}
        if not report.divergences:
            report.coverage = _cover(data, [rule])


def _load_reference() -> None:
    """The reference.  Raises NotLoaded, because code under change may not be importable."""
    try:
        importlib.import_module("automcm_maintenance.verify.spec_mapping")
    except Exception as error:
        text = f"the reference cannot be imported: {type(error).__name__}: {error}"
        raise NotLoaded(text) from error


def _drift(report: VerifyReport, one_peer: bytes, notify: Callable[[str], None]) -> None:
    with _timed(report, "generated files"):
        notify("generated files")
        report.drift += _kept(
            report,
            "generated files",
            WHOLE,
            lambda: generated_files.drift(report.profile, one_peer, notify),
            lambda drift: not drift,
        )


def _compare(report: VerifyReport, one_peer: bytes, notify: Callable[[str], None]) -> None:
    with _timed(report, "comparison"):
        found = _kept(
            report,
            "comparison",
            COMPARED,
            lambda: _comparisons(report, one_peer, notify),
            lambda found: found.clean,
        )
    vars(report).update(vars(found) | {"drift": report.drift + found.drift})


def _comparisons(
    report: VerifyReport, one_peer: bytes, notify: Callable[[str], None]
) -> Comparisons:
    _load_reference()
    found = Comparisons()
    with children.pool(2) as pool:
        notify("comparison: every state, every input")
        data = {oracle_generation.ONE_PEER.name: one_peer}
        for graph in report.graphs:
            try:
                data[graph.name] = _committed(graph)
            except oracle.OracleError as error:
                found.drift.append(generated_files.error_text(error))
        # The largest first, because it takes half of the time.
        ordered = sorted(data, key=lambda name: -len(data[name]))
        begun = {name: pool.submit(_walk, data[name]) for name in ordered}
        agreed = {
            name: pool.submit(_agree, data[name])
            for name in (ordered if compiler.is_fresh() else ())  # else it is drift
        }
        covered = pool.submit(_cover, one_peer, RULES)
        behaved = pool.submit(_behave)
        found.compared = {name: begun[name].result() for name in data}
        found.compiled = {name: agreed[name].result() for name in agreed}
        notify("comparison: every rule taken away")
        if not found.compared[oracle_generation.ONE_PEER.name].differences:
            found.coverage = covered.result()
        found.behaviours, found.behaviour_differences = behaved.result()
    return found
