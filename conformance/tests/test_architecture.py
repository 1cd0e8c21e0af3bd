"""Who may import whom, and what no committed file may hold."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from automcm_cli import imports
from automcm_cli.imports import Import

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def read() -> set[Import]:
    return imports.read(ROOT)


def test_who_imports_whom(read: set[Import]) -> None:
    assert imports.forbidden(read) == []
    assert {one.importer.split(".")[0] for one in read} == set(imports.PACKAGES)


def test_no_modules_load_one_another(read: set[Import]) -> None:
    assert imports.cycles(read) == []


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for package, folder in imports.PACKAGES.items():
        inner = tmp_path / folder / package
        inner.mkdir(parents=True)
        (inner / "__init__.py").write_text("")
    (tmp_path / "reference/automcm/links").mkdir()
    (tmp_path / "reference/automcm/links/__init__.py").write_text("")
    (tmp_path / "traces/automcm_traces/writer.py").write_text("x = 1\n")
    (tmp_path / "spec/automcm_spec/station.py").write_text("")
    (tmp_path / "spec/automcm_spec/messages.py").write_text("x = 1\n")
    return tmp_path


def test_what_counts_as_an_import(tree: Path) -> None:
    (tree / "reference/automcm/one.py").write_text(
        "from typing import TYPE_CHECKING\nimport json, automcm.two\n"
        "from automcm_traces.writer import x\nfrom automcm_traces import writer\n"
        "try:\n    from automcm import links\nexcept ImportError:\n    pass\n"
        "if TYPE_CHECKING:\n    import automcm_spec\n"
        "def late():\n    import automcm_conformance\n"
    )
    (tree / "reference/automcm/two.py").write_text("from automcm import __doc__ as doc\n")
    assert imports.read(tree) == {
        Import("automcm.one", "automcm.two", True),
        Import("automcm.one", "automcm_traces.writer", True),
        Import("automcm.one", "automcm.links", True),
        Import("automcm.one", "automcm_conformance", False),
        Import("automcm.two", "automcm", True),
    }
    assert imports.forbidden(imports.read(tree)) == [
        Import("automcm.one", "automcm_conformance", False)
    ]


@pytest.mark.parametrize(
    ("path", "line", "allowed"),
    [
        ("spec/automcm_spec/a.py", "import automcm_traces.writer", False),
        ("traces/automcm_traces/a.py", "import automcm_spec", True),
        ("traces/automcm_traces/a.py", "import automcm", False),
        ("reference/automcm/a.py", "import automcm_traces.writer", True),
        ("reference/automcm/adapter.py", "import automcm_spec.station", True),
        ("reference/automcm/station.py", "import automcm_spec.station", False),
        ("reference/automcm/links/a.py", "import automcm_traces", False),
        ("reference/automcm/links/a.py", "import automcm_spec", False),
        ("reference/automcm/links/a.py", "import automcm_spec.messages", True),
        ("conformance/automcm_conformance/a.py", "import automcm_traces", True),
        ("conformance/automcm_conformance/a.py", "from automcm import links", False),
        ("conformance/automcm_conformance/a.py", "import automcm_cli", False),
        ("conformance/automcm_cli/a.py", "import automcm.links", True),
    ],
)
def test_what_a_package_may_import(tree: Path, path: str, line: str, allowed: bool) -> None:
    (tree / path).write_text(line + "\n")
    assert (imports.forbidden(imports.read(tree)) == []) is allowed


def test_cycles_are_found_however_long_and_only_at_load(tree: Path) -> None:
    for name, text in {
        "a": "import automcm.b",
        "b": "import automcm.c, automcm.d",
        "c": "import automcm.a",
        "d": "def late():\n    import automcm.a",
    }.items():
        (tree / f"reference/automcm/{name}.py").write_text(text)
    assert imports.cycles(imports.read(tree)) == [["automcm.a", "automcm.b", "automcm.c"]]


def test_an_import_of_nothing_is_named(tree: Path) -> None:
    (tree / "reference/automcm/a.py").write_text("import automcm_spec.gone")
    with pytest.raises(ValueError, match=r"automcm\.a: imports automcm_spec\.gone"):
        imports.read(tree)


def test_the_map_names_every_folder_and_draws_what_is_imported(read: set[Import]) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text()
    for package, folder in imports.PACKAGES.items():
        assert f"`{package}`" in page and f"`{folder}/`" in page
    drawn = imports.picture(read)
    assert "automcm -->|automcm_traces.writer| automcm_traces" in drawn
    assert "automcm_conformance --> automcm\n" not in drawn


def test_no_file_names_a_registry_or_this_machine() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:
        pytest.skip("not a git checkout: the files of the repository are not known")
    forbidden = [b"py" + b"pi.org", b"python" + b"hosted", b"repo1." + b"maven", b"/ro" + b"ot/"]
    found = [
        (name, word)
        for name in listed.stdout.splitlines()
        if (ROOT / name).is_file()
        for word in forbidden
        if word in (ROOT / name).read_bytes()
    ]
    assert found == []
