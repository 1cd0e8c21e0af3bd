"""The JSON Schema of a message on the wire, for those who read or write them elsewhere.

``python -m automcm.schema`` prints it as it is committed in ``messages.schema.json``.
"""

from __future__ import annotations

import json
from typing import Any, get_args

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from automcm.messages import ANSWER_REASONS, MESSAGE, RefusalReason


class _Generator(GenerateJsonSchema):
    """Pydantic's schema without titles and defaults, and with absent where Python says None."""

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


def _forms() -> dict[str, list[dict[str, Any]]]:
    """What belongs together in a message (END-5, END-6): it has exactly one of these forms."""
    later = {"minimum": 1}
    answers = [reason for reason in get_args(RefusalReason) if reason in ANSWER_REASONS]
    others = [reason for reason in get_args(RefusalReason) if reason not in ANSWER_REASONS]

    def no(reasons: list[str], seq: dict[str, int]) -> dict[str, Any]:
        fields = {"accepted": {"const": False}, "reason": {"enum": reasons}, "seq": seq}
        return {
            "properties": fields,
            "required": ["reason"],
            "not": {"required": ["selected"]},
        }

    yes = {
        "properties": {"accepted": {"const": True}, "seq": later},
        "required": ["selected"],
        "not": {"required": ["reason"]},
    }
    closed = {"const": "closed"}
    return {
        "Acceptance": [yes, no(others, later), no(answers, {"maximum": 0})],
        "Cancel": [
            {"properties": {"reason": {"not": closed}, "seq": later}},
            {"properties": {"reason": closed, "seq": {"maximum": 0}}},
        ],
    }


def schema() -> dict[str, Any]:
    """The JSON Schema of a message.

    What it cannot say stays with ``decode``: that 1.0 is no integer, how deep ``details`` may
    nest, and how many bytes a message may have.
    """
    generated = MESSAGE.json_schema(schema_generator=_Generator)
    for name, definition in generated["$defs"].items():
        definition.pop("title", None)
        fields = definition.get("properties", {})
        if "type" in fields and "src" in fields:
            needed = {*definition["required"], "v", "type"} | ({"seq"} & fields.keys())
            definition["required"] = [field for field in fields if field in needed]
        if name in _forms():
            definition["oneOf"] = _forms()[name]
    return {
        "$schema": GenerateJsonSchema.schema_dialect,
        "$id": "urn:automcm:message:1",
        "title": "A message of AutoMCM, version 1, or a CAM",
        **generated,
    }


def text() -> str:
    """The schema as committed: keys sorted, indented by two, a newline at the end."""
    return json.dumps(schema(), indent=2, sort_keys=True) + "\n"


if __name__ == "__main__":
    print(text(), end="")
