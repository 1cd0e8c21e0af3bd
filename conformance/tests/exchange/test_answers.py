"""Answers of a station: a wrong answer is the station's fault, a crash of the kit the kit's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from automcm_conformance.adapter.protocol import ProtocolError
from automcm_conformance.exchange import answers, records
from automcm_conformance.exchange.wire import Required
from automcm_spec.support.bad_input import BadInput

NOTHING: dict[str, Any] = {"messages": [], "indications": [], "deadline": None}
FIN = {"v": 1, "type": "Fin", "src": 1, "dst": 2, "session": [1, 1], "seq": 3}


def line(**fields: Any) -> bytes:
    return json.dumps(NOTHING | fields).encode() + b"\n"


@pytest.mark.parametrize(
    "marks", [None, 7, "x", {"a": 1}, [[1, 1], 7], [[1, 1], "x"], [[True, 1], [1, 2]]]
)
def test_act_5_odd_marks_are_a_difference(marks: Any) -> None:
    expected = Required(marks=[[[1, 1], [1, 2]]])
    cam = {"type": "CAM", "generation_ms": 5}
    assert not answers.differences(expected, line(cams=[cam | {"marks": [[1, 2], [1, 1]]}]))
    ((part, text, _),) = answers.differences(expected, line(cams=[cam | {"marks": marks}]))
    assert part == "cams" and text.endswith(f"got {marks}")


@pytest.mark.parametrize(
    ("due", "allowed"), [(50, [1]), (100, [1, 2]), (150, [1, 2]), (200, [1, 2, 3])]
)
def test_act_5_a_cam_has_no_marks_of_a_time_after_it_is_due(due: int, allowed: list[int]) -> None:
    marks = [[[1, n]] for n in (1, 2, 3)]
    expected = Required(marks=marks, marks_since=[0, 100, 200])
    for n, mark in enumerate(marks, 1):
        cam = {"type": "CAM", "generation_ms": due, "marks": mark}
        assert bool(answers.differences(expected, line(cams=[cam]))) == (n not in allowed)


@pytest.mark.parametrize("part", ["messages", "indications"])
@pytest.mark.parametrize("values", [(1, True), (True, 1), (0, False), (False, 0)])
def test_a_truth_value_is_no_number(part: str, values: tuple[int, int]) -> None:
    wanted, found = ([FIN | {"name": "refused", "accepted": value}] for value in values)
    assert answers.differences(Required(**{part: wanted}), line(**{part: found}))
    assert not answers.differences(Required(**{part: wanted}), line(**{part: wanted}))


def test_a_line_that_is_no_answer_is_no_difference() -> None:
    """What is no answer is in test_adapter_protocol."""
    with pytest.raises(ProtocolError, match="not JSON"):
        answers.differences(Required(), line(messages=[FIN | {"x": "\ud800"}]))


def test_a_fault_of_the_kit_is_no_wrong_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise KeyError("ours")

    monkeypatch.setattr(answers, "_messages", broken)
    with pytest.raises(KeyError, match="ours"):
        answers.differences(Required(), line(messages=[FIN]))


STEP = {"now": 0, "line": {}, "expected": {}}
REPLAY: dict[str, Any] = {"format": records.FORMAT, "case": "c", "rule": "r", "what": "w"}


@pytest.mark.parametrize(
    ("value", "field"),
    [
        ([], ""),
        (REPLAY, "steps"),
        (REPLAY | {"steps": [], "format": "x"}, "format"),
        (REPLAY | {"steps": [], "case": 7}, "case"),
        (REPLAY | {"steps": [STEP, STEP | {"now": "x"}]}, "steps[1].now"),
        (REPLAY | {"steps": [STEP | {"line": []}]}, "steps[0].line"),
        (REPLAY | {"steps": [STEP | {"expected": {"marks": 1}}]}, "steps[0].expected.marks"),
    ],
)
def test_a_file_that_is_no_replay_is_named_with_its_field(
    value: Any, field: str, tmp_path: Path
) -> None:
    path = tmp_path / "replay.json"
    path.write_text(json.dumps(value))
    with pytest.raises(BadInput) as caught:
        records.read_replay(path)
    assert (caught.value.path, caught.value.field) == (str(path), field)
    assert caught.value.rule == records.FORMAT


def test_a_replay_is_read(tmp_path: Path) -> None:
    path = tmp_path / "replay.json"
    path.write_text(json.dumps(REPLAY | {"steps": [STEP]}))
    about, (step,) = records.read_replay(path)
    assert about == {"case": "c", "rule": "r", "what": "w"}
    assert (step.now, step.line, step.expected) == (0, b"{}\n", Required())


def test_differences_are_in_the_words_of_json() -> None:
    refused = {"name": "refused"}
    expected = Required(indications=[refused])
    found = [p.text for p in answers.differences(expected, line(deadline=5))]
    assert found == [
        "indications: expected refused, got none",
        "deadline: expected null, got 5",
    ]


@pytest.mark.parametrize("field", ["seq", "session"])
def test_a_value_that_the_station_chooses_is_not_null(field: str) -> None:
    chosen = {"seq": None} if field == "seq" else {"session": [1, None]}
    expected = Required(messages=[FIN | chosen], fresh=[3])
    ((_, text, _),) = answers.differences(expected, line(messages=[FIN | chosen]))
    assert text.startswith(f"Fin.{field}: expected") and "a number" in text
    assert not answers.differences(expected, line(messages=[FIN]))


def test_many_messages_that_are_missing_are_counted() -> None:
    sent = [{"type": "Cancel", "session": [1, 1], "seq": n, "dst": n} for n in range(2, 18)]
    first, more = answers.differences(Required(messages=sent), line())
    assert first.text.startswith('not sent: Cancel {"type":"Cancel"')
    assert more.text == "not sent: 15 more of type Cancel" and more.kind == first.kind
