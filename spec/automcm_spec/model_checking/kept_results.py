"""Keeps results of TLC from run to run, each with a hash of everything that it depends on.

A file contains a hash of the dependencies and the result, then the result. So a damaged file, a
file of another code version and a file of another specification are all treated as missing.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from automcm_spec.model_checking import model_runs, models, tla_values, tlc, toolchain
from automcm_spec.support import files
from automcm_spec.support.paths import TLA

CODE = (models, model_runs, tlc, toolchain, tla_values, sys.modules[__name__])
"""The code that starts TLC with its options, interprets its output, and keeps its results."""


def check_all(
    chosen: Sequence[models.Model],
    folder: Path,
    *,
    fresh: bool = False,
    on_done: Callable[[models.ModelVerdict], None],
    tla_dir: Path = TLA,
    stop: tlc.TlcStop | None = None,
) -> None:
    """As ``model_runs.check_all``, but models with a kept result are not run.

    ``fresh`` runs them too. An expected result is kept under the key computed before TLC started,
    and only if the key is unchanged at the end, because TLC may have read either version. Results
    that cannot be written are not kept.
    """
    keys = {model.cfg: _key(model, tla_dir) for model in chosen}
    rest = []
    for model in chosen:
        verdict = None if fresh else _read(model, keys[model.cfg], folder)
        if verdict is None:
            rest.append(model)
        else:
            on_done(verdict)

    def done(verdict: models.ModelVerdict) -> None:
        key = keys[verdict.model.cfg]
        if verdict.ok and key is not None and key == _key(verdict.model, tla_dir):
            with suppress(OSError):
                _write(verdict, key, folder)
        on_done(verdict)

    model_runs.check_all(rest, on_done=done, tla_dir=tla_dir, stop=stop)


def _key(model: models.Model, tla_dir: Path) -> str | None:
    """The hash of everything that the result of a model depends on: its entry in the list with
    its cfg, each module that TLC reads, TLC, Java, Java's options in the environment, and our code.

    None if any of these cannot be read: then nothing is kept, and the run reports the error.
    """
    try:
        java, jar = tlc.tools()
        texts = {path.stem: path.read_bytes().decode() for path in tla_dir.glob("*.tla")}
        return _hash(
            model.model_dump(),
            {name: texts[name] for name in models.extended(model.module, texts, instances=True)},
            _digest(jar),
            _digest(java.parent.parent / "release"),
            {name: value for name, value in toolchain.environment().items() if "JAVA" in name},
            [inspect.getsource(module) for module in CODE],
        )
    except (OSError, ValueError, tlc.TlcError):
        return None


def _path(folder: Path, model: models.Model) -> Path:
    return folder / f"{model.cfg}.result"


def _read(model: models.Model, key: str | None, folder: Path) -> models.ModelVerdict | None:
    """The verdict of the result kept under this key, judged again; None if there is none."""
    try:
        digest, text = _path(folder, model).read_bytes().decode().split("\n", 1)
    except (OSError, ValueError):
        return None
    if key is None or digest != _hash(key, text):
        return None
    found = json.loads(text)
    trace = tuple(tlc.TraceState(*state) for state in found["trace"])
    result = tlc.TlcResult(**(found["result"] | {"trace": trace}))
    verdict = models.judged(model, result, found["reached"])
    return replace(verdict, kept=True) if verdict.ok else None


def _write(verdict: models.ModelVerdict, key: str, folder: Path) -> None:
    assert verdict.result is not None
    trace = [(state.index, state.action, state.text) for state in verdict.trace]
    result = asdict(replace(verdict.result, trace=()))
    text = json.dumps({"reached": verdict.reached, "result": result, "trace": trace})
    folder.mkdir(parents=True, exist_ok=True)
    files.write(_path(folder, verdict.model), f"{_hash(key, text)}\n{text}")


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _hash(*parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
