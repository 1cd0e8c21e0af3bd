"""The permitted imports, and text that no committed file may contain."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import pytest

from automcm_maintenance.documents import import_graph
from automcm_maintenance.documents.import_graph import Import

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def read() -> set[Import]:
    return import_graph.read(ROOT)


def test_who_imports_whom(read: set[Import]) -> None:
    assert import_graph.forbidden(read) == []
    assert {one.importer.split(".")[0] for one in read} == set(import_graph.PACKAGES)


def test_no_modules_load_one_another(read: set[Import]) -> None:
    assert import_graph.cycles(read) == []


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for package, folder in import_graph.PACKAGES.items():
        inner = tmp_path / folder / package
        for layer in ("", *import_graph.LAYERS[package].split()):
            (inner / layer).mkdir(parents=True, exist_ok=True)
            (inner / layer / "__init__.py").write_text("")
    (tmp_path / "traces/automcm_traces/format/writer.py").write_text("x = 1\n")
    (tmp_path / "spec/automcm_spec/vocabulary/station.py").write_text("")
    (tmp_path / "spec/automcm_spec/vocabulary/messages.py").write_text("x = 1\n")
    return tmp_path


def test_what_counts_as_an_import(tree: Path) -> None:
    (tree / "reference/automcm/one.py").write_text(
        "from typing import TYPE_CHECKING\nimport json, automcm.two\n"
        "from automcm_traces.format.writer import x\nfrom automcm_traces.format import writer\n"
        "try:\n    from automcm import links\nexcept ImportError:\n    pass\n"
        "if TYPE_CHECKING:\n    import automcm_spec\n"
        "def late():\n    import automcm_conformance\n"
    )
    (tree / "reference/automcm/two.py").write_text("from automcm import __doc__ as doc\n")
    assert import_graph.read(tree) == {
        Import("automcm.one", "automcm.two", True),
        Import("automcm.one", "automcm_traces.format.writer", True),
        Import("automcm.one", "automcm.links", True),
        Import("automcm.one", "automcm_conformance", False),
        Import("automcm.two", "automcm", True),
    }
    assert import_graph.forbidden(import_graph.read(tree)) == [
        Import("automcm.one", "automcm_conformance", False)
    ]


@pytest.mark.parametrize(
    ("path", "line", "allowed"),
    [
        ("spec/automcm_spec/a.py", "import automcm_traces.format.writer", False),
        ("traces/automcm_traces/a.py", "import automcm_spec", True),
        ("traces/automcm_traces/a.py", "import automcm", False),
        ("reference/automcm/a.py", "import automcm_traces.format.writer", True),
        (
            "reference/automcm/adapters/spec_mapping.py",
            "import automcm_spec.vocabulary.station",
            True,
        ),
        ("reference/automcm/core/station.py", "import automcm_spec.vocabulary.station", False),
        ("reference/automcm/links/a.py", "import automcm_traces", False),
        ("reference/automcm/links/a.py", "import automcm_spec", False),
        ("reference/automcm/links/a.py", "import automcm_spec.vocabulary.messages", True),
        ("conformance/automcm_conformance/a.py", "import automcm_traces", True),
        ("conformance/automcm_conformance/a.py", "from automcm import links", False),
        ("conformance/automcm_conformance/a.py", "import automcm_cli", False),
        ("conformance/automcm_cli/a.py", "import automcm.links", True),
        ("conformance/automcm_cli/a.py", "import automcm_maintenance", False),
        ("reference/automcm/links/a.py", "import automcm.core", True),
        ("reference/automcm/core/a.py", "import automcm.links", False),
        ("reference/automcm/a.py", "import automcm.scenarios", True),
        ("reference/automcm/core/a.py", "def late():\n    import automcm.scenarios", False),
    ],
)
def test_what_a_package_may_import(tree: Path, path: str, line: str, allowed: bool) -> None:
    (tree / path).write_text(line + "\n")
    assert (import_graph.forbidden(import_graph.read(tree)) == []) is allowed


def test_cycles_are_found_however_long_and_only_at_load(tree: Path) -> None:
    for name, text in {
        "a": "import automcm.b",
        "b": "import automcm.c, automcm.d",
        "c": "import automcm.a",
        "d": "def late():\n    import automcm.a",
    }.items():
        (tree / f"reference/automcm/{name}.py").write_text(text)
    assert import_graph.cycles(import_graph.read(tree)) == [["automcm.a", "automcm.b", "automcm.c"]]


def test_an_import_of_nothing_is_named(tree: Path) -> None:
    (tree / "reference/automcm/a.py").write_text("import automcm_spec.gone")
    with pytest.raises(ValueError, match=r"automcm\.a: imports automcm_spec\.gone"):
        import_graph.read(tree)


def test_the_map_names_every_folder_and_draws_what_is_imported(read: set[Import]) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text()
    for package, folder in import_graph.PACKAGES.items():
        assert f"`{package}`" in page and f"`{folder}/`" in page
    drawn = import_graph.picture(read)
    assert "automcm -->|automcm_traces.format.writer| automcm_traces" in drawn
    assert "automcm_conformance --> automcm\n" not in drawn
    assert "    service --> core\n" in drawn


def test_every_subpackage_has_its_place_and_says_what_it_is() -> None:
    for package, folder in import_graph.PACKAGES.items():
        inner = ROOT / folder / package
        found = {path.parent.name for path in inner.glob("*/__init__.py")}
        assert found == set(import_graph.LAYERS[package].split())
        for each, first in zip(
            import_graph.LAYERS[package].split(), import_graph.BEGIN[package].split(), strict=True
        ):
            assert (inner / each / f"{first}.py").is_file(), first
            modules = [path for path in (inner / each).glob("*.py") if path.name[0] != "_"]
            assert 0 < len(modules) <= 12, f"{package}/{each}"
            doc = ast.get_docstring(ast.parse((inner / each / "__init__.py").read_text())) or ""
            assert len(doc.splitlines()) >= 4, f"{package}/{each}"


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
