"""JSON Schemas generated from the models: of messages (``messages.schema.json``), and the common
parts of log and adapter schemas.
"""

from __future__ import annotations

import json
from typing import Any, get_args

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from automcm_spec.vocabulary.messages import ANSWER_REASONS, MESSAGE, RefusalReason


class Generator(GenerateJsonSchema):
    """Pydantic's schema without titles and defaults.

    A field with the default None may be absent but never null; a field with the default [] may be
    absent.
    """

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Always False."""
        return False

    def field_is_required(self, field: Any, total: bool) -> bool:
        """Whether the field is in every object; pydantic asks whether the constructor requires
        it."""
        inner = field["schema"]
        return inner["type"] != "default" or inner.get("default", ...) not in (None, [])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """The inner schema without the default, and without null if null is the default."""
        inner = self.generate_inner(schema["schema"])
        if schema.get("default", ...) is None:
            [inner] = [each for each in inner["anyOf"] if each != {"type": "null"}]
        return inner

    def computed_field_schema(self, schema: core_schema.ComputedField) -> JsonSchemaValue:
        """The schema of an ordinary field."""
        return self.generate_inner(schema["return_schema"])

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        """The schema without the discriminator, which belongs to OpenAPI and not to JSON Schema."""
        union = super().tagged_union_schema(schema)
        union.pop("discriminator", None)
        return union


def document(name: str, title: str, generated: dict[str, Any]) -> dict[str, Any]:
    """A complete schema: ``generated``, with the id ``urn:automcm:`` and this name."""
    for definition in generated["$defs"].values():
        definition.pop("title", None)
    about = {"$schema": GenerateJsonSchema.schema_dialect, "$id": f"urn:automcm:{name}"}
    return about | {"title": title} | generated


def text(schema: dict[str, Any]) -> str:
    """A schema as committed: sorted keys, indented by two, a newline at the end."""
    return json.dumps(schema, indent=2, sort_keys=True) + "\n"


def _forms() -> dict[str, list[dict[str, Any]]]:
    """Combinations of fields in a message (END-5, END-6): a message has exactly one of these
    forms."""
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


def messages() -> dict[str, Any]:
    """The JSON Schema of a message.

    ``decode`` checks what it cannot express: that 1.0 is not an integer, the nesting depth of
    ``details``, and the size of a message in bytes.
    """
    generated = MESSAGE.json_schema(schema_generator=Generator)
    for name, definition in generated["$defs"].items():
        if "dst" in definition.get("required", ()):
            definition["required"].remove("dst")  # broadcasts omit it
        if name in _forms():
            definition["oneOf"] = _forms()[name]
    return document("message:1", "A message of AutoMCM, version 1, or a CAM", generated)
