"""The imports between the project's packages, read from their source, for docs/architecture.md."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGES = {
    "automcm_spec": "spec",
    "automcm_traces": "traces",
    "automcm": "reference",
    "automcm_evaluation": "reference",
    "automcm_conformance": "conformance",
    "automcm_cli": "conformance",
    "automcm_maintenance": "conformance",
}
"""The packages with their folders, each after those that it may import."""
LAYERS = {
    "automcm_spec": "support vocabulary model_checking graph compilation",
    "automcm_traces": "format checker system explain edit export viewer",
    "automcm": "core encoding kernels security links adapters service bridge scenarios",
    "automcm_evaluation": (
        "framework arrival bandwidth comfort loss safety radio traffic traffic_scenarios "
        "traffic_experiment sweeps"
    ),
    "automcm_conformance": "adapter exchange scenarios suite explore live replay report vectors",
    "automcm_cli": "shared conform reference spec trace",
    "automcm_maintenance": "corpus documents spec_mutation induction code_mutation benches verify",
}
"""The subpackages of each package; each may import those before it.  Top-level modules may import
all."""
BEGIN = {
    "automcm_spec": "files messages tlc oracle compiler",
    "automcm_traces": "log engine timeline explain log_shrinking itf_log page",
    "automcm": "rules codec trajectory verifier link spec_mapping service websocket_bridge drive",
    "automcm_evaluation": (
        "experiment arrival bandwidth comfort loss safety radio traffic catalogue "
        "traffic_experiment report"
    ),
    "automcm_conformance": (
        "protocol exchange monitor graph_cases explore live graph_comparison report vectors"
    ),
    "automcm_cli": "common conform station_commands spec_commands trace_commands",
    "automcm_maintenance": (
        "corpus generated_files mutants proof certificate conform_bench verify"
    ),
}
"""The module of each subpackage with which to begin to read."""
# Modules without protocol logic: those about the operating system, and the vocabulary.
SHARED = {
    *(f"automcm_spec.vocabulary.{name}" for name in ("application", "messages", "parameters")),
    *(
        f"automcm_spec.support.{name}"
        for name in ("children", "extras", "files", "markdown", "scratch")
    ),
}
MAY = {
    "automcm_spec": set[str](),
    "automcm_traces": {"automcm_spec"},
    "automcm": {"automcm_traces.format.writer", *SHARED},
    # Only the mapping to the specification uses the compiled station, the station itself does not.
    "automcm.adapters.spec_mapping": {"automcm_spec.vocabulary.station"},
    "automcm_evaluation": {"automcm", *SHARED},
    "automcm_conformance": {"automcm_spec", "automcm_traces"},
    "automcm_cli": set(PACKAGES) - {"automcm_cli", "automcm_maintenance"},
    "automcm_maintenance": set(PACKAGES) - {"automcm_maintenance"},
}


@dataclass(frozen=True, order=True)
class Import:
    """An import of one module of the project by another, at load time or later."""

    importer: str
    imported: str
    at_load: bool


def read(root: Path) -> set[Import]:
    """All imports among the project's packages below ``root``, except those for type checkers.

    Raises the SyntaxError of ``ast.parse``, with the name of the file.
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
            # ``from a import b`` loads the module a.b if it exists, else only a, which defines b.
            known = next((name for name in names if name in trees), None)
            if known is None and names[-1].split(".")[0] in PACKAGES:
                raise ValueError(f"{importer}: imports {names[-1]}, which does not exist")
            if known is not None and known != importer:
                found.add(Import(importer, known, at_load))
    return found


def forbidden(imports: set[Import]) -> list[Import]:
    """The imports between packages that ``MAY`` does not allow, and those upward in ``LAYERS``."""
    return sorted(one for one in imports if not _allowed(one))


def _allowed(one: Import) -> bool:
    package, other = one.importer.split(".")[0], one.imported.split(".")[0]
    if package != other:
        return bool({one.imported, other} & (MAY[package] | MAY.get(one.importer, set())))
    return _layer(one.importer) >= _layer(one.imported)


def _layer(module: str) -> int:
    """The position of a module's subpackage in ``LAYERS``; 0 for a package."""
    package, _, inner = module.partition(".")
    names = LAYERS[package].split()
    name = inner.partition(".")[0]
    return 0 if not inner else names.index(name) + 1 if name in names else len(names) + 1


def cycles(imports: set[Import]) -> list[list[str]]:
    """Import cycles: strongly connected groups of two or more modules."""
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
    """The packages in Mermaid, then the subpackages of each.

    An arrow leads to what is imported, unless it follows from others and has no label.
    """
    labels: dict[tuple[str, str], set[str]] = {}
    after: dict[str, dict[str, set[str]]] = {package: {} for package in ("", *PACKAGES)}
    for one in imports:
        (package, *inner), (other, *imported) = (
            each.split(".") for each in (one.importer, one.imported)
        )
        if package != other:
            after[""].setdefault(package, set()).add(other)
            labels.setdefault((package, other), set()).add(one.imported)
        elif inner and imported and inner[0] != imported[0]:
            after[package].setdefault(inner[0], set()).add(imported[0])
    for (package, other), modules in labels.items():
        may = {one for who, ones in MAY.items() if who.split(".")[0] == package for one in ones}
        if modules <= may - PACKAGES.keys():
            label = f"{len(modules)} modules" if len(modules) > 1 else min(modules)
            labels[package, other] = {label}
        else:
            labels[package, other] = set()
    charts = [_chart(after[""], labels)]
    for package, names in LAYERS.items():
        known = {name: after[package].get(name, set()) for name in names.split()}
        charts.append(f"`{package}`:\n\n{_chart(known, {})}")
    return "\n\n".join(charts)


def _chart(after: dict[str, set[str]], labels: dict[tuple[str, str], set[str]]) -> str:
    """A flowchart of these imports."""
    lines = ["```mermaid", "flowchart TD"]
    for a in sorted(after):
        further = set().union(*(_reachable(after, b) for b in after[a]))
        for b in sorted(after[a]):
            label = "".join(f"|{text}|" for text in labels.get((a, b), ()))
            if label or b not in further:
                lines.append(f"    {a} -->{label} {b}")
    return "\n".join([*lines, "```"])


def table(root: Path) -> str:
    """As Markdown: each subpackage, its purpose, and its first module to read."""
    lines = ["| package | subpackage | what it is | begin with |", "|---|---|---|---|"]
    for package, names in LAYERS.items():
        for name, first in zip(names.split(), BEGIN[package].split(), strict=True):
            folder = root / PACKAGES[package] / package / name
            doc = ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) or ""
            link = f"[`{first}`](../{(folder / first).relative_to(root).as_posix()}.py)"
            what = " ".join(doc.split("\n\n")[0].split())
            lines.append(f"| `{package}` | `{name}` | {what} | {link} |")
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
    """The parts of a module name: ``links/udp.py`` gives links, udp; ``__init__.py`` gives none."""
    parts = path.with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


def _imports(node: ast.AST, at_load: bool) -> Iterator[tuple[list[str], bool]]:
    """Each import below a node: the modules that it may name, the likelier first."""
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
