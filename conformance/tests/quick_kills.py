"""How many of the faults that the whole test suite finds does the quick set find?

    python conformance/tests/quick_kills.py [--of source] [--count 80] [--seed 1] [--only PACKAGE]

Makes faults, one at a time, in a copy of the repository:

source  small changes of the packages' source (``source_edits``);
seeded  the bugs of the catalogue ``seeded``, all of which a slow test finds;
spec    mutants of Station.tla (``automcm spec mutate``), compiled into station.py.

Quick tests run first: of the files that import the module, then of those that import one of its
users.  A fault in the source that they do not find goes to the slow tests of the files that import
the module; only if one of these finds it, the rest of the quick set runs too.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import cache_from_source
from itertools import islice
from pathlib import Path
from shutil import copytree

from copied_tree import FOLDERS, ROOT, copied

from automcm_maintenance.code_mutation import faults as fault_catalogue
from automcm_maintenance.code_mutation.source_mutants import SourceMutant, hash_of, of_file
from automcm_maintenance.compilation import compiler, sany
from automcm_maintenance.documents.repository import SOURCES
from automcm_maintenance.spec_mutation import mutants
from automcm_spec.model_checking import tlc
from automcm_spec.model_checking.toolchain import ToolError
from automcm_spec.support.paths import TLA

QUICK, SLOW = "not slow and not deep", "slow and not deep"
LIMIT_S = 300
FEW = 8
"""Test files that are not worth a second process."""
PASSED, NO_TESTS = 0, 5
FRESH = (
    "spec/tests/compilation/test_compiler.py::test_the_committed_station_is_what_would_be_generated"
)
CATALOGUES = (
    "conformance/tests/code_mutation/test_faults.py",
    "conformance/tests/vectors/test_vectors_bugs.py::test_every_vector_catches_the_bug_it_names",
    "reference/tests/journeys/test_stateful.py::test_a_seeded_bug_is_found",
    "reference/tests/kernels/test_trajectory_mutants.py",
    "reference/tests/security/test_security_mutants.py",
)
"""Tests of the catalogues: an entry whose text a fault has changed fails, which is no kill."""
TIME = "time"


def modules(only: str) -> list[Path]:
    """The product's modules, except generated ones."""
    return [
        path
        for package, folder in SOURCES.items()
        if only in ("", package)
        for path in sorted(folder.rglob("*.py"))
        if path.name != "__init__.py"
        and "templates" not in path.parts
        and "Generated:" not in path.read_text(encoding="utf-8")[:200]
    ]


Order = Callable[[str], str]


def drawn(paths: Sequence[Path], order: Order) -> Iterator[tuple[Path, SourceMutant]]:
    """One fault of each module, then another, in ``order``."""
    turn = 0
    while turn < 1000:
        for path in sorted(paths, key=lambda path: order(str(path.relative_to(ROOT)))):
            mutants = sorted(of_file(path), key=lambda mutant: order(mutant.id))
            if turn < len(mutants):
                yield path, mutants[turn]
        turn += 1


@cache
def imported(file: Path) -> frozenset[str]:
    """The last names of all modules that a file imports; of a test, also those of its helpers."""
    names: set[str] = set()
    files = [file]
    for each in files:
        new: set[str] = set()
        for node in ast.walk(ast.parse(each.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                new |= {alias.name.rpartition(".")[2] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                new |= {(node.module or "").rpartition(".")[2], *(a.name for a in node.names)}
        if file.parent.name == "tests":
            helpers = [file.parent / f"{name}.py" for name in sorted(new - names)]
            files += [helper for helper in helpers if helper.exists()]
        names |= new
    return frozenset(names)


@dataclass(frozen=True, slots=True)
class Fault:
    """Modules with other contents; tests are chosen for the first of them."""

    name: str
    texts: dict[Path, str]


def faults(kind: str, only: str, seed: int) -> Iterator[Fault]:
    """All faults of a kind, in an order drawn by a hash."""

    def order(text: str) -> str:
        return hash_of(f"{seed} {text}")

    if kind == "source":
        for path, mutant in drawn(modules(only), order):
            name = f"{mutant.file}:{mutant.line} {mutant.old}  =>  {mutant.new}"
            yield Fault(name, {path: mutant.source})
    elif kind == "seeded":
        bugs = fault_catalogue.load("seeded")
        for name in sorted(bugs, key=order):
            yield Fault(name, bugs[name].texts())
    else:
        for edit in sorted(mutants.generate(modules=["Station"]), key=lambda m: order(m.id)):
            with tempfile.TemporaryDirectory() as folder:
                tla = Path(copytree(TLA, Path(folder) / "tla"))
                module = tla / "Station.tla"
                module.write_bytes(edit.apply(module.read_bytes()))
                try:
                    source = compiler.text(tla)
                except (sany.NotCompiled, tlc.TlcError, ToolError) as error:
                    print(f"left out, does not compile: {edit.id}: {error}", flush=True)
                    continue
            if source != compiler.PATH.read_text(encoding="utf-8"):
                yield Fault(f"{edit.id} {edit.change}", {compiler.PATH: source})


class Suite:
    """The test suite in a copy of the repository."""

    def __init__(self, root: Path) -> None:
        self.root = copied(root)
        self.files = [
            path.relative_to(ROOT)
            for f in FOLDERS
            for path in sorted((ROOT / f / "tests").rglob("test_*.py"))
        ]
        self.left_out = [FRESH, *CATALOGUES]
        """Tests that fail without a fault, and the one that compares station.py as a text."""
        self.sound: set[str] = set()
        """Tests that pass without a fault."""

    def replace(self, texts: dict[Path, str]) -> None:
        """Write modules; a compiled file may have the same second and size."""
        for path, text in texts.items():
            target = self.root / path.relative_to(ROOT)
            target.write_text(text, encoding="utf-8")
            Path(cache_from_source(str(target))).unlink(missing_ok=True)

    def failure(self, files: Sequence[Path], marked: str, *options: str) -> str:
        """The first test that fails; empty if none does."""
        files = [file for file in files if str(file) not in self.left_out]
        if not files:
            return ""
        words = ["-m", "pytest", "-x", "-q", "-rfE", "-p", "no:cacheprovider", "-m", marked]
        words += options
        words += ["-n", "2", "--dist", "worksteal"] * (len(files) > FEW)
        words += [f"--deselect={test}" for test in self.left_out]
        paths = [self.root / folder for folder in FOLDERS]
        if marked == QUICK:
            words.append("--hypothesis-profile=quick")
        process = subprocess.Popen(
            [sys.executable, *words, *map(str, files)],
            cwd=self.root,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return TIME
        if process.returncode in (PASSED, NO_TESTS):
            return ""
        failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", output, re.MULTILINE)
        return failed[1] if failed else output[-300:]

    def found(self, fault: Fault, known: bool) -> tuple[str, str]:
        """What finds the fault: of the quick set, else of the slow tests near it.

        ``known``: something else than the quick set finds it.
        """
        path = next(iter(fault.texts))
        users = {path.stem, *(each.stem for each in modules("") if path.stem in imported(each))}
        direct = [
            file
            for file in self.files
            if path.stem in imported(ROOT / file) or path.stem in file.stem
        ]
        folder = "" if direct else path.relative_to(ROOT).parts[0]
        near = [
            file
            for file in self.files
            if file not in direct and (users & imported(ROOT / file) or file.parts[0] == folder)
        ]
        far = [file for file in self.files if file not in (*direct, *near)]
        quick = self.killer(fault, direct, QUICK) or self.killer(fault, near, QUICK)
        if quick:
            return quick, ""
        slow = "known" if known else self.killer(fault, direct or near, SLOW)
        if slow in ("", TIME):
            return "", ""
        return self.killer(fault, far, QUICK), slow

    def killer(self, fault: Fault, files: Sequence[Path], marked: str) -> str:
        """The first of these tests that fails with the fault, and without it does not."""
        while True:
            self.replace(fault.texts)
            try:
                test = self.failure(files, marked)
            finally:
                self.replace({path: path.read_text(encoding="utf-8") for path in fault.texts})
            file = Path(test.partition("::")[0])
            if file not in self.files or test in self.sound:
                return test
            if not self.failure([file], "not deep", f"-k={test.partition('::')[2].split('[')[0]}"):
                self.sound.add(test)
                return test
            print(f"left out, fails without a fault: {test}", flush=True)
            self.left_out.append(test)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--of", default="source", choices=["source", "seeded", "spec"])
    parser.add_argument("--count", type=int, default=80)
    parser.add_argument("--skip", type=int, default=0, help="skip this many faults")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", choices=["", *SOURCES])
    chosen = parser.parse_args()
    quick: list[str] = []
    slow: list[str] = []
    neither: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        suite = Suite(Path(folder) / "copy")
        drawn_faults = faults(chosen.of, chosen.only, chosen.seed)
        for fault in islice(drawn_faults, chosen.skip, chosen.skip + chosen.count):
            begun = time.monotonic()
            by = suite.found(fault, chosen.of != "source")
            name = fault.name
            (quick if by[0] else slow if by[1] else neither).append(name)
            how = f"quick: {by[0]}" if by[0] else f"SLOW: {by[1]}" if by[1] else "nothing"
            print(f"{time.monotonic() - begun:4.0f} s  {name}\n    {how}", flush=True)
    whole = len(quick) + len(slow)
    share = 100 * len(quick) / max(whole, 1)
    print(
        f"\n{whole + len(neither)} faults; the quick set, or a slow test near one, finds {whole};"
    )
    print(f"the quick set alone {len(quick)} of these ({share:.1f} %)")
    for name in slow:
        print(f"only slow tests find: {name}")
    sys.exit(len(quick) < 0.95 * whole)


if __name__ == "__main__":
    main()
