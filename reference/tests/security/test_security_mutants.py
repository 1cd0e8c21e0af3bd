"""The checks bite: each fault of the catalogue must fail a test of the verifier."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import test_security_limits as limits
import test_security_verifier as checks

from automcm_maintenance.code_mutation import faults

FAULTS = faults.load("security")
SLOW = ("hundreds", "changed_byte")
TESTS = [
    each
    for module in (checks, limits)
    for name, each in vars(module).items()
    if name.startswith("test_")
]
TESTS.sort(key=lambda each: any(part in each.__name__ for part in SLOW))


@pytest.mark.sweep(8)
@pytest.mark.parametrize("name", FAULTS)
def test_is_caught(name: str) -> None:
    with faults.put(FAULTS[name]):
        assert any(_fails(test) for test in TESTS), "passes every test"


def _fails(test: Callable[[], None]) -> bool:
    try:
        test()
    except Exception:
        return True
    return False


@pytest.mark.slow
def test_without_a_fault_every_test_passes() -> None:
    assert not [test.__name__ for test in TESTS if _fails(test)]
