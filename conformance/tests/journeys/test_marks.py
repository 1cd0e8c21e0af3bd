"""The marks of the test suite: which cases of a sweep are quick."""

from __future__ import annotations

import pytest

pytest_plugins = ["pytester"]


def test_of_a_sweep_n_cases_are_quick_evenly_spread(
    pytester: pytest.Pytester, request: pytest.FixtureRequest
) -> None:
    root = request.config.rootpath
    pytester.makeconftest((root / "conftest.py").read_text())
    pytester.makeini("[pytest]\nmarkers =\n    sweep\n    slow\n    deep\n")
    pytester.makepyfile("""
        import pytest

        @pytest.mark.sweep(3)
        @pytest.mark.parametrize("n", range(7))
        def test_swept(n): pass

        @pytest.mark.sweep(5)
        @pytest.mark.parametrize("n", range(2))
        def test_few(n): pass
    """)
    names = ("test_swept[0]", "test_swept[2]", "test_swept[4]", "test_few[0]", "test_few[1]")
    for marked, wanted in (("not slow", 5), ("slow", 4)):
        found = pytester.inline_run("-m", marked, "-p", "no:xdist").listoutcomes()[0]
        assert len(found) == wanted
        quick = {report.nodeid.partition("::")[2] for report in found} & set(names)
        assert len(quick) == (5 if marked == "not slow" else 0)
