"""``automcm vectors``: checks the reference against the test vectors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared import common

if TYPE_CHECKING:
    from rich.console import Console

    from automcm_conformance.vectors.vectors import Result

app = typer.Typer()


@app.command(epilog=common.example("vectors check --kernel collide"))
def check(
    kernel: Annotated[
        list[str] | None, typer.Option(help="Only this kernel, such as collide.  Repeatable.")
    ] = None,
    json_: common.Json = None,
) -> None:
    """Check the reference against the test vectors.

    Those for signed messages need the extra ``automcm[secure]``.
    """
    from automcm_cli.reference import vector_adapter
    from automcm_conformance.vectors import vectors

    for name in kernel or []:
        if name not in vectors.KERNELS:
            raise typer.BadParameter(common.unknown(name, vectors.KERNELS, "kernel"))
    with common.code_3("vectors", NotImplementedError, OSError), common.progress() as notify:
        results = []
        for path in vectors.paths():
            if not kernel or path.stem in kernel:
                notify(path.stem)
                results += vectors.check(vector_adapter.call, vectors.load(path))
        for name, why in not_supported(results).items():
            if name in (kernel or []):
                raise NotImplementedError(f"{name}: not supported: {why}")
    if common.write_json(json_, as_dict(results)):
        show(results, common.console_of(200))
    raise typer.Exit(0 if all(result.ok for result in results) else 1)


def not_supported(results: list[Result]) -> dict[str, str]:
    """The kernels that the implementation does not have, and why."""
    return {each.case.kernel: each.not_supported for each in results if each.not_supported}


def as_dict(results: list[Result]) -> dict[str, object]:
    """For ``--json``: each vector, and whether its result is as expected."""
    return {
        "vectors": [
            {"id": result.case.id, "kernel": result.case.kernel, "ok": result.ok}
            for result in results
            if not result.not_supported
        ],
        "not_supported": not_supported(results),
    }


def show(results: list[Result], console: Console) -> None:
    """A table by kernel, then each vector that fails."""
    table = common.table_of("rule", "kernel", "vectors", "failed", words=2)
    for rule, kernel in dict.fromkeys((each.case.rule, each.case.kernel) for each in results):
        mine = [each for each in results if each.case.kernel == kernel and not each.not_supported]
        failed = sum(not each.ok for each in mine)
        table.add_row(rule, kernel, str(len(mine)), str(failed), style="red" if failed else "")
    console.print(table)
    for name, why in not_supported(results).items():
        console.print(f"{name}: not supported: {why}", markup=False, soft_wrap=True)
    for result in results:
        if not result.ok:
            console.print()
            console.print(result.case.id, style="red", markup=False)
            for line in (
                result.case.purpose,
                result.problem,
                f"expected {result.case.expected}",
                f"got {result.got}",
                f"the bug that this vector finds: {result.case.bug}",
            ):
                console.print("  " + line, markup=False, highlight=False, soft_wrap=True)
