"""The properties bite: each fault of the catalogue must fail a property of its kernel."""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Callable, Iterator

import pytest
from hypothesis import Phase, settings

from automcm_maintenance.code_mutation import faults

FAULTS = faults.load("kernels")
QUICK = settings(
    max_examples=1000, database=None, phases=[Phase.explicit, Phase.generate], deadline=None
)


@pytest.fixture(scope="module")
def quick() -> Iterator[None]:
    """Imports the tests anew, to fail without looking for a smaller example."""
    names = [f"test_trajectory_{each}" for each in ("convert", "thin", "collide", "extents",
                                                     "discover", "prescribe", "curves",
                                                     "success")]  # fmt: skip
    for name in names:
        sys.modules.pop(name, None)
    before = settings.get_current_profile_name()
    settings.register_profile("mutants", QUICK)
    settings.load_profile("mutants")
    for name in names:
        importlib.import_module(name)
    settings.load_profile(before)
    yield
    for name in names:
        sys.modules.pop(name, None)


@pytest.mark.sweep(6)
@pytest.mark.parametrize("name", FAULTS)
def test_is_caught(name: str, quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    fault = FAULTS[name]
    module = sys.modules[f"test_trajectory_{fault.notice['tests']}"]
    checks: list[Callable[..., None]] = [
        check
        for name, check in vars(module).items()
        if name.startswith("test_") and any(part in name for part in fault.notice["parts"])
    ]
    assert checks
    with faults.put(fault):
        assert any(_fails(check, monkeypatch) for check in checks), f"{fault} passes"


def _fails(check: Callable[..., None], monkeypatch: pytest.MonkeyPatch) -> bool:
    with monkeypatch.context() as patched:
        arguments = [patched] if "monkeypatch" in inspect.signature(check).parameters else []
        try:
            check(*arguments)
        except (AssertionError, ValueError, IndexError, FloatingPointError):
            return True
        except (pytest.fail.Exception, BaseExceptionGroup):
            return True
    return False
