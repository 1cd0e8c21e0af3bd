"""The JSON Schema of the lines between kit and adapter, for those who write adapters.

``python -m automcm_conformance.adapter_schema`` prints it as it is committed in
``conformance/adapter-1.schema.json``.
"""

from __future__ import annotations

import json
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, models_json_schema
from pydantic_core import core_schema

from automcm_conformance import protocol

COMMANDS: tuple[type[BaseModel], ...] = (
    protocol.Hello,
    protocol.Reset,
    protocol.Receive,
    protocol.CommandLine,
    protocol.Advance,
    protocol.Restart,
    protocol.Durations,
    protocol.Stop,
)
ANSWERS: tuple[type[BaseModel], ...] = (
    protocol.HelloAnswer,
    protocol.Answer,
    protocol.ErrorAnswer,
)


class _Generator(GenerateJsonSchema):
    """Pydantic's schema without titles, and with absent where Python has None as default."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = self.generate_inner(schema["schema"])
        if schema["default"] is None:
            [inner] = [each for each in inner["anyOf"] if each != {"type": "null"}]
        return inner

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        union = super().tagged_union_schema(schema)
        union.pop("discriminator", None)  # OpenAPI, not JSON Schema
        return union


def schema() -> dict[str, Any]:
    """The JSON Schema of a line.

    What it cannot say: that 1.0 is no integer, which answer belongs to which command, and what a
    message holds (messages.schema.json).
    """
    models = [(model, "validation") for model in (*COMMANDS, *ANSWERS)]
    _, generated = models_json_schema(models, schema_generator=_Generator)  # type: ignore[arg-type]
    for definition in generated["$defs"].values():
        definition.pop("title", None)
    return {
        "$schema": GenerateJsonSchema.schema_dialect,
        "$id": f"urn:automcm:adapter:{protocol.PROTOCOL}",
        "title": f"One line of the adapter protocol, version {protocol.PROTOCOL}",
        "oneOf": [
            {"description": "What the kit writes.", "oneOf": [_reference(m) for m in COMMANDS]},
            {"description": "What the adapter writes.", "oneOf": [_reference(m) for m in ANSWERS]},
        ],
        **generated,
    }


def schema_text() -> str:
    """The schema as committed: keys sorted, indented by two, a newline at the end."""
    return json.dumps(schema(), indent=2, sort_keys=True) + "\n"


def _reference(model: type[BaseModel]) -> dict[str, str]:
    return {"$ref": f"#/$defs/{model.__name__}"}


if __name__ == "__main__":
    print(schema_text(), end="")
