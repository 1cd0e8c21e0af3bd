"""Who imports whom among the five packages, read from their source; docs/architecture.md."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# The packages by their folder, each after those it may import.
PACKAGES = {
    "automcm_spec": "spec",
    "automcm_traces": "traces",
    "automcm": "reference",
    "automcm_conformance": "conformance",
    "automcm_cli": "conformance",
}
# What of ours a package may import, besides itself; a module stands for itself alone.
# What is about the operating system and knows nothing of the protocol, and the grammar.
SHARED = {
    f"automcm_spec.{name}"
    for name in (
        *("application", "messages", "parameters"),
        *("children", "files", "markdown", "scratch"),
    )
}
MAY = {
    "automcm_spec": set[str](),
    "automcm_traces": {"automcm_spec"},
    "automcm": {"automcm_traces.writer", *SHARED},
    # The map between the reference and the specification; the station itself decides alone.
    "automcm.adapter": {"automcm_spec.station"},
    "automcm_conformance": {"automcm_spec", "automcm_traces"},
    "automcm_cli": set(PACKAGES) - {"automcm_cli"},
}


_MOST = 5


@dataclass(frozen=True, order=True)
class Import:
    """One module of ours imports another, when it is loaded itself or only later."""

    importer: str
    imported: str
    at_load: bool


def read(root: Path) -> set[Import]:
    """All imports among the five packages below ``root``; what only a type checker sees is not one.

    A syntax error is that of ``ast.parse``, with the name of the file.
    """
    trees = {
        ".".join((package, *_inner(path.relative_to(root / folder / package)))): ast.parse(
            path.read_text(), str(path)
        )
        for package, folder in PACKAGES.items()
        for path in sorted((root / folder / package).rglob("*.py"))
    }
    found = set()
    for importer, tree in trees.items():
        for names, at_load in _imports(tree, at_load=True):
            # ``from a import b`` loads the module a.b if there is one, and else a, which has b.
            known = next((name for name in names if name in trees), None)
            if known is None and names[-1].split(".")[0] in PACKAGES:
                raise ValueError(f"{importer}: imports {names[-1]}, which is not there")
            if known is not None and known != importer:
                found.add(Import(importer, known, at_load))
    return found


def forbidden(imports: set[Import]) -> list[Import]:
    """Those between packages that ``MAY`` does not allow."""
    return sorted(
        one
        for one in imports
        if (package := one.importer.split(".")[0]) != one.imported.split(".")[0]
        and not {one.imported, one.imported.split(".")[0]}
        & (MAY[package] | MAY.get(one.importer, set()))
    )


def cycles(imports: set[Import]) -> list[list[str]]:
    """Groups of modules that load one another: strongly connected, of two or more."""
    after: dict[str, set[str]] = {}
    for one in imports:
        if one.at_load:
            after.setdefault(one.importer, set()).add(one.imported)
    reach = {module: _reachable(after, module) for module in after}
    groups = {
        tuple(sorted(other for other in reach[module] if module in reach.get(other, ())))
        for module in after
        if module in reach[module]
    }
    return sorted(list(group) for group in groups)


def picture(imports: set[Import]) -> str:
    """The packages in Mermaid, an arrow to each that is imported."""
    lines = ["```mermaid", "flowchart TD"]
    for importer in PACKAGES:
        for imported in PACKAGES:
            names = {
                one.imported
                for one in imports
                if one.importer.split(".")[0] == importer
                and one.imported.split(".")[0] == imported != importer
            }
            may = {
                one for who, ones in MAY.items() if who.split(".")[0] == importer for one in ones
            }
            only = f"|{', '.join(sorted(names))}|" if names <= may else ""
            if names:
                lines.append(f"    {importer} -->{only} {imported}")
    return "\n".join([*lines, "```"])


def table(root: Path, imports: set[Import]) -> str:
    """As Markdown: for each package, those of its modules that most others of it import."""
    lines = ["| package | module | what it is |", "|---|---|---|"]
    for package, folder in PACKAGES.items():
        count = Counter(
            one.imported
            for one in imports
            if one.importer.split(".")[0] == one.imported.split(".")[0] == package
            and one.imported != package
        )
        most = sorted(count, key=lambda module: (-count[module], module))[:_MOST]
        for module in most:
            path = root / folder / f"{module.replace('.', '/')}.py"
            path = path if path.exists() else path.with_suffix("") / "__init__.py"
            doc = ast.get_docstring(ast.parse(path.read_text())) or ""
            what = " ".join(doc.split("\n\n")[0].split())
            link = f"[`{module.partition('.')[2]}`](../{path.relative_to(root).as_posix()})"
            lines.append(f"| `{package}` | {link} | {what} |")
    return "\n".join(lines)


def _reachable(after: dict[str, set[str]], start: str) -> set[str]:
    seen: set[str] = set()
    todo = [start]
    while todo:
        new = after.get(todo.pop(), set()) - seen
        seen |= new
        todo.extend(new)
    return seen


def _inner(path: Path) -> tuple[str, ...]:
    """The names behind the package's: ``links/udp.py`` is links, udp; ``__init__.py`` is none."""
    parts = path.with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


def _imports(node: ast.AST, at_load: bool) -> Iterator[tuple[list[str], bool]]:
    """Each import below a node: the modules it may name, the likelier first."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            for other in child.orelse:
                yield from _imports(other, at_load)
        elif isinstance(child, ast.Import):
            yield from (([alias.name], at_load) for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            module = child.module or ""
            yield from (([f"{module}.{alias.name}", module], at_load) for alias in child.names)
        else:
            lazy = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            yield from _imports(child, at_load and not lazy)
