"""The JSON Schema of one line of a log, for log writers in other languages:
``trace-1.schema.json``."""

from typing import Any

from automcm_spec.log_format.log import RECORD, SCHEMA
from automcm_spec.vocabulary import json_schema


def schema() -> dict[str, Any]:
    """The JSON Schema of a line.

    The reader checks what a schema cannot express: the order of lines, `seq`, `t_ms`, and that 1.0
    is not an integer.
    """
    generated = RECORD.json_schema(by_alias=True, schema_generator=json_schema.Generator)
    for name, definition in generated["$defs"].items():
        if name != "Value":
            definition["patternProperties"] = {"^x_": {"$ref": "#/$defs/Value"}}
    return json_schema.document("trace:1", f"One line of a log, {SCHEMA}", generated)
