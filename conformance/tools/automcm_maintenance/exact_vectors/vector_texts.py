"""The texts of the files of test vectors, with the expected outputs from ``exact_kernels``."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from pydantic.json_schema import GenerateJsonSchema

from automcm_conformance.adapter import kit_paths
from automcm_conformance.vectors.vector_validation import FILE
from automcm_conformance.vectors.vectors import SCHEMA, SECURED, Json, checked, paths, read
from automcm_maintenance.exact_vectors import exact_kernels
from automcm_spec.vocabulary import json_schema


def texts() -> dict[Path, str]:
    """The texts of the files, with expected outputs from exact_kernels.

    Raises VectorError for a file with invalid inputs.
    """
    made = {kit_paths.VECTORS / SCHEMA: schema()}
    for path in paths():
        file = read(path)
        if path.stem in SECURED:
            made[path] = text(checked(path, file))
            continue
        with suppress(KeyError, TypeError):  # ``checked`` reports missing fields
            for vector in file["vectors"]:
                vector["expected"] = {"error": {"name": "none", "why": "not known yet"}}
        checked(path, file)
        for vector in file["vectors"]:
            vector["expected"] = exact_kernels.call(file["kernel"], vector["inputs"])
        made[path] = text(checked(path, file))
    return made


def text(file: Json) -> str:
    """The text of a file: JSON with one field of a vector on each line."""

    def line(value: Json) -> str:
        return json.dumps(value, ensure_ascii=False, allow_nan=False)

    def block(value: dict[str, Json], indent: str) -> str:
        if not value:
            return "{}"
        rows = ",\n".join(f"{indent}  {line(name)}: {line(value[name])}" for name in value)
        return f"{{\n{rows}\n{indent}}}"

    head = [f"  {line(name)}: {line(file[name])}" for name in ("schema", "kernel", "rule")]
    head += [f"  {line(name)}: {block(file[name], '  ')}" for name in ("units", "tolerance")]
    head += [f"  {line('bugs')}: {block(dict(sorted(file['bugs'].items())), '  ')}"]
    fields = ("id", "purpose", "bug", "inputs", "expected")
    rows = ",\n".join(
        "    " + block({name: vector[name] for name in fields}, "    ")
        for vector in file["vectors"]
    )
    return "{\n" + ",\n".join(head) + f',\n  "vectors": [\n{rows}\n  ]\n}}\n'


class _WithDefaults(json_schema.Generator):
    field_is_required = GenerateJsonSchema.field_is_required
    default_schema = GenerateJsonSchema.default_schema


def schema() -> str:
    """The JSON Schema of the files.

    Only ``load`` checks that ids are unique and that bugs are in the table.
    """
    generated = FILE.json_schema(schema_generator=_WithDefaults)
    title = "Test vectors of AutoMCM, version 1"
    return json_schema.text(json_schema.document("vectors:1", title, generated))
