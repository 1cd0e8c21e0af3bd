"""JSON Schemas from the models: of the messages, and what those of a log and of the adapter share.

``python -m automcm_spec.vocabulary.json_schema`` prints the first as it is committed in
``messages.schema.json``.
"""

from __future__ import annotations

import json
from typing import Any, get_args

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from automcm_spec.vocabulary.messages import ANSWER_REASONS, MESSAGE, RefusalReason


class Generator(GenerateJsonSchema):
    """Pydantic's schema without titles and defaults.  A field whose default is None may be absent,
    and is never null; one whose default is an empty list may be absent."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Never."""
        return False

    def field_is_required(self, field: Any, total: bool) -> bool:
        """Whether it stands in every object: pydantic means, whether Python wants it."""
        inner = field["schema"]
        return inner["type"] != "default" or inner.get("default", ...) not in (None, [])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Without the default, and without null where that is the default."""
        inner = self.generate_inner(schema["schema"])
        if schema.get("default", ...) is None:
            [inner] = [each for each in inner["anyOf"] if each != {"type": "null"}]
        return inner

    def computed_field_schema(self, schema: core_schema.ComputedField) -> JsonSchemaValue:
        """As that of any other field."""
        return self.generate_inner(schema["return_schema"])

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        """Without the discriminator, which is of OpenAPI and not of JSON Schema."""
        union = super().tagged_union_schema(schema)
        union.pop("discriminator", None)
        return union


def document(name: str, title: str, generated: dict[str, Any]) -> dict[str, Any]:
    """A whole schema: ``generated``, with the id ``urn:automcm:`` and this name."""
    for definition in generated["$defs"].values():
        definition.pop("title", None)
    about = {"$schema": GenerateJsonSchema.schema_dialect, "$id": f"urn:automcm:{name}"}
    return about | {"title": title} | generated


def text(schema: dict[str, Any]) -> str:
    """A schema as committed: keys sorted, indented by two, a newline at the end."""
    return json.dumps(schema, indent=2, sort_keys=True) + "\n"


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


def messages() -> dict[str, Any]:
    """The JSON Schema of a message.

    What it cannot say stays with ``decode``: that 1.0 is no integer, how deep ``details`` may
    nest, and how many bytes a message may have.
    """
    generated = MESSAGE.json_schema(schema_generator=Generator)
    for name, definition in generated["$defs"].items():
        if "dst" in definition.get("required", ()):
            definition["required"].remove("dst")  # a broadcast has none
        if name in _forms():
            definition["oneOf"] = _forms()[name]
    return document("message:1", "A message of AutoMCM, version 1, or a CAM", generated)


if __name__ == "__main__":
    print(text(messages()), end="")
