"""The oracle: its format, its questions, and every way it can be refused."""

from __future__ import annotations

import json
import lzma
import shutil
from pathlib import Path

import pytest

from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.rules import RULES, handler, line, operators
from automcm_spec.vocabulary.station import Command, Message, Receive, Station

INITIAL = Station(3, 1, 5, 4).initial
REQUEST = Command("command", "request", (0, 0), 0, 0)


def test_the_committed_oracles_are_small() -> None:
    assert sum(graph.path.stat().st_size for graph in oracle_generation.GRAPHS.values()) < 5_000_000


def test_adv_1_a_question(one_peer: oracle.Oracle) -> None:
    answer = one_peer.ask(INITIAL, REQUEST)
    assert answer.changes and answer.effect.rule == "ADV-1"
    assert [m.type for m in answer.effect.messages] == ["Advertisement"]
    assert one_peer.states[answer.next].phase == "ADVERTISING"
    text = (TLA / "Station.tla").read_text().splitlines()[line("ADV-1", REQUEST) - 1]
    assert '"ADV-1"' in text and handler(REQUEST) == "OnRequest"


def test_end_6_a_refusal_changes_nothing(one_peer: oracle.Oracle) -> None:
    ack = Message("Ack", 2, 1, (1, 1), 0, 0, False, "none", ("Fin", 1))
    answer = one_peer.ask(INITIAL, Receive("receive", ack, False))
    assert not answer.changes and answer.next == 0 and answer.effect.rule == "END-6"


def test_every_rule_decides_something_or_is_shown_elsewhere(one_peer: oracle.Oracle) -> None:
    deciding = {effect.rule for effect in one_peer.effects}
    assert set(RULES) - deciding == {"ACT-1", "END-4"}


def test_every_input_has_an_answer_where_it_is_offered(one_peer: oracle.Oracle) -> None:
    pairs = sum(1 for n in range(len(one_peer.states)) for _ in one_peer.answers(n))
    assert pairs == one_peer.transitions + one_peer.refusals


def test_what_some_rules_decide_is_found_in_the_same_order() -> None:
    tight = oracle.load(oracle_generation.TIGHT.path)
    everything = [a for state in range(len(tight.states)) for a in tight.answers(state)]
    for rules in ({*RULES, ""}, {"MEM-1"}, {"END-5", "NEG-4", "ADV-1"}, set[str]()):
        expected = [answer for answer in everything if answer.effect.rule in rules]
        assert list(tight.decided_by(rules)) == expected


def test_paths_lead_where_they_say(one_peer: oracle.Oracle) -> None:
    for n in range(0, len(one_peer.states), 97):
        state = 0
        for i in one_peer.path(n):
            answer = one_peer.answer(state, i)
            assert answer is not None
            state = answer.next
        assert state == n


@pytest.mark.slow
def test_generation_gives_the_same_bytes_twice() -> None:
    tiny = oracle_generation.Graph("tiny", (2,), 1, 1, 1, 3, 1)
    assert oracle_generation.generate(tiny, workers=1) == oracle_generation.generate(
        tiny, workers=2
    )


def test_another_spec_version_is_refused(tmp_path: Path) -> None:
    for path in TLA.glob("*.tla"):
        shutil.copy(path, tmp_path)
    with (tmp_path / "Station.tla").open("a") as stream:
        stream.write("\\* another version\n")
    with pytest.raises(oracle.OracleError, match=r"one-peer.*spec_hash.*make generate"):
        oracle.load(oracle_generation.ONE_PEER.path, oracle_generation.spec_hash(tmp_path))


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"rubbish", "corrupt"),
        (lzma.compress(b"{"), "not JSON"),
        (lzma.compress(b"[]"), "format"),
        (lzma.compress(b'{"format": "automcm.oracle/0"}'), "format"),
    ],
)
def test_a_file_that_is_no_oracle_is_named(content: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.json.xz"
    path.write_bytes(content)
    with pytest.raises(oracle.OracleError, match=rf"bad\.json\.xz.*{problem}"):
        oracle.load(path)


def test_a_graph_of_other_values_than_the_compiled_station_has_is_named() -> None:
    data = json.loads(oracle.content(oracle_generation.TIGHT.path))
    data["states"][0].append(False)
    with pytest.raises(oracle.OracleError, match=r"tight: its values.*make generate"):
        oracle.parse(oracle.dump(data), "tight")


def test_every_input_goes_to_an_operator_that_is_there(one_peer: oracle.Oracle) -> None:
    assert {handler(i) for i in one_peer.inputs} <= operators().keys()


def test_blanks_before_the_sign_of_a_definition_hide_no_operator() -> None:
    known = operators()
    assert "OlderOrSame" not in known["SameProposal"][1]
    assert known["AckMatches"][1].count("/\\") == 4
