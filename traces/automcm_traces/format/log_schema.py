"""The JSON Schema of one line of a log, for those who write logs in another language.

``python -m automcm_traces.format.log_schema`` prints it as it is committed in
``trace-1.schema.json``.
"""

from typing import Any

from automcm_spec.vocabulary import json_schema
from automcm_traces.format.log import RECORD, SCHEMA


def schema() -> dict[str, Any]:
    """The JSON Schema of a line.

    What a schema cannot say stays with the reader: order of lines, `seq`, `t_ms`, and that 1.0 is
    no integer.
    """
    generated = RECORD.json_schema(by_alias=True, schema_generator=json_schema.Generator)
    for name, definition in generated["$defs"].items():
        if name != "Value":
            definition["patternProperties"] = {"^x_": {"$ref": "#/$defs/Value"}}
    return json_schema.document("trace:1", f"One line of a log, {SCHEMA}", generated)


if __name__ == "__main__":
    print(json_schema.text(schema()), end="")
