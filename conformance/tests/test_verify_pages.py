"""What ``automcm verify`` finds to fail is there to look at."""

from dataclasses import replace
from pathlib import Path

from automcm_cli import verify_pages
from automcm_spec import models


def test_a_counterexample_that_should_not_be_is_a_page(tmp_path: Path) -> None:
    (model,) = [m for m in models.load() if m.cfg == "ack_from_anybody"]
    found = models.check(model)
    assert found.trace and verify_pages.write([found], tmp_path) == []  # it must fail
    wrong = replace(found, problem="it should hold")
    assert not wrong.ok
    (page,) = verify_pages.write([wrong], tmp_path)
    assert page == tmp_path / "ack_from_anybody.html"
    assert b"ack_from_anybody, as TLC found it" in page.read_bytes()
