"""The compiled station is the compiler's output, in every process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from automcm_maintenance.compilation import compiler
from automcm_spec.support.paths import TLA


@pytest.mark.slow
def test_the_committed_station_is_what_would_be_generated(open_xml: bytes) -> None:
    assert compiler.PATH.read_text() == compiler.text(xml=open_xml)


@pytest.mark.slow
def test_it_is_the_same_in_every_process(open_xml: bytes, tmp_path: Path) -> None:
    (tmp_path / "open.xml").write_bytes(open_xml)
    code = (
        "import sys; from automcm_maintenance.compilation import compiler; "
        "from automcm_spec.support import paths; "
        "xml = open(sys.argv[1], 'rb').read(); "
        "print(compiler.source(compiler.PLAN, xml, paths.TLA), end='')"
    )
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "open.xml")],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == compiler.source(compiler.PLAN, open_xml, TLA)
