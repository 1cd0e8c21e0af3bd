"""Makes verdicts and the report from the results of a run."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from automcm_conformance.adapter.process import LIMIT_S
from automcm_conformance.exchange import records, transcript
from automcm_conformance.exchange.exchange import Wrong
from automcm_conformance.exchange.results import (
    INTERRUPTED,
    CaseResult,
    Failure,
    Implementation,
    Line,
    Report,
    Verdict,
)
from automcm_conformance.suite.graph_cases import Runner
from automcm_conformance.suite.purposes import Purpose
from automcm_conformance.suite.tally import Tally
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput, errors_of
from automcm_spec.vocabulary.rules import RULES, handler, line
from automcm_traces.checker.finding import NOTHING_WRONG

Expectations = Mapping[str, tuple[Verdict, str]]
"""The expected verdict of a case with a known deviation, and the reason."""
SHOWN = 60
"""The number of lines of an exchange in a report; the replay has all."""


class _Known(BaseModel, extra="forbid", strict=True):
    """A known deviation."""

    verdict: Verdict
    because: Annotated[str, Field(pattern=r"\S")]


_KNOWN = TypeAdapter(dict[str, _Known])


def expectations(path: Path, purposes: Sequence[Purpose]) -> dict[str, tuple[Verdict, str]]:
    """An expectations file: ``"AMCM/…" = {verdict = "FAIL", because = "why"}`` for each case.

    Raises BadInput and OSError.
    """
    try:
        entries = _KNOWN.validate_python(tomllib.loads(path.read_text()))
    except ValidationError as error:
        raise BadInput(path, 0, *errors_of(error)[0]) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(path, 0, "", str(error)) from None
    for name in entries.keys() - {purpose.id for purpose in purposes}:
        raise BadInput(path, 0, name, "unknown case")
    return {name: (entry.verdict, entry.because) for name, entry in entries.items()}


def implementation(runner: Runner) -> Implementation:
    """The implementation's data from ``hello``."""
    hello = runner.adapter.hello.model_dump(exclude={"protocol"})
    hello |= {"features": sorted(hello["features"]), "fixed": dict(sorted(hello["fixed"].items()))}
    return Implementation(**hello, command=runner.adapter.command)


def report(
    runner: Runner,
    folder: Path,
    spec_hash: str,
    selectors: Sequence[str],
    expected: Expectations,
) -> Report:
    """The report of a run; replays are written into ``folder``."""
    cases = [_result(runner, tally, folder, expected) for tally in runner.tallies.values()]
    reached, totals = Counter[str](), Counter[str]()
    graphs = {}
    for part in runner.parts:
        reached += part.reached
        totals += part.totals
        graphs[part.name] = {
            kind: [part.reached[kind], part.totals[kind]] for kind in ("transitions", "refusals")
        }
        if part.forbidden:
            graphs[part.name]["forbidden by time"] = [part.forbidden, part.totals.total()]
    coverage = {kind: [reached[kind], totals[kind]] for kind in ("transitions", "refusals")}
    rules = {rule for case in cases for rule in case.rules}
    seen = {rule for case in cases if case.verdict in ("PASS", "FAIL") for rule in case.rules}
    coverage["rules"] = [len(seen), len(rules)]
    problems = list(runner.adapter.problems)
    notes = [runner.adapter.slowness, *runner.notes]
    if runner.elsewhere is not None:
        about = f"{runner.elsewhere.deciding.rule}: {runner.elsewhere.what}"
        notes.append(f"a case that was not chosen fails: {about}")
    if runner.cut_short:
        is_wanted = runner.has_enough or runner.cut_short == INTERRUPTED
        (notes if is_wanted else problems).append(runner.cut_short)
    return Report(
        implementation(runner),
        cases,
        coverage,
        graphs,
        spec_hash,
        runner.seed,
        list(selectors),
        problems,
        notes=list(filter(None, notes)),
        case_seconds={name: round(s, 3) for name, s in runner.case_seconds.items() if s},
        broke=runner.broke,
    )


def _result(runner: Runner, tally: Tally, folder: Path, expected: Expectations) -> CaseResult:
    purpose = tally.purpose
    verdict, reason = _verdict(runner, tally)
    wanted, because = expected.get(purpose.id, ("PASS", ""))
    names = "id", "level", "given", "when", "then", "bug", "cost"
    return CaseResult(
        **{name: getattr(purpose, name) for name in names},
        verdict=verdict,
        rules=list(purpose.rules),
        reason=reason,
        wanted=wanted,
        because=because,
        reached=tally.reached,
        total=tally.total,
        failures=_failures(runner, tally, folder),
        log=tally.log,
    )


def _failures(runner: Runner, tally: Tally, folder: Path) -> list[Failure]:
    case, o = tally.purpose.id, tally.outcome
    if o is None:
        return [failure(runner, case, n, fault, folder) for n, fault in enumerate(tally.faults, 1)]
    if o.verdict in ("PASS", "SKIP"):
        return []
    rule = o.finding.rule or o.finding.property
    at = (handler(o.input), line(rule, o.input)) if o.input else ("", 0)
    kind = o.verdict if o.finding == NOTHING_WRONG else o.finding.kind
    return [
        Failure(
            *(rule, *at, o.finding.guard, o.finding.nearest),
            rule_text=RULES.get(rule, ""),
            what=transcript.finding(o.finding) or o.reason,
            allowed=transcript.answerable(o.finding),
            came=o.came,
            exchange=o.lines,
            command=f"automcm conform run {case} --seed {runner.seed} {_behind(runner)}",
            difference=f"{kind} in a scenario",
        )
    ]


def _verdict(runner: Runner, tally: Tally) -> tuple[Verdict, str]:
    if tally.outcome is not None:
        o = tally.outcome
        return o.verdict, o.reason or transcript.finding(o.finding)
    if tally.faults:
        verdicts = [fault.verdict for fault in tally.faults]
        verdict: Verdict = "FAIL" if "FAIL" in verdicts else "ERROR"
        return verdict, tally.faults[verdicts.index(verdict)].what
    skipped, forbidden = tally.skipped.total(), tally.forbidden
    if runner.cut_short and tally.reached + skipped + forbidden < max(tally.total, 1):
        return "INCONC", f"{tally.reached:,} of {tally.total:,} driven: {runner.cut_short}"
    out = [f"{n:,} need {why}" for why, n in tally.skipped.most_common()]
    out += [f"{forbidden:,} are forbidden by time with these parameters"] if forbidden else []
    if tally.reached + skipped + forbidden < tally.total:
        others = (fault for t in runner.tallies.values() for fault in t.faults)
        cause = runner.elsewhere or next(others, None)
        why = f": {cause.what}" if cause else ""
        left = tally.total - tally.reached - skipped - forbidden
        return "INCONC", f"{left:,} of {tally.total:,} not driven, the way there went wrong{why}"
    if tally.reached == 0:
        return "SKIP", "; ".join(out) or "nothing to drive"
    return "PASS", f"left out of {tally.total:,}: {'; '.join(out)}" if out else ""


def _behind(runner: Runner) -> str:
    """The end of a command that runs the same station again."""
    adapter = runner.adapter
    limit = "" if adapter.limit_s == LIMIT_S else f"--limit {adapter.limit_s:g} "
    return f"{limit}-- {shlex.join(adapter.command)}"


def failure(runner: Runner, case: str, n: int, fault: Wrong, folder: Path) -> Failure:
    """The report's text of a fault; its replay is written."""
    name = re.sub(r"[^A-Za-z0-9]+", "-", case)
    replay = folder / "replay" / f"{name}-{n}.json"
    files.folder(replay.parent)
    steps = fault.steps
    files.write(replay, records.replay_text(case, fault.deciding.rule, fault.what, steps))
    last, lines = steps[-1], transcript.exchange(steps)
    if len(lines) > SHOWN:
        cut = Line(lines[0].now, "kit", f"… {len(lines) - SHOWN} lines; the replay has all …")
        lines = [cut, *lines[-SHOWN:]]
    came = ["no answer", *getattr(fault, "stderr", ())]
    if last.answer:
        came = [transcript.answered(last.answer)]
    return Failure(
        **asdict(fault.deciding),
        rule_text=RULES.get(fault.deciding.rule, ""),
        what=fault.what,
        allowed=transcript.allowed(last.expected),
        came=came,
        exchange=lines,
        replay=str(replay.relative_to(folder)),
        command=f"automcm conform replay {shlex.quote(str(replay))} {_behind(runner)}",
        timer=last.expected.timer,
        difference=fault.difference,
    )
