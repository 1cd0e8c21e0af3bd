"""Logs that are nearly right: what must be said of them, and that nothing of them is lost."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from automcm_spec.log_format.log import RECORD
from automcm_spec.log_format.log_schema import schema
from automcm_spec.log_format.reader import read
from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.messages import same
from automcm_traces.checker.engine import Engine
from automcm_traces.edit.log_shrinking import shrink
from automcm_traces.explain.coverage import measure
from automcm_traces.explain.explain import prefix, text, verdict_of, verdicts_of
from automcm_traces.explain.lint import CHECKS, report
from automcm_traces.explain.log_table import Logs
from automcm_traces.export.mermaid import diagram
from automcm_traces.system.properties import judge
from automcm_traces.system.timeline import timeline
from automcm_traces.viewer.page_run import load

CORPUS = Path(__file__).resolve().parents[2] / "corpus"
Line = dict[str, Any]


def changed(path: Path, change: Callable[[list[Line]], object], log: str = "pair/1001") -> Path:
    lines = [json.loads(line) for line in (CORPUS / f"{log}.ndjson").read_text().splitlines()]
    change(lines)
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def sent(lines: list[Line], kind: str) -> list[Line]:
    return [x for x in lines if x.get("ev") == "send" and x["message"]["type"] == kind]


def lane(*values: object) -> Callable[[list[Line]], None]:
    """The Advertisement's details: as commanded, and in each copy."""

    def change(lines: list[Line]) -> None:
        lines[1]["command"]["details"] = {"lane": values[0]}
        for n, x in enumerate(sent(lines, "Advertisement")):
            x["message"]["details"] = {"lane": values[min(n + 1, len(values) - 1)]}

    return change


def test_same() -> None:
    assert same({"a": [1, "x", {}]}, {"a": [1, "x", {}]})
    for one, other in ((1, True), (0, False), (1, 1.0), ([1], [True]), ({"a": 0}, {"a": False})):
        assert not same(one, other) and not same([one], [other])
    assert not same([1], [1, 2]) and not same({"a": 1}, {"b": 1})


@pytest.mark.parametrize("values", [(1, 1, True), (True, 1), (0, 0, False)])
def test_true_is_not_1(values: tuple[object, ...], tmp_path: Path) -> None:
    right = changed(tmp_path / "right.ndjson", lane(values[1]))
    path = changed(tmp_path / "log.ndjson", lane(*values))
    assert verdict_of(right).verdict == "allowed"
    found = verdict_of(path)
    assert (found.verdict, "details" in found.finding.observed) == ("diverges", True)


def test_true_received_where_1_was_sent_is_forged(tmp_path: Path) -> None:
    def received(lines: list[Line]) -> None:
        for x in lines:
            if x.get("ev") == "receive" and x["message"]["type"] == "Advertisement":
                x["message"]["details"] = {"lane": True}

    one = changed(tmp_path / "1001.ndjson", lane(1))
    other = changed(tmp_path / "2002.ndjson", received, "pair/2002")
    assert [v.finding.rule for v in verdicts_of([one, other])] == ["", "forged"]


OWN = """\
{"rec":"header","schema":"automcm.trace/1","run":"r","station":7,"implementation":{"name":"a",\
"version":"1"},"parameters":{},"complete":["receive","send"]}
{"rec":"event","seq":1,"t_ms":600,"ev":"receive","message":MESSAGE}
{"rec":"end","seq":1,"reason":"clean","lost_records":0}
"""


@pytest.mark.parametrize(
    "message",
    [
        '{"v":1,"type":"Fin","src":1,"dst":7,"session":["x",1],"seq":3}',
        '{"v":1,"type":"Fin","src":1,"dst":7,"session":[1,"1"],"seq":3}',
        '{"v":1,"type":"Foo","session":[[1],2]}',
    ],
)
def test_end_5_a_malformed_message_in_a_log_of_messages_alone(message: str, tmp_path: Path) -> None:
    path = tmp_path / "own.ndjson"
    path.write_text(OWN.replace("MESSAGE", message))
    assert verdict_of(path).verdict == "allowed"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("session", odd) for odd in ("x", [1], [1, "1"], [1, True], {"a": 1}, 7)),
        *((name, odd) for name in ("proposal", "target") for odd in ("", True, [1], {"a": 1})),
    ],
)
def test_a_command_that_names_something_odd_is_no_record(name: str, value: object) -> None:
    line = {"rec": "event", "seq": 1, "t_ms": 0, "ev": "command", "command": {"name": "abort"}}
    RECORD.validate_json(json.dumps(line))
    assert Draft202012Validator(schema()).is_valid(line)
    line["command"] = {"name": "abort", name: value}
    with pytest.raises(ValueError, match=r"must be"):
        RECORD.validate_json(json.dumps(line))
    assert not Draft202012Validator(schema()).is_valid(line)


def test_a_timer_whose_message_is_not_told(tmp_path: Path) -> None:
    def change(lines: list[Line]) -> None:
        timers = (x for x in lines if x.get("op") == "expire" and x["timer"]["name"] == "resend")
        del next(timers)["timer"]["message"]

    path = changed(tmp_path / "log.ndjson", change, "pair/2002")
    assert report(path).verdict == "clean"
    found = verdict_of(path)
    assert (found.verdict, found.finding.observed) == ("diverges", "expire resend: not armed")


@pytest.fixture
def cut(tmp_path: Path) -> Path:
    """A log that ends with the line that is wrong, which lacks its line feed."""
    lines = (CORPUS / "bad/wrong_proposal.ndjson").read_bytes().splitlines(keepends=True)
    path = tmp_path / "cut.ndjson"
    path.write_bytes(b"".join(lines[:56]).removesuffix(b"\n"))
    return path


def test_a_prefix_whose_last_line_lacks_its_line_feed(cut: Path, tmp_path: Path) -> None:
    found = verdict_of(cut)
    again = verdict_of(prefix(found, tmp_path / "out"))
    assert found.verdict == again.verdict == "diverges"
    assert (again.finding.at.line, again.finding.observed) == (
        found.finding.at.line,
        found.finding.observed,
    )


@pytest.mark.slow
def test_a_last_line_without_line_feed_is_shrunk_too(cut: Path) -> None:
    whole = cut.with_name("whole.ndjson")
    whole.write_bytes(cut.read_bytes() + b"\n")
    assert len(shrink([cut]).logs[0].items) == len(shrink([whole]).logs[0].items) < 20


ODD = "\x1b]0;owned\x07\n  S1->>S2: Fin"


def test_control_characters_of_a_log_stay_in_it(tmp_path: Path) -> None:
    def change(lines: list[Line]) -> None:
        next(line for line in lines if "phase" in line)["phase"] = ODD

    path = changed(tmp_path / "log.ndjson", change, "pair/2002")
    shown = text(verdict_of(path))
    assert "owned" in shown and all(c.isprintable() or c == "\n" for c in shown)
    assert "\n  S1" not in shown
    logs = Logs([path])
    drawn = "\n".join(diagram(logs.rows(), logs.stations))
    assert "owned" in drawn and "\x1b" not in drawn and "\n  S1-" not in drawn


WAYS: dict[str, Callable[[Path], object]] = {
    "explain": verdict_of,
    "timeline": lambda path: timeline(read(path)),
    "judge": lambda path: judge([read(path)]),
    "page": lambda path: load([path]),
    "coverage": lambda path: measure([path]),
}


@pytest.mark.parametrize("fault", [KeyError, TypeError, IndexError, ValueError, AttributeError])
@pytest.mark.parametrize("way", WAYS)
def test_a_fault_of_ours_is_not_blamed_on_the_log(
    way: str, fault: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise fault("ours")

    monkeypatch.setattr(Engine, "feed", broken)
    with pytest.raises(fault, match="ours"):
        WAYS[way](CORPUS / "pair/1001.ndjson")


ODD_VALUES = (0, -1, 7, 2**53, 10**30, True, None, 1.5, "", "CAM", [], [1001, "1"], [[1], 2], {})


@pytest.mark.sweep(20)
@pytest.mark.parametrize("seed", range(150))
def test_no_odd_field_ends_with_an_exception_of_ours(seed: int, tmp_path: Path) -> None:
    draw = random.Random(seed)

    def odd(lines: list[Line]) -> None:
        inside: Any = draw.choice(lines[: draw.choice((1, len(lines)))])
        for _ in range(draw.randrange(4)):
            parts = [v for v in inside.values() if isinstance(v, dict)]
            inside = draw.choice(parts) if parts else inside
        name = draw.choice([*inside, "session", "planned", "dst"])
        inside.pop(name, None)
        if draw.random() < 0.8:
            inside[name] = draw.choice(ODD_VALUES)

    path = changed(tmp_path / "log.ndjson", odd, draw.choice(("pair/1001", "pair/2002")))
    for way in WAYS.values():
        try:
            way(path)
        except BadInput as error:
            assert error.path == str(path) and error.line and error.rule in CHECKS
