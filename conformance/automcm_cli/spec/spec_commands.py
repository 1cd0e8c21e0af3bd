"""The commands ``automcm spec ...``.  Each command imports only the modules that it needs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from automcm_cli.shared import completion
from automcm_cli.shared.common import (
    Json,
    code_3,
    example,
    progress,
    say,
    say_lines,
    unknown,
    usage,
    write_json,
)

app = typer.Typer()

Profile = Annotated[
    str | None,
    typer.Option(
        help="quick, full or deep.  Each includes the models of the previous ones.",
        autocompletion=completion.profiles,
    ),
]
Property = Annotated[
    str | None,
    typer.Option(
        "--property",
        help="Only models that check this property, such as S-5.",
        autocompletion=completion.properties,
    ),
]


@app.command("list", epilog=example("spec list --property T-2"))
def spec_list(profile: Profile = None, property_: Property = None, json_: Json = None) -> None:
    """List the models: the expected result and the purpose of each."""
    from automcm_cli.spec import model_output as spec_

    models = _chosen([], profile, property_)
    if write_json(
        json_, [model.model_dump(exclude={"config"}, exclude_none=True) for model in models]
    ):
        for model in models:
            say_lines(spec_.described(model))


@app.command("check", epilog=example("spec check rejoin --json -"))
def spec_check(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            help="Names of models, as shown by automcm spec list.", autocompletion=completion.models
        ),
    ] = None,
    profile: Profile = None,
    property_: Property = None,
    timeout: Annotated[
        float | None, typer.Option(min=0, help="Time limit for each model, in seconds.")
    ] = None,
    heap: Annotated[int | None, typer.Option(min=16, help="Heap size of Java, in MB.")] = None,
    traces: Annotated[Path, typer.Option(help="Folder for counterexamples in ITF.")] = Path(
        "runs/counterexamples"
    ),
    keep: Annotated[
        bool,
        typer.Option(
            "--keep", help="Write each cfg to runs/models and print the TLC command that runs it."
        ),
    ] = False,
    json_: Json = None,
) -> None:
    """Check models with TLC.

    A counterexample is shown as the inputs that lead to it.  A run that TLC does not finish (time,
    memory, disk) is incomplete: the exit code is 4, and the number of states examined is shown.
    The command warns when no property covers a change: the specification differs from the one in
    spec/oracle, but every model gives the recorded result.
    """
    from automcm_cli.spec import model_output as spec_
    from automcm_spec.model_checking import tlc

    if not names and profile is None and property_ is None:
        raise typer.BadParameter("no model is selected: give a name, --profile or --property")
    asked = _chosen(names or [], profile, property_)
    with code_3("check", tlc.TlcError):
        tlc.tools()  # once, not for each model
    with code_3("check", OSError):
        for line in [spec_.kept(model) for model in asked] if keep else ():
            say(line, err=True)
    verdicts = []
    changed = spec_.specification_changed()
    try:
        for model in asked:
            with progress() as notify:
                verdicts.append(spec_.check(model, notify, timeout, heap))
            if str(json_) != "-":
                say_lines(spec_.shown(verdicts[-1], changed))
            with code_3("check", OSError):
                if verdicts[-1].trace:
                    path = spec_.write_trace(verdicts[-1], traces)
                    say(f"written: {path}", err=True)
    finally:
        write_json(json_, [spec_.as_dict(verdict) for verdict in verdicts])
    if changed and (text := spec_.not_covered(verdicts)):
        say_lines(text, err=str(json_) == "-")
    raise typer.Exit(spec_.exit_code(verdicts))


@app.command("simulate", epilog=example("spec simulate two_by_three"))
def spec_simulate(
    name: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="Name as shown by automcm spec list, or two_by_three."
        ),
    ],
    seed: Annotated[int, typer.Option(min=0, help="Equal seeds give equal behaviours.")] = 1,
    seconds: Annotated[
        int, typer.Option(min=1, help="Time limit in seconds, including the start of Java.")
    ] = 30,
    depth: Annotated[int, typer.Option(min=1, help="Maximum steps of a behaviour.")] = 100,
    behaviours: Annotated[
        int | None, typer.Option(min=1, help="Maximum number of behaviours.")
    ] = None,
    lively: Annotated[
        bool,
        typer.Option("--lively", help="Omit actions that end sessions early (Simulation.tla)."),
    ] = False,
    json_: Json = None,
) -> None:
    """Run random behaviours of a model.

    The run ends when a property is violated or a limit is reached.  The command shows how many
    steps each rule decided.  The exit code is 4 if a model that must fail did not fail, or if no
    behaviour was finished in time.
    """
    from automcm_cli.spec import model_output as spec_
    from automcm_spec.model_checking import random_walks
    from automcm_spec.model_checking.models import ModelError
    from automcm_spec.model_checking.tlc import TlcError

    with code_3("simulate", TlcError, ModelError, OSError):
        known = random_walks.known()
        if name not in known:
            raise typer.BadParameter(unknown(name, list(known)), param_hint="MODEL")
        with progress() as notify:
            found = random_walks.run(
                known[name],
                seed=seed,
                depth=depth,
                seconds=seconds,
                number=behaviours,
                lively=lively,
                on_progress=lambda n: notify(f"{name}: {n:,} behaviours"),
            )
    if write_json(json_, found.as_dict()):
        say_lines(spec_.shown_walks(found))
    raise typer.Exit(found.exit_code)


def _chosen(names: list[str], profile: str | None, property_: str | None) -> list[Any]:
    from automcm_cli.spec import model_output as spec_
    from automcm_spec.model_checking import models

    with usage(ValueError), code_3("spec", models.ModelError):
        return list(spec_.chosen(models.load(), names, profile, property_))
