"""The texts of the files of test vectors, with the expected outputs from ``exact_kernels``."""

from __future__ import annotations

import json
from pathlib import Path

from automcm_conformance.vectors.vectors import SECURED, Json, paths
from automcm_maintenance.exact_vectors import exact_kernels


def texts() -> dict[Path, str]:
    """The texts of the files, with expected outputs from exact_kernels."""
    made = {}
    for path in paths():
        file = json.loads(path.read_text(encoding="utf-8"))
        for vector in file["vectors"] if path.stem not in SECURED else ():
            vector["expected"] = exact_kernels.call(file["kernel"], vector["inputs"])
        made[path] = text(file)
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
