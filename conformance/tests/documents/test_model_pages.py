"""Counterexamples as pages: the committed ones, the links to them, and the check by verify."""

from __future__ import annotations

import re
from pathlib import Path

from automcm_maintenance.documents import built_pages, counterexample_pages, generated_files
from automcm_spec.model_checking import models

FAILING = [m for m in models.load() if m.expect == "violates"]
MUST_FAIL = [m for m in FAILING if m.module not in models.ALONE]
ALONE = [m for m in FAILING if m.module in models.ALONE]
PAGE = built_pages.models_page(models.load())
HOLD = [model for model in models.load() if model.expect == "holds"]


def test_docs_models_links_to_a_page_for_each_model_that_must_fail_and_can_have_one() -> None:
    links = re.findall(r"\(counterexamples/(\w+)\.html\)", PAGE)
    assert links == [model.cfg for model in MUST_FAIL]
    assert all((generated_files.COUNTEREXAMPLES / f"{cfg}.itf.json").exists() for cfg in links)


def test_docs_models_names_what_each_model_changes() -> None:
    table = PAGE.split("## Must fail")[1]
    rows = re.findall(r"^\| \[?`(\w+)`[^|]*\|[^|]*\| ([^|]*?) ?\|", table, re.MULTILINE)
    changed = dict(rows)
    assert list(changed) == [m.cfg for m in models.load() if m.expect == "violates"]
    assert changed["retarget"] == "`NextTarget`" and changed["no_hold"] == "`timer hold`"
    only_constants = {name for name, changes in rows if not changes}
    with_keys = {m.cfg for m in MUST_FAIL if m.module in models.ATTACKED}
    assert only_constants - with_keys == {"drift_no_margin", "cam_loss_too_short"}


def test_a_page_shows_its_counterexample(tmp_path: Path) -> None:
    wanted = [model for model in MUST_FAIL if model.cfg == "bare_ack"]
    [page] = counterexample_pages.committed([*wanted, *HOLD, *ALONE], tmp_path / "new")
    assert page == tmp_path / "new" / "bare_ack.html"
    assert "<title>bare_ack, counterexample found by TLC" in page.read_text()
