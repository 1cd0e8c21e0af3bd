"""How much of the specification a fleet's logs exercise."""

from __future__ import annotations

import json
from pathlib import Path
from typing import get_args

import pytest
from merged_runs import records, simulated

from automcm_spec.graph.oracle import load
from automcm_spec.graph.oracle_generation import TWO_PEERS, spec_hash
from automcm_spec.vocabulary.messages import MessageType
from automcm_spec.vocabulary.rules import RULES, kind
from automcm_traces.checker.finding import EXIT
from automcm_traces.explain.coverage import LogCoverage, exit_code, measure, possible, text
from automcm_traces.explain.explain import verdict_of


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return simulated(tmp_path_factory.mktemp("logs"), 1001, 2002, until=10_000)


@pytest.fixture(scope="module")
def covered(logs: list[Path]) -> LogCoverage:
    return measure(logs)


def test_what_a_plain_maneuver_exercises(covered: LogCoverage) -> None:
    assert (covered.logs, covered.problems, exit_code(covered)) == (2, [], 0)
    tables = covered.tables()
    for rule in ("ADV-1", "ADV-3", "PRE-2", "NEG-1", "NEG-2", "NEG-6", "ACT-3", "ADV-2"):
        assert tables["rules"][rule] > 0, rule
    assert tables["rules"]["NEG-4"] == tables["rules"]["END-1"] == 0
    assert all(tables["phases"].values())
    assert tables["ways"]["NEGOTIATING -> ACTUATING"] == 2  # each of the two
    assert tables["ways"]["ACTUATING -> STANDALONE"] == tables["rules"]["ACT-3"] > 0
    assert tables["inputs"]["restart"] == 0
    assert tables["sent"]["Fin"] >= 1 and tables["received"]["CAM"] > 10


def conditions(coverage: LogCoverage) -> dict[tuple[str, str], tuple[int, int]]:
    """By operator and text: how often true, and how often false."""
    rows = coverage.as_dict()["conditions"]
    return {(row["operator"], row["text"]): (row["true"], row["false"]) for row in rows}


def test_each_condition_has_how_often_it_was_true_and_false(covered: LogCoverage) -> None:
    found = conditions(covered)
    assert found["OnPrescribe", "c.target \\in st.recorded"] == (1, 0)
    assert found["OnMessage", 'm.type = "Fin"'][0] == covered.counts["received"]["Fin"]
    assert found["OnMessage", 'm.type = "Cancel"'][0] == 0
    assert found["Decide", 'i.kind = "restart"'] == (0, None)
    assert (
        sum(found["OnCam", 'st.phase = "ACTUATING"']) == covered.tables()["inputs"]["receive CAM"]
    )
    true, false = found["Marks", "Bound(st)"]
    assert true + false == covered.counts["sent"]["CAM"]
    assert 0 < covered.conditions.both_ways() < len(found)


def test_logs_together_count_as_often_as_each(logs: list[Path], covered: LogCoverage) -> None:
    again = measure([*logs, *logs])
    assert again.steps == 2 * covered.steps
    assert again.conditions.both_ways() == covered.conditions.both_ways()
    twice = {key: 2 * count for key, count in covered.conditions.ways.items()}
    assert dict(again.conditions.ways) == twice


def test_few_questions_kept_or_many_is_the_same(
    logs: list[Path], covered: LogCoverage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("automcm_traces.explain.coverage.REMEMBERED", 3)
    assert measure(logs).as_dict() == covered.as_dict()


def test_every_figure_has_its_whole(covered: LogCoverage) -> None:
    all_ = possible()
    assert len(all_["phases"]) == 8 and "restart" in all_["inputs"]
    assert set(RULES) - set(all_["rules"]) == {"ACT-1", "END-4"}  # nothing decides by them
    for name, table in covered.tables().items():
        counted = covered.counts[name]
        assert set(counted) <= set(table), name  # nothing was seen that is not possible
    assert set(covered.tables()["sent"]) == {*get_args(MessageType), "CAM"}
    json.dumps(covered.as_dict())


@pytest.mark.slow
def test_one_peer_shows_all_ways_and_inputs_that_two_do() -> None:
    two = load(TWO_PEERS.path, spec_hash())
    phases = [state[0] for state in two.states]
    ways = {
        f"{was} -> {phases[to]}"
        for state, was in enumerate(phases)
        for to in two.moves(state).values()
    }
    assert ways == set(possible()["ways"])
    assert {kind(value) for value in two.inputs} == set(possible()["inputs"])
    assert set(phases) == set(possible()["phases"])


def test_the_text_names_what_never_happened(covered: LogCoverage) -> None:
    lines = text(covered)
    assert lines[0].startswith("2 logs, ")
    assert all(len(line) <= 80 for line in lines if line[:8] in ("  never:", " " * 8))
    whole = "\n".join(lines)
    never = next(line for line in lines if line.startswith("  never: "))
    assert "NEG-4" in whole and "restart" in whole and "NEG-2" not in never


def changed(path: Path, folder: Path, number: int, line: bytes) -> Path:
    lines = path.read_bytes().splitlines(keepends=True)
    lines[number - 1 : number] = [line]
    (folder / path.name).write_bytes(b"".join(lines))
    return folder / path.name


@pytest.mark.parametrize(
    ("line", "what", "reason"),
    [
        (b"\x00\x01\n", "unreadable", "not JSON"),
        (b"", "cannot_tell", "missing"),
        (b'{"rec":"event","seq":58,"t_ms":2000,"ev":"restart"}\n', "unreadable", "seq"),
    ],
)
def test_a_log_counts_up_to_where_it_goes_wrong(
    logs: list[Path], tmp_path: Path, line: bytes, what: str, reason: str
) -> None:
    one = measure([changed(logs[0], tmp_path, 60, line)])
    [(file, at, found, why)] = one.problems
    assert (file, at, found) == (str(tmp_path / logs[0].name), 60, what)
    assert one.events == 58 and one.steps > 0
    assert exit_code(one) == EXIT[found]
    assert reason in why or reason == "seq"


def test_a_log_that_does_not_promise_all_does_not_diverge(logs: list[Path], tmp_path: Path) -> None:
    """automcm trace explain allows it: the command before the Acceptance is unseen."""
    header, *rest = records(logs[1])
    kept = [r for r in rest if r["rec"] == "end" or r["ev"] in ("receive", "send")]
    lines = [header | {"complete": ["receive", "send"]}]
    lines += [r | {"seq": n} for n, r in enumerate(kept[:-1], 1)]
    lines.append(kept[-1] | {"seq": len(kept) - 1})
    part = tmp_path / "part.ndjson"
    part.write_text("".join(json.dumps(record) + "\n" for record in lines))
    assert verdict_of(part).verdict == "allowed"
    [(_, at, what, why)] = measure([part]).problems
    assert what == "cannot_tell" and at > 1
    assert "the log does not promise command, restart, timer" in why
