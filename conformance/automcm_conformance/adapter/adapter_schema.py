"""The JSON Schema of the lines between kit and adapter, for those who write adapters.

``python -m automcm_conformance.adapter.adapter_schema`` prints it as it is committed in
``conformance/adapter-1.schema.json``.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from automcm_conformance.adapter import protocol
from automcm_spec.vocabulary.json_schema import Generator, document, text

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


def schema() -> dict[str, Any]:
    """The JSON Schema of a line.

    What it cannot say: that 1.0 is no integer, which answer belongs to which command, and what a
    message holds (messages.schema.json).
    """
    models = [(model, "validation") for model in (*COMMANDS, *ANSWERS)]
    _, generated = models_json_schema(models, schema_generator=Generator)  # type: ignore[arg-type]
    generated["oneOf"] = [
        {"description": "What the kit writes.", "oneOf": [_reference(m) for m in COMMANDS]},
        {"description": "What the adapter writes.", "oneOf": [_reference(m) for m in ANSWERS]},
    ]
    title = f"One line of the adapter protocol, version {protocol.PROTOCOL}"
    return document(f"adapter:{protocol.PROTOCOL}", title, generated)


def _reference(model: type[BaseModel]) -> dict[str, str]:
    return {"$ref": f"#/$defs/{model.__name__}"}


if __name__ == "__main__":
    print(text(schema()), end="")
