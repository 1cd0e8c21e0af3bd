"""The commands ``automcm spec ...``.  Imports lazily: each command only what it needs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from automcm_cli.shared.common import Json, code_3, example, progress, unknown, usage, write_json

app = typer.Typer()


Profile = Annotated[
    str | None, typer.Option(help="quick, full or deep: the models of these and of those before.")
]
Property = Annotated[
    str | None, typer.Option("--property", help="Only models that check it, such as S-5.")
]


@app.command("list", epilog=example("spec list --property T-2"))
def spec_list(profile: Profile = None, property_: Property = None, json_: Json = None) -> None:
    """The models: what each must show, and why it is there."""
    from automcm_cli.spec import model_output as spec_

    models = _chosen([], profile, property_)
    if write_json(json_, [model.model_dump(exclude_none=True) for model in models]):
        for model in models:
            typer.echo(spec_.described(model))


@app.command("check", epilog=example("spec check rejoin --json -"))
def spec_check(
    names: Annotated[
        list[str] | None, typer.Argument(help="Models, as automcm spec list names them.")
    ] = None,
    profile: Profile = None,
    property_: Property = None,
    timeout: Annotated[
        float | None, typer.Option(min=0, help="Seconds for each model; then it is incomplete.")
    ] = None,
    heap: Annotated[int | None, typer.Option(min=16, help="Memory for Java, in MB.")] = None,
    traces: Annotated[Path, typer.Option(help="Folder for counterexamples, in ITF.")] = Path(
        "runs/counterexamples"
    ),
    distributed: Annotated[
        bool,
        typer.Option("--distributed", help="Wait for automcm spec worker; only safety, no trace."),
    ] = False,
    host: Annotated[
        str, typer.Option(help="With --distributed: the address workers reach this machine under.")
    ] = "127.0.0.1",
    json_: Json = None,
) -> None:
    """Check models with TLC.  A counterexample is shown as the inputs that lead to it.

    A run that does not come to its end (time, memory, disk) is incomplete: code 4, and the
    states it has looked at.  If the specification is not the one that spec/oracle was made from
    and every model comes out as recorded, no property covers the change, and that is said.
    """
    from automcm_cli.spec import model_output as spec_
    from automcm_spec.model_checking import tlc

    if not names and profile is None and property_ is None:
        raise typer.BadParameter("name a model, or give --profile or --property")
    asked = _chosen(names or [], profile, property_)
    if distributed:
        _check_distributed(asked, host, json_)
    with code_3("check", tlc.TlcError):
        tlc.tools()  # once, not for each model
    verdicts = []
    changed = spec_.specification_changed()
    try:
        for model in asked:
            with progress() as say:
                verdicts.append(spec_.check(model, say, timeout, heap))
            if str(json_) != "-":
                typer.echo(spec_.shown(verdicts[-1], changed))
            with code_3("check", OSError):
                if verdicts[-1].trace:
                    path = spec_.write_trace(verdicts[-1], traces)
                    typer.echo(f"written: {path}", err=True)
    finally:
        write_json(json_, [spec_.as_dict(verdict) for verdict in verdicts])
    if changed and (text := spec_.not_covered(verdicts)):
        typer.echo(text, err=str(json_) == "-")
    raise typer.Exit(spec_.exit_code(verdicts))


def _check_distributed(asked: list[Any], host: str, json_: Path | None) -> None:
    from automcm_cli.spec import distributed_check as shared_
    from automcm_spec.model_checking.tlc import TlcError

    found = []
    with code_3("check", TlcError):
        for model in asked:
            with progress() as say:
                found.append(shared_.check(model, host, say))
            if str(json_) != "-":
                typer.echo(shared_.shown(found[-1]))
    write_json(json_, [shared_.as_dict(one) for one in found])
    raise typer.Exit(1 if any(one.problem for one in found) else 0)


@app.command("worker", epilog=example("spec worker 192.0.2.7"))
def spec_worker(
    server: Annotated[
        str, typer.Argument(metavar="HOST", help="Where spec check --distributed is.")
    ],
    threads: Annotated[int, typer.Option(min=1, help="How much to do at a time.")] = 1,
    host: Annotated[
        str, typer.Option(help="The address the server reaches this machine under.")
    ] = "127.0.0.1",
) -> None:
    """Help a check on another machine until it is done.  For a network one trusts."""
    from automcm_spec.model_checking import distributed_tlc as distributed
    from automcm_spec.model_checking.tlc import TlcError

    with code_3("worker", TlcError), progress() as say:
        say(f"working for {server}")
        computed = distributed.work(server, threads=threads, host=host)
    typer.echo(f"{computed:,} states computed here")


@app.command("simulate", epilog=example("spec simulate two_by_three"))
def spec_simulate(
    name: Annotated[
        str, typer.Argument(metavar="MODEL", help="As automcm spec list names it, or two_by_three.")
    ],
    seed: Annotated[int, typer.Option(min=0, help="The same gives the same behaviours.")] = 1,
    seconds: Annotated[int, typer.Option(min=1, help="When to end, with the start of Java.")] = 30,
    depth: Annotated[int, typer.Option(min=1, help="Steps of a behaviour, at most.")] = 100,
    behaviours: Annotated[int | None, typer.Option(min=1, help="How many, at most.")] = None,
    lively: Annotated[
        bool, typer.Option("--lively", help="Without what ends sessions early (Simulation.tla).")
    ] = False,
    json_: Json = None,
) -> None:
    """Random behaviours of a model, till a property is violated.  Which rules decided how often?

    Code 4: a model that must fail did not in these behaviours, or there were none in time.
    """
    from automcm_cli.spec import walk_summary as walks_
    from automcm_spec.model_checking import random_walks
    from automcm_spec.model_checking.models import ModelError
    from automcm_spec.model_checking.tlc import TlcError

    with code_3("simulate", TlcError, ModelError, random_walks.WalkError, OSError):
        known = random_walks.known()
        if name not in known:
            raise typer.BadParameter(unknown(name, list(known)), param_hint="MODEL")
        with progress() as say:
            found = random_walks.run(
                known[name],
                seed=seed,
                depth=depth,
                seconds=seconds,
                number=behaviours,
                lively=lively,
                on_progress=lambda n: say(f"{name}: {n:,} behaviours"),
            )
    if write_json(json_, found.as_dict()):
        typer.echo(walks_.shown(found))
    raise typer.Exit(found.exit_code)


def _chosen(names: list[str], profile: str | None, property_: str | None) -> list[Any]:
    from automcm_cli.spec import model_output as spec_
    from automcm_spec.model_checking import models

    with usage(ValueError), code_3("spec", models.ModelError):
        return list(spec_.chosen(models.load(), names, profile, property_))
