"""The JSON Schema of one line of a log, for those who write logs in another language.

``python -m automcm_traces.schema`` prints it as it is committed in ``trace-1.schema.json``.
"""

import json
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from automcm_traces.log import RECORD, SCHEMA


class _Generator(GenerateJsonSchema):
    """Pydantic's schema without titles, and with absent where Python says None."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        union = super().tagged_union_schema(schema)
        union.pop("discriminator", None)  # OpenAPI, not JSON Schema
        return union


def schema() -> dict[str, Any]:
    """The JSON Schema of a line.

    What a schema cannot say stays with the reader: order of lines, `seq`, `t_ms`, and that 1.0 is
    no integer.
    """
    generated = RECORD.json_schema(by_alias=True, schema_generator=_Generator)
    for name, definition in generated["$defs"].items():
        definition.pop("title", None)
        if name != "Value":
            definition["patternProperties"] = {"^x_": {"$ref": "#/$defs/Value"}}
    return {
        "$schema": GenerateJsonSchema.schema_dialect,
        "$id": "urn:automcm:trace:1",
        "title": f"One line of a log, {SCHEMA}",
        **generated,
    }


def text() -> str:
    """The schema as committed: keys sorted, indented by two, a newline at the end."""
    return json.dumps(schema(), indent=2, sort_keys=True) + "\n"


if __name__ == "__main__":
    print(text(), end="")
