"""The pytest plugin: ``pytest --automcm-adapter CMD`` makes a test of each case of the suite.

pytest imports this module in whatever it runs, before coverage is measured.  So it imports nothing;
what there is to do is in ``pytest_cases``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options ``--automcm-…``, each with a setting of the same name."""
    group = parser.getgroup("automcm", "AutoMCM conformance")
    texts = {
        "adapter": ("CMD", "command of the adapter; the suite's cases become tests"),
        "expect": ("FILE", "file of known deviations"),
        "out": ("FOLDER", "where the report goes; by default runs/<time>"),
        "limit": ("SECONDS", "real time that an answer may take; by default 10"),
        "seed": ("N", "for what is random in the station; by default 1"),
    }
    for name, (metavar, text) in texts.items():
        group.addoption(f"--automcm-{name}", metavar=metavar, help=text)
        parser.addini(f"automcm_{name}", text, "string", default="")
    text = "cases of this id or beginning, rule or level alone; may be repeated"
    group.addoption("--automcm-select", action="append", metavar="SELECTOR", help=text)
    parser.addini("automcm_select", text, "args", default=[])


def pytest_configure(config: pytest.Config) -> None:
    """Adds the cases if an adapter is named."""
    if config.getoption("automcm_adapter") or config.getini("automcm_adapter"):
        import pytest

        from automcm_spec.support.extras import kit_missing

        if missing := kit_missing():
            raise pytest.UsageError(f"--automcm-adapter {missing}")
        from automcm_conformance.report.pytest_cases import Cases

        config.pluginmanager.register(Cases(config), "automcm-cases")
