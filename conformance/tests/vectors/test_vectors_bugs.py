"""The test vectors: each catches the bug it names, and the reference agrees with all.

The bugs of those for signed messages are in test_secured_vectors.
"""

from __future__ import annotations

import json

import pytest
from vector_bugs import CASES, MUTATIONS, mutated

from automcm_cli.reference import vector_adapter
from automcm_conformance.vectors import vectors

BUGS = {
    vector["id"]: vector["bug"]
    for path in vectors.paths()
    for vector in json.loads(path.read_text())["vectors"]
}


EXACT = [case for case in CASES if case.kernel not in vectors.SECURED]


@pytest.mark.sweep(90)
@pytest.mark.parametrize("case", EXACT, ids=lambda case: case.id)
def test_every_vector_catches_the_bug_it_names(case: vectors.Case) -> None:
    [result] = vectors.check(mutated(case.kernel, BUGS[case.id]), [case])
    assert not result.ok


def test_no_mutation_is_left_without_a_vector() -> None:
    for kernel, bugs in MUTATIONS.items():
        assert set(bugs) == {BUGS[case.id] for case in CASES if case.kernel == kernel}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_the_reference_agrees(case: vectors.Case) -> None:
    [result] = vectors.check(vector_adapter.call, [case])
    assert result.ok, result.problem


def test_at_least_fifteen_of_each_kernel_with_errors_among_them() -> None:
    for kernel in vectors.KERNELS:
        mine = [case for case in CASES if case.kernel == kernel]
        assert len(mine) >= 15
        assert kernel == "envelope" or any("error" in case.expected for case in mine)
