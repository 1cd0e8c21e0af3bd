"""SANY's XML and a graph, once for all tests; compiled code as a module."""

import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

from automcm_spec.graph import oracle, oracle_generation


@pytest.fixture(scope="session")
def open_xml() -> bytes:
    """SANY's XML of OpenStation."""
    from automcm_maintenance.compilation import compiler, sany  # not in every run of pytest

    return sany.export(compiler.PLAN.module)


@pytest.fixture(scope="session")
def one_peer() -> oracle.Oracle:
    return oracle.load(oracle_generation.ONE_PEER.path, oracle_generation.spec_hash())


@pytest.fixture
def load(tmp_path: Path) -> Iterator[Callable[[str], ModuleType]]:
    """Loads Python code as a module."""
    names: list[str] = []

    def loaded(code: str) -> ModuleType:
        path = tmp_path / f"compiled_{len(names)}.py"
        path.write_text(code, encoding="utf-8")
        spec = importlib.util.spec_from_file_location(f"{tmp_path.name}_{len(names)}", path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        names.append(module.__name__)
        sys.modules[module.__name__] = module
        spec.loader.exec_module(module)
        return module

    yield loaded
    for name in names:
        del sys.modules[name]
