"""The test vectors: each catches the bug it names; test_vectors.py has all with the reference."""

from __future__ import annotations

import json

import pytest

from automcm_cli.reference import vector_adapter
from automcm_conformance.vectors import vectors
from automcm_maintenance.code_mutation import faults
from automcm_maintenance.exact_vectors import exact_kernels

BUGS = {
    vector["id"]: vector["bug"]
    for path in vectors.paths()
    for vector in json.loads(path.read_text())["vectors"]
}
CASES = [case for path in vectors.paths() for case in vectors.load(path)]
FAULTS = faults.load("vectors")


@pytest.mark.sweep(200)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_every_vector_catches_the_bug_it_names(case: vectors.Case) -> None:
    secured = case.kernel in vectors.SECURED
    with faults.put(FAULTS[f"{case.kernel}/{BUGS[case.id]}"]):
        [result] = vectors.check(vector_adapter.call if secured else exact_kernels.call, [case])
    assert not result.ok


def test_no_bug_is_left_without_a_vector() -> None:
    assert set(FAULTS) == {f"{case.kernel}/{BUGS[case.id]}" for case in CASES}
