"""The JSON Schema of the lines between kit and adapter, for authors of adapters.

``python -m automcm_conformance.adapter.adapter_schema`` prints the text of
``conformance/adapter-1.schema.json``.
"""

from __future__ import annotations

from typing import Any, get_args

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from automcm_conformance.adapter import protocol
from automcm_spec.vocabulary.json_schema import Generator, document, text

COMMANDS: tuple[type[BaseModel], ...] = get_args(get_args(protocol.Command)[0])
ANSWERS = (protocol.HelloAnswer, protocol.Answer, protocol.ErrorAnswer)


def schema() -> dict[str, Any]:
    """The JSON Schema of a line.

    It does not state that 1.0 is not an integer, which answer belongs to which command, or which
    fields a message has (messages.schema.json).
    """
    models = [(model, "validation") for model in (*COMMANDS, *ANSWERS)]
    _, generated = models_json_schema(models, schema_generator=Generator)  # type: ignore[arg-type]
    generated["oneOf"] = [
        {"description": "A line from the kit.", "oneOf": [_reference(m) for m in COMMANDS]},
        {"description": "A line from the adapter.", "oneOf": [_reference(m) for m in ANSWERS]},
    ]
    title = f"One line of the adapter protocol, version {protocol.PROTOCOL}"
    return document(f"adapter:{protocol.PROTOCOL}", title, generated)


def _reference(model: type[BaseModel]) -> dict[str, str]:
    return {"$ref": f"#/$defs/{model.__name__}"}


if __name__ == "__main__":
    print(text(schema()), end="")
