"""Stations of the tests start as forks."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def _stations_are_forked() -> Iterator[None]:
    from forked_station import children, forked

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(children, "popen", forked)
        yield
