"""The output of ``automcm verify``, on one screen."""

from __future__ import annotations

from itertools import zip_longest

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from automcm_cli.spec.model_output import checks
from automcm_maintenance.induction.recorded_proof import Proof
from automcm_maintenance.verify.graph_comparison import explain
from automcm_maintenance.verify.verify import VerifyReport
from automcm_spec.model_checking import models
from automcm_spec.vocabulary.rules import NO_GRAPH, RULES


def show(report: VerifyReport, console: Console) -> None:
    """Print the report: models, must-fail models, oracle, comparison, the verdict."""
    holds = [v for v in report.verdicts if v.model.expect == "holds"]
    fails = [v for v in report.verdicts if v.model.expect == "violates"]
    if not report.models_too:
        console.print("Models      not checked")
    if report.rule:
        console.print(f"Rule        {report.rule}: {RULES[report.rule]}")
    if holds:
        console.print(_holds(holds))
    if fails:
        console.print(_fails(fails))
        for v in fails:
            if v.problem:
                console.print(f"[red]{v.model.cfg}[/]  {_problem(v)[0]}")
    if report.proof:
        console.print(_proof(report.proof))
        for text in report.proof.open:
            console.print(f"[red]Not proved[/]  {escape(text)}")
    if report.oracle:
        o = report.oracle
        name = "Small graph" if report.rule else "Oracle"
        console.print(
            f"{name:11} {o['states']:,} states, {o['transitions']:,} transitions, "
            f"{o['refusals']:,} refusals, spec {o['spec_hash'][:12]}"
        )
    _comparison(report, console)
    if report.rule:
        for text in _short_loop(report):
            console.print(text)
    if report.unnoticed:
        console.print(
            "[red]Not covered[/] The specification's graph is not the one in spec/oracle, and "
            "every model comes out as recorded: no property covers what changed."
        )
    for text in report.drift:
        console.print(f"[red]Drift[/]       {escape(text)}")
    if report.mutants:
        console.print(f"Mutants     {report.mutants}")
    for text in report.pages:
        console.print(f"[red]See[/]         {escape(text)}", soft_wrap=True)
    for text in report.all_errors:
        console.print(f"[red]Error[/]       {escape(text)}")
    models_kept = [f"{report.kept} of {len(report.verdicts)} models"] if report.kept else []
    stages_kept = [", ".join(report.kept_stages)] if report.kept_stages else []
    for what in models_kept + stages_kept:
        console.print(f"Kept        {what}: nothing they depend on has changed (--fresh runs all)")
    if report.left:
        console.print(f"Left to full  {', '.join(report.left)}: make verify ARGS='--profile full'")
    parts = "; ".join(f"{name} {seconds:.0f} s" for name, seconds in report.seconds.items())
    word = "[green]As expected[/]" if report.ok else "[red]NOT as expected[/]"
    console.print(f"{word} after {report.elapsed:.0f} s: {parts}.")


def _proof(proof: Proof) -> str:
    if proof.seconds is None:
        how = "obligations proved earlier from the same files (spec/proof.json)"
        return f"Proof       {proof.obligations} {how}"
    proved = proof.obligations - len(proof.open)
    return f"Proof       {proved} of {proof.obligations} obligations proved, {proof.seconds:.0f} s"


def _short_loop(report: VerifyReport) -> list[str]:
    """The result of the small graph for the requested rule, and the omitted checks."""
    rule = str(report.rule)
    differing = sum(c.differing[rule] for c in report.compared.values())
    lines = []
    if report.compared:
        without = ""
        if report.coverage is not None:
            missed = rule in report.coverage.covered
            without = f"; {'missed' if missed else '[red]not missed[/]'} when taken away"
        lines.append(
            f"{rule:11} decides {report.pairs:,} of these inputs, and {differing:,} differ{without}"
        )
    if report.undecided:
        shown = NO_GRAPH.get(rule)
        lines.append(
            f"[red]Cannot tell[/] {rule} decides nothing in the small graph; "
            + (f"it is shown by {shown}" if shown else "run automcm verify --no-models")
        )
    lines.append(
        "Left out    the larger graphs, four stations, the other rules, generated files: "
        "automcm verify --no-models"
    )
    return lines


def _holds(verdicts: list[models.ModelVerdict]) -> Table:
    table = _table("Models: every property holds")
    for name in ("distinct states", "checks", "reached", "seconds", "", ""):
        table.add_column(name, justify="left" if name in ("checks", "") else "right")
    for v in verdicts:
        r = v.result
        states = f"{r.distinct_states:,}" if r else ""
        seconds = f"{r.seconds:.1f}" if r else ""
        reached = str(len(v.reached)) if v.reached else ""
        table.add_row(
            v.model.cfg, states, checks(v.model), reached, seconds, _mark(v), *_problem(v)
        )
    return table


def _fails(verdicts: list[models.ModelVerdict]) -> Table:
    """Two entries in a row, so that the output fits on one screen."""
    table = _table("Must fail: a mechanism taken away breaks what it protects")
    for name in ("breaks", "steps", "", "model", "breaks", "steps", ""):
        table.add_column(name, justify="right" if name == "steps" else "left", no_wrap=True)
    half = (len(verdicts) + 1) // 2
    for pair in zip_longest(verdicts[:half], verdicts[half:]):
        table.add_row(*(cell for v in pair if v for cell in _fail(v)))
    return table


def _fail(v: models.ModelVerdict) -> tuple[str, str, str, str]:
    return v.model.cfg, v.property or "-", str(len(v.trace) - 1) if v.trace else "", _mark(v)


def _mark(v: models.ModelVerdict) -> str:
    return "[red]FAIL[/]" if not v.ok else "[green]kept[/]" if v.kept else "[green]ok[/]"


def _table(title: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.add_column("model", no_wrap=True)
    return table


def _problem(v: models.ModelVerdict) -> tuple[str, ...]:
    """The first line; errors of tools follow the tables."""
    if v.outcome == "error" and v.error is not None:
        return (f"{v.error.kind} error, see below",)
    return (escape(v.problem.splitlines()[0]),) if v.problem else ("",)


def _comparison(report: VerifyReport, console: Console) -> None:
    for word, results in (("Comparison", report.compared), ("Compiled", report.compiled)):
        for name, of in results.items():
            console.print(
                f"{word:11} {name}: {of.states:,} states, {of.inputs:,} inputs (every input), "
                f"{of.differences} differences"
            )
    for agreement in report.compiled.values():
        for found in agreement.found[:1]:
            _differs(console, str(found))
    if report.behaviours:
        console.print(
            f"Behaviours  {report.behaviours} of four stations replayed, "
            f"{len(report.behaviour_differences)} differences"
        )
    if report.coverage is not None and not report.rule:
        rules = report.coverage
        total = len(rules.covered) + len(rules.uncovered)
        missing = f", [red]not missed: {', '.join(rules.uncovered)}[/]" if rules.uncovered else ""
        console.print(
            f"Rules       {len(rules.covered)} of {total} missed when "
            f"taken away{missing}; {len(NO_GRAPH)} shown by a test"
        )
    for text in [*map(explain, report.found), *report.behaviour_differences][:3]:
        _differs(console, text)


def _differs(console: Console, text: str) -> None:
    """A difference line by line, because the terminal shows a line feed within a text as such."""
    first, *others = text.split("\n")
    console.print(f"[red]Differs[/]     {escape(first)}", soft_wrap=True)
    for line in others:
        console.print(escape(line), soft_wrap=True)
