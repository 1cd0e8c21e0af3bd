"""From what a run found to verdicts: one result for each case, and the report."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import get_args

from automcm_conformance import records, words
from automcm_conformance.process import LIMIT_S
from automcm_conformance.purposes import Purpose
from automcm_conformance.results import (
    CaseResult,
    Failure,
    Implementation,
    Line,
    Report,
    Verdict,
)
from automcm_conformance.suite import Runner
from automcm_conformance.tally import Fault, Tally
from automcm_spec import files
from automcm_spec.rules import RULES, handler, line

Expectations = Mapping[str, tuple[Verdict, str]]
"""For a case the verdict that is known to come, and why."""
SHOWN = 60
"""Lines of an exchange in a report; the replay has all."""


class ExpectError(ValueError):
    """An expectations file that cannot be used; the text names the file and the entry."""


def expectations(path: Path, purposes: Sequence[Purpose]) -> dict[str, tuple[Verdict, str]]:
    """An expectations file: ``"AMCM/…" = {verdict = "FAIL", because = "why"}`` for each case.

    Raises ExpectError and OSError.
    """
    known = {purpose.id for purpose in purposes}
    found: dict[str, tuple[Verdict, str]] = {}
    try:
        entries = tomllib.loads(path.read_text())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ExpectError(f"{path}: {error}") from None
    for name, entry in entries.items():
        if name not in known:
            raise ExpectError(f"{path}: {name}: there is no such case")
        if not isinstance(entry, dict) or set(entry) != {"verdict", "because"}:
            raise ExpectError(f"{path}: {name}: needs verdict and because, and nothing else")
        verdict, because = entry["verdict"], entry["because"]
        if verdict not in get_args(Verdict):
            raise ExpectError(f"{path}: {name}.verdict: one of {', '.join(get_args(Verdict))}")
        if not isinstance(because, str) or not because.strip():
            raise ExpectError(f"{path}: {name}.because: say why")
        found[name] = verdict, because
    return found


def implementation(runner: Runner) -> Implementation:
    """What the implementation said about itself."""
    hello = runner.adapter.hello
    return Implementation(
        hello.name,
        hello.version,
        hello.issues,
        sorted(hello.features),
        list(hello.scenarios),
        {str(name): value for name, value in sorted(hello.fixed.items())},
        runner.adapter.command,
    )


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
    if runner.cut_short:
        problems.append(runner.cut_short)
    return Report(
        implementation(runner),
        cases,
        coverage,
        graphs,
        spec_hash,
        runner.seed,
        list(selectors),
        problems,
        broke=runner.broke,
    )


def _result(runner: Runner, tally: Tally, folder: Path, expected: Expectations) -> CaseResult:
    purpose = tally.purpose
    verdict, reason = _verdict(runner, tally)
    wanted, because = expected.get(purpose.id, ("PASS", ""))
    return CaseResult(
        purpose.id,
        verdict,
        list(purpose.rules),
        purpose.level,
        purpose.given,
        purpose.when,
        purpose.then,
        purpose.bug,
        purpose.cost,
        reason,
        wanted,
        because,
        tally.reached,
        tally.total,
        _failures(runner, tally, folder),
        tally.log,
    )


def _failures(runner: Runner, tally: Tally, folder: Path) -> list[Failure]:
    case, o = tally.purpose.id, tally.outcome
    if o is None:
        return [failure(runner, case, n, fault, folder) for n, fault in enumerate(tally.faults, 1)]
    if o.verdict in ("PASS", "SKIP"):
        return []
    again = f"automcm conform run {case} --seed {runner.seed} {_behind(runner)}"
    text = RULES.get(o.rule, "")
    return [
        Failure(o.rule, text, o.operator, o.line, o.what, o.allowed, o.came, o.lines, command=again)
    ]


def _verdict(runner: Runner, tally: Tally) -> tuple[Verdict, str]:
    if tally.outcome is not None:
        return tally.outcome.verdict, tally.outcome.reason
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
        others = (fault.what for t in runner.tallies.values() for fault in t.faults)
        cause = runner.elsewhere or next(others, "")
        why = f": {cause}" if cause else ""
        left = tally.total - tally.reached - skipped - forbidden
        return "INCONC", f"{left:,} of {tally.total:,} not driven, the way there went wrong{why}"
    if tally.reached == 0:
        return "SKIP", "; ".join(out) or "nothing to drive"
    return "PASS", f"left out of {tally.total:,}: {'; '.join(out)}" if out else ""


def _behind(runner: Runner) -> str:
    """What stands at the end of a command that asks the same station again."""
    adapter = runner.adapter
    limit = "" if adapter.limit_s == LIMIT_S else f"--limit {adapter.limit_s:g} "
    return f"{limit}-- {shlex.join(adapter.command)}"


def failure(runner: Runner, case: str, n: int, fault: Fault, folder: Path) -> Failure:
    """A fault in the words of a report; its replay is written."""
    name = re.sub(r"[^A-Za-z0-9]+", "-", case)
    replay = folder / "replay" / f"{name}-{n}.json"
    replay.parent.mkdir(parents=True, exist_ok=True)
    files.write(replay, records.replay_text(case, fault.rule, fault.what, fault.steps))
    last = fault.steps[-1]
    lines = words.exchange(fault.steps)
    if len(lines) > SHOWN:
        cut = Line(lines[0].now, "kit", f"… {len(lines) - SHOWN} lines; the replay has all …")
        lines = [cut, *lines[-SHOWN:]]
    came = [words.answered(last.answer)] if last.answer else ["no answer", *fault.stderr]
    return Failure(
        fault.rule,
        RULES.get(fault.rule, ""),
        handler(fault.input) if fault.input else "",
        line(fault.rule, fault.input) if fault.input else 0,
        fault.what,
        words.allowed(last.expected),
        came,
        lines,
        str(replay.relative_to(folder)),
        f"automcm conform replay {shlex.quote(str(replay))} {_behind(runner)}",
    )
