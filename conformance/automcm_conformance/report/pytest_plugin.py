"""The pytest plugin: with ``pytest --automcm-adapter CMD`` each case of the suite is a test.

pytest imports this module in every run, before coverage is measured.  So it imports nothing; the
work is done in ``pytest_cases``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options ``--automcm-...`` and a setting of the same name for each."""
    group = parser.getgroup("automcm", "AutoMCM conformance")
    texts = {
        "adapter": ("CMD", "command of the adapter; the suite's cases become tests"),
        "expect": ("FILE", "file of known deviations"),
        "out": ("FOLDER", "folder of the report; default: runs/<time>"),
        "limit": ("SECONDS", "real time that an answer may take; default: 10"),
        "seed": ("N", "seed of the station's random numbers; default: 1"),
    }
    for name, (metavar, text) in texts.items():
        group.addoption(f"--automcm-{name}", metavar=metavar, help=text)
        parser.addini(f"automcm_{name}", text, "string", default="")
    text = "run only cases with this id, prefix of an id, rule or level; may be repeated"
    group.addoption("--automcm-select", action="append", metavar="SELECTOR", help=text)
    parser.addini("automcm_select", text, "args", default=[])


def pytest_configure(config: pytest.Config) -> None:
    """Add the cases if an adapter is given."""
    if config.getoption("automcm_adapter") or config.getini("automcm_adapter"):
        import pytest

        from automcm_spec.support.extras import missing

        if lacks := missing("kit"):
            raise pytest.UsageError(f"--automcm-adapter {lacks}")
        from automcm_conformance.report.pytest_cases import Cases

        config.pluginmanager.register(Cases(config), "automcm-cases")
