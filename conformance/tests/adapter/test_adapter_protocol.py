"""The lines of the adapter protocol: accepted lines, refused lines, and the explanations."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import jsonschema
import pytest
from cli_stage import REFERENCE
from pydantic import ValidationError

from automcm.adapters import adapter_lines
from automcm_conformance.adapter import adapter_schema, protocol
from automcm_conformance.adapter.process import Process
from automcm_spec.vocabulary import application, messages
from automcm_spec.vocabulary.application import Phase, Role, names
from automcm_spec.vocabulary.json_schema import text
from automcm_spec.vocabulary.parameters import Parameters
from automcm_spec.vocabulary.station import Station

ROOT = Path(__file__).resolve().parents[3]
HELLO = {
    "protocol": 1,
    "name": "acme",
    "version": "1.0",
    "issues": "acme.example/issues",
    "features": ["prescriber", "cam"],
    "scenarios": ["lane_change"],
    "fixed": {"t_resend": 100},
}
ANSWER = {"messages": [], "indications": [], "deadline": 1110, "phase": "INTENDING"}
SESSION = [7, 1]
PATH = {"t0": 0, "points": [[0, 0, 0]]}
TOLD: list[dict[str, Any]] = [
    {"name": "choose", "session": SESSION, "stations": [8, 9]},
    {"name": "no_participants", "session": SESSION, "rule": "PRE-1"},
    {"name": "verify", "session": SESSION, "proposal": 1, "prescribed": PATH},
    {"name": "undecided", "session": SESSION, "proposal": 1},
    {"name": "accepted", "session": SESSION, "proposal": 1, "selected": PATH, "lease_left_ms": 5},
    {"name": "propose", "session": SESSION, "proposal": 2, "reason": "unsafe"},
    {"name": "fallback", "session": SESSION, "reason": "timeout"},
    {"name": "finished", "session": SESSION, "detail": {"any": [None]}},
    {"name": "refused", "rule": "CMD-1"},
    {"name": "discarded"},
]
CAM = {"type": "CAM", "generation_ms": 1100}
DRIFTING: dict[str, Any] = {
    "cmd": "reset",
    "now": 1000,
    "station": 4711,
    "seed": 1,
    "parameters": dict.fromkeys((*protocol.DEFAULTS, "clock_drift"), 9),
}
COMMANDS: list[dict[str, Any]] = [
    {"cmd": "hello", "protocol": 1},
    {
        "cmd": "reset",
        "now": 1000,
        "station": 4711,
        "seed": 1,
        "parameters": dict.fromkeys(protocol.DEFAULTS, 9),
    },
    DRIFTING,
    {"cmd": "receive", "now": 1, "message": {}},
    {"cmd": "receive", "now": 1, "message": {"type": "Advertisement"}, "planned": PATH},
    {"cmd": "advance", "now": 1},
    {"cmd": "restart", "now": 1},
    {"cmd": "durations", "durations": {"giveup": 500, "hold": 70}},
    {"cmd": "stop"},
    *(
        {"cmd": "command", "now": 1, "command": command}
        for command in (
            {"name": "request", "scenario": "a", "details": {}},
            {"name": "request", "scenario": "a", "details": {}, "planned": PATH},
            {"name": "abort", "session": SESSION},
            {"name": "accept", "session": SESSION, "proposal": 1, "selected": PATH},
            {"name": "refuse", "session": SESSION, "proposal": 1},
            {
                "name": "prescribe",
                "session": SESSION,
                "proposal": 1,
                "target": 8,
                "prescribed": PATH,
                "hold_ms": 0,
                "lease_ms": 1,
            },
        )
    ),
]
NO_COMMANDS: list[dict[str, Any]] = [
    *(
        {**DRIFTING, "parameters": {**DRIFTING["parameters"], "clock_drift": drift}}
        for drift in (0, 100, None)
    ),
    {"cmd": "dance"},
    {"cmd": "stop", "now": 1},
    {"cmd": "advance", "now": -1},
    {"cmd": "receive", "now": 1, "message": {}, "planned": None},
    {"cmd": "durations", "durations": {"lease": 1}},
    {"cmd": "durations", "durations": {"hold": 0}},
    {"cmd": "command", "now": 1, "command": {"name": "refuse", "session": SESSION}},
]
ANSWERS: list[dict[str, Any]] = [
    ANSWER,
    {"messages": [], "indications": [], "deadline": None},
    {**ANSWER, "messages": [{"type": "Fin", "seq": 1}, {"type": "Ack"}], "cams": [CAM]},
    {**ANSWER, "indications": TOLD},
]


def without(value: dict[str, Any], *names: str) -> dict[str, Any]:
    return {key: item for key, item in value.items() if key not in names}


NO_ANSWERS: list[tuple[Any, str]] = [
    ([], "an answer must be an object, not a list"),
    (None, "must be an object, not null"),
    (without(ANSWER, "messages"), 'the field "messages" is missing'),
    (without(ANSWER, "indications"), 'the field "indications" is missing'),
    (without(ANSWER, "deadline"), 'the field "deadline" is missing; write null'),
    (without(ANSWER, "messages") | {"message": []}, 'field "message": did you mean "messages"?'),
    ({**ANSWER, "colour": 1}, 'unknown field "colour"'),
    ({**ANSWER, "deadline": "1110"}, "deadline must be an integer or null, not a string"),
    ({**ANSWER, "deadline": True}, "deadline must be an integer or null, not true"),
    ({**ANSWER, "deadline": -1}, "deadline: input should be greater than or equal to 0"),
    ({**ANSWER, "phase": "Waiting"}, 'did you mean "WAITING"?'),
    ({**ANSWER, "phase": None}, "phase: null is not allowed; leave the field out"),
    ({**ANSWER, "messages": None}, "messages must be a list, not null"),
    ({**ANSWER, "messages": ["{}"]}, "messages[0] must be an object, not a string (do not"),
    ({**ANSWER, "messages": [{}]}, "messages[0]: a message needs a 'type'"),
    ({**ANSWER, "messages": [{"type": "fin"}]}, 'type "fin": did you mean "Fin"?'),
    ({**ANSWER, "messages": [{"type": ["Fin"]}]}, 'messages[0]: unknown message type ["Fin"]'),
    ({**ANSWER, "messages": [CAM]}, "belongs in 'cams'"),
    ({**ANSWER, "cams": 0}, "cams must be a list, not an integer"),
    ({**ANSWER, "cams": [7]}, "cams[0] must be an object, not an integer"),
    ({**ANSWER, "cams": [{"type": "CAM"}]}, "cams[0]: a CAM needs the type"),
    ({**ANSWER, "indications": ["refused"]}, "indications[0] must be an object, not a string"),
    ({**ANSWER, "indications": [{}]}, "indications[0]: an indication needs a 'name'"),
    ({**ANSWER, "indications": [{"name": "refuse"}]}, 'did you mean "refused"?'),
    ({**ANSWER, "indications": [{"name": "finished"}]}, "'finished' lacks 'session'"),
    *(
        ({**ANSWER, "indications": [{**TOLD[0], "session": wrong}]}, "must be a list of two")
        for wrong in (7, [7], [7, "1"], [7, True], [7, 1, 1], None)
    ),
    ({**ANSWER, "indications": [{**TOLD[0], "stations": {}}]}, "must be a list of integers"),
    ({**ANSWER, "indications": [{**TOLD[5], "reason": None}]}, "must be a string"),
    ({**ANSWER, "indications": [{**TOLD[2], "prescribed": []}]}, "must be an object"),
    ({"error": 1}, '"error" must be a string and the only field'),
    ({"error": "no", "deadline": None}, '"error" must be a string and the only field'),
]
NO_HELLOS: list[tuple[Any, str]] = [
    (without(HELLO, "issues"), 'the field "issues" is missing'),
    ({**HELLO, "protocol": 2}, "protocol: the kit speaks version 1, not 2"),
    ({**HELLO, "protocol": True}, "protocol must be an integer, not true"),
    ({**HELLO, "features": ["cams"]}, "features[0] must be 'prescriber', "),
    ({**HELLO, "features": "cam"}, "features must be a list, not a string"),
    ({**HELLO, "scenarios": []}, "scenarios must not be empty"),
    ({**HELLO, "name": ""}, "name must not be empty"),
    ({**HELLO, "version": 1}, "version must be a string, not an integer"),
    ({**HELLO, "fixed": {"clock_drift": 1}}, 'fixed: unknown name "clock_drift"'),
    ({**HELLO, "fixed": {"t_send": 1}}, 'fixed: unknown name "t_send": did you mean "t_resend"?'),
]
NUMBER = b'{"messages":[{"type":"Fin","x":[%b]}],"indications":[],"deadline":null}'
NOT_JSON: list[tuple[bytes, str]] = [
    (b"Hello", "the line is not JSON: did you mean to write it to standard error?"),
    (b"", "the line is empty"),
    (b"\xef\xbb\xbf{}", "the line begins with a byte order mark: write UTF-8 without one"),
    (b"{", "write the whole answer on one line"),
    (b"{'messages': []}", "write names and strings in double quotes"),
    (b'{"messages": [}', "the line begins with an object but is not JSON"),
    (b"\xff", "the line is not UTF-8"),
    (b'{"deadline": 1110.0}', "1110.0 is not an integer: write 1, not 1.0"),
    *((NUMBER % n, "is not an integer") for n in (b"1.5", b"1e3", b"1E3", b"NaN", b"-Infinity")),
    (b'{"messages": ["\\ud800"]}', "not JSON"),
    (b"[" * 100_000, "not JSON"),
    (b'{"deadline": ' + b"9" * 9_000 + b"}", "not JSON"),
]


def line(value: Any) -> bytes:
    return json.dumps(value).encode()


def test_what_is_taken() -> None:
    for command in COMMANDS:
        protocol.COMMAND.validate_python(command)
    for answer in ANSWERS:
        read = protocol.read_answer(line(answer))
        assert read.model_dump(exclude_unset=True) == answer
    assert protocol.read_hello(line(HELLO)).model_dump() == HELLO


def test_the_kit_cannot_write_just_anything() -> None:
    for command in NO_COMMANDS:
        with pytest.raises(ValidationError):
            protocol.COMMAND.validate_python(command)


@pytest.mark.parametrize("fixed", [{"backoff_min": 3000}, {"backoff_max": 1}, {"max_rounds": 99}])
def test_chosen_parameters_fit_the_fixed_ones(fixed: dict[str, int]) -> None:
    hello = protocol.HelloAnswer.model_validate(HELLO | {"fixed": fixed})
    given = hello.fitted(protocol.DEFAULTS | {"clock_drift": 1})
    assert fixed.items() <= given.items() and "clock_drift" not in given
    assert Parameters(**given)


@pytest.mark.parametrize(
    ("read", "raw", "why"),
    [
        *((protocol.read_answer, line(value), why) for value, why in NO_ANSWERS),
        *((protocol.read_hello, line(value), why) for value, why in NO_HELLOS),
        *((protocol.read_answer, raw, why) for raw, why in NOT_JSON),
    ],
)
def test_what_is_no_answer(read: Callable[[bytes], object], raw: bytes, why: str) -> None:
    with pytest.raises(protocol.ProtocolError) as caught:
        read(raw)
    assert why in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_error_is_an_answer_of_its_own() -> None:
    with pytest.raises(protocol.Refused) as caught:
        protocol.read_answer(b'{"error": "what is restart?"}')
    assert caught.value.why == "what is restart?"


def test_the_page_has_the_same_indications() -> None:
    page = (ROOT / "docs" / "adapter.md").read_text()
    rows = [
        [cell.strip() for cell in row.split("|")[1:3]]
        for row in page.split("### Indications")[1].split("## ")[0].splitlines()
        if row.startswith("| `")
    ][1:]
    assert {name.strip("`"): fields.count("`") // 2 for name, fields in rows if fields} == {
        name: len(fields) + (name == "fallback") for name, fields in protocol.INDICATIONS.items()
    }  # the row of fallback names a reason, too


def test_what_an_indication_is_on_a_line_and_in_a_log() -> None:
    path, ids = messages.Trajectory.model_validate(PATH), {"src": 8, "dst": 7, "session": (7, 1)}
    session, one = {"session": (7, 1)}, {"session": (7, 1), "proposal": 1}
    intention = messages.Intention(**ids, seq=1, planned=path)
    other = intention.model_copy(update={"src": 9})
    asked = messages.Prescription(**ids, seq=1, proposal=1, prescribed=path, hold_ms=0, lease_ms=1)
    yes = messages.Acceptance(**ids, seq=1, proposal=1, accepted=True, selected=path)
    told = [
        application.Choose(**session, intentions=(other, intention)),
        application.NoParticipants(**session),
        application.Verify(**one, prescription=asked),
        application.Undecided(**one),
        application.Accepted(**one, acceptance=yes, lease_left_ms=5),
        application.Propose(session=(7, 1), proposal=2, reason="unsafe"),
        application.Fallback(**session, reason="timeout"),
        application.Finished(**session),
        application.Refused(detail="abort"),
        application.Discarded(detail="Fin"),
    ]
    assert (
        tuple(i.name for i in told) == names(application.Indication) == tuple(protocol.INDICATIONS)
    )
    lines = [i.model_dump(mode="json") for i in told]
    assert lines == [without(line, "rule", "detail") for line in TOLD]
    assert told[8].as_dict() == {"name": "refused", "detail": "abort"}
    whole = {"name": "accepted", "session": [7, 1], "proposal": 1, "lease_left_ms": 5}
    assert told[4].as_dict() == whole | {"acceptance": messages.to_dict(yes)}
    assert told[0].as_dict()["intentions"] == [messages.to_dict(other), messages.to_dict(intention)]


def test_phases_and_roles_are_those_of_the_specification() -> None:
    station = Station(1, 1, 1, 1)
    assert (set(get_args(Phase)), set(get_args(Role))) == (station.phases, station.roles)


def test_the_committed_schema_is_the_generated_one() -> None:
    path = ROOT / "conformance" / "adapter-1.schema.json"
    assert path.read_text() == text(adapter_schema.schema())


def test_the_schema_takes_and_refuses_the_same() -> None:
    schema = adapter_schema.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    taken = [*COMMANDS, *ANSWERS, HELLO, {"error": "no"}]
    refused = [*NO_COMMANDS, *(value for value, _ in [*NO_ANSWERS, *NO_HELLOS])]
    assert [value for value in taken if not validator.is_valid(value)] == []
    assert [value for value in refused if validator.is_valid(value)] == []


# -- the adapter of the reference


def test_the_adapter_answers_before_it_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    with Process(REFERENCE) as adapter:
        (answer,) = adapter.exchange([b'{"cmd": "hello", "protocol": 1}\n'])
        assert json.loads(answer) == adapter_lines.HELLO and adapter.stop() is None


def test_the_adapter_ends_with_stop_or_its_input() -> None:
    hello = b'{"cmd": "hello", "protocol": 1}\n'
    stopped = adapter_lines.serve([hello, b'{"cmd": "stop"}\n', hello])
    assert [json.loads(answer) for answer in stopped] == [adapter_lines.HELLO]
    done = subprocess.run(REFERENCE, input=b"{}\n", capture_output=True)
    assert done.returncode == 0 and set(json.loads(done.stdout)) == {"error"} and not done.stderr
