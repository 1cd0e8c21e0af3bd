"""The JSON Schema vendors get is the format this package reads."""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError

import automcm_spec.log_format.log_schema
from automcm_spec.log_format.log import RECORD
from automcm_spec.log_format.log_schema import schema
from automcm_spec.vocabulary.json_schema import text

HEADER = (
    '{"rec":"header","schema":"automcm.trace/1","run":"r1","station":7,'
    '"implementation":{"name":"acme","version":"1.0"},"parameters":{"t_resend":100},'
    '"complete":["receive","send"]}'
)
EVENT = '{"rec":"event","seq":1,"t_ms":5,'
END = '{"rec":"end","seq":1,"reason":"clean","lost_records":0}'

TAKEN = [
    HEADER,
    HEADER.replace('"parameters"', '"spec":{"name":"Station","hash":"a"},"parameters"'),
    EVENT + '"ev":"restart","rule":"END-8","phase":"STANDALONE","role":"none"}',
    EVENT + '"ev":"send","tx":"7:1","message":{"type":"Fin","x_a":[1,{"b":true}]},"x_c":"d"}',
    EVENT + '"ev":"receive","tx":"8:1","message":{"type":"Advertisement"},"planned":{"t0":1}}',
    EVENT + '"ev":"receive","tx":"8:1","raw":"AA=="}',
    EVENT + '"ev":"receive","raw":"AA==","rejected":"replayed"}',
    EVENT + '"ev":"timer","op":"arm","timer":{"name":"cam"},"deadline":9}',
    EVENT + '"ev":"timer","op":"stop","timer":{"name":"forget","station":8}}',
    EVENT + '"ev":"timer","op":"expire","timer":{"name":"giveup","message":'
    '{"type":"Fin","to":8,"session":[7,1],"seq":2}}}',
    EVENT + '"ev":"command","command":{"name":"prescribe","target":8}}',
    EVENT + '"ev":"indication","indication":{"name":"ended","reason":"timeout"}}',
    END,
]
REFUSED = [
    "[]",
    "{}",
    HEADER.replace("trace/1", "trace/2"),
    HEADER.replace('"station":7', '"station":0'),
    HEADER.replace('"receive",', '"send",'),
    HEADER.replace('"t_resend"', '"t_unheard"'),
    EVENT + '"ev":"song"}',
    EVENT + '"ev":"restart","tx":"7:1"}',
    EVENT + '"ev":"restart","rule":null}',
    EVENT + '"ev":"restart","x_load":0.5}',
    EVENT + '"ev":"send","tx":"7","message":{"type":"Fin"}}',
    EVENT + '"ev":"send","tx":"7:1","message":{"src":7}}',
    EVENT + '"ev":"send","tx":"7:1","message":{"type":"CAM","speed":1.5}}',
    EVENT + '"ev":"receive","tx":"8:1"}',
    EVENT + '"ev":"receive","tx":"8:1","message":{"type":"Fin"},"raw":"AA=="}',
    EVENT + '"ev":"receive","message":{"type":"Fin"},"rejected":"stale"}',
    EVENT + '"ev":"timer","op":"arm","timer":{"name":"cam"}}',
    EVENT + '"ev":"timer","op":"stop","timer":{"name":"cam"},"deadline":9}',
    EVENT + '"ev":"timer","op":"stop","timer":{"name":"cam","station":8}}',
    EVENT + '"ev":"timer","op":"stop","timer":{"name":"giveup","message":'
    '{"type":"Fin","to":8,"session":[7],"seq":2}}}',
    EVENT + '"ev":"command","command":{"name":"dance"}}',
    EVENT + '"ev":"indication","indication":{"name":"ended","reason":null}}',
    END.replace('"lost_records":0', '"lost_records":-1'),
]


def test_the_committed_schema_is_the_generated_one() -> None:
    committed = Path(automcm_spec.log_format.log_schema.__file__).with_name("trace-1.schema.json")
    assert committed.read_bytes() == text(schema()).encode()


@pytest.mark.parametrize("line", TAKEN)
def test_the_models_take(line: str) -> None:
    RECORD.validate_json(line)


@pytest.mark.parametrize("line", REFUSED)
def test_the_models_refuse(line: str) -> None:
    with pytest.raises(ValidationError):
        RECORD.validate_json(line)


def test_the_schema_takes_and_refuses_the_same() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(schema())
    validator = jsonschema.Draft202012Validator(schema())
    assert [line for line in TAKEN if not validator.is_valid(json.loads(line))] == []
    assert [line for line in REFUSED if validator.is_valid(json.loads(line))] == []
