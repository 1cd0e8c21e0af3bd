"""The JSON Schema vendors get is the format this package reads."""

from pathlib import Path

import jsonschema
import pytest
from test_log import END, REFUSED, REQUIRED, TAKEN, Line

import automcm_spec.log_format.log_schema
from automcm_spec.log_format.log_schema import schema
from automcm_spec.vocabulary.json_schema import text

VALIDATOR = jsonschema.Draft202012Validator(schema())


def test_the_committed_schema_is_the_generated_one() -> None:
    committed = Path(automcm_spec.log_format.log_schema.__file__).with_name("trace-1.schema.json")
    assert committed.read_bytes() == text(schema()).encode()
    jsonschema.Draft202012Validator.check_schema(schema())


@pytest.mark.parametrize("line", [*TAKEN, END, *(record for record, _ in REQUIRED)])
def test_the_schema_takes_what_the_reader_takes(line: Line) -> None:
    VALIDATOR.validate(line)


UNSAID = {"sorted", "must be an integer, not 1.0", "only with", "must be base64"}
"""What the reader says of the lines that the schema takes all the same."""


def test_the_schema_refuses_what_the_reader_refuses() -> None:
    wrong = [(record | change, said) for record, change, _, said in REFUSED]
    wrong += [
        ({name: value for name, value in record.items() if name != field}, "missing")
        for record, fields in REQUIRED
        for field in fields
    ]
    wrong += [(END | {"lost_records": -1}, "-1"), (END | {"rule": "END-8"}, "unknown field")]
    assert {said for line, said in wrong if VALIDATOR.is_valid(line)} == UNSAID
