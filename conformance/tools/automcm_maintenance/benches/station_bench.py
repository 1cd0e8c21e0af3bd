"""``automcm bench station``, ``kernels``, ``security`` and ``radio``: the figures as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.common import Json, code_3, console_of, progress, table_of, write_json
from automcm_spec.support.extras import MissingExtra

if TYPE_CHECKING:
    from rich.console import Console

    from automcm_maintenance.benches.core_bench import StationFigures
    from automcm_maintenance.benches.kernel_bench import KernelFigures as KernelReport
    from automcm_maintenance.benches.security_bench import SecurityFigures as SecurityReport


def station(
    seconds: Annotated[float, typer.Option(help="Approximate duration in seconds.", min=0.1)] = 20,
    json_: Json = None,
) -> None:
    """Measure messages, sessions and memory of the reference.

    Each figure is compared with a baseline measured in the same run.  There is no verdict: the
    figures depend on the machine, the ratios less so.
    """
    from automcm_maintenance.benches import core_bench as measured

    with progress() as notify:
        report = measured.run(seconds, notify)
    if write_json(json_, report.as_dict()):
        show(report, console_of())


def kernels(
    seconds: Annotated[float, typer.Option(help="Approximate duration in seconds.", min=1)] = 60,
    json_: Json = None,
) -> None:
    """Measure each trajectory kernel, single and batched.

    Each kernel is compared with other ways to compute the same result.  A ratio of 2.0 means twice
    the time of the kernel.  The floor is the time to copy the bytes that must be read.  There is no
    verdict.
    """
    from automcm_maintenance.benches import kernel_bench

    with progress() as notify:
        report = kernel_bench.run(seconds, notify=notify)
    if write_json(json_, report.as_dict()):
        show_kernels(report, console_of(110))


def security(
    seconds: Annotated[float, typer.Option(help="Approximate duration in seconds.", min=0.1)] = 20,
    json_: Json = None,
) -> None:
    """Measure signed messages: bytes, rates on one core, latency.

    The rates are compared with openssl speed and with the bare primitives in the same run.  There
    is no verdict: the figures depend on the machine, the ratios less so.
    """
    with code_3("bench security", MissingExtra), progress() as notify:
        from automcm_maintenance.benches import security_bench

        report = security_bench.run(seconds, notify)
    if write_json(json_, report.as_dict()):
        show_security(report, console_of())


def window(
    sessions: Annotated[int, typer.Option(help="Sessions at each loss.", min=1)] = 200,
    seed: Annotated[int, typer.Option(help="The seed of the sessions.")] = 1,
    json_: Json = None,
) -> None:
    """Measure the gain of a window that closes early (ADV-9).

    A window that closes when every known neighbour has answered is compared with the paper's, with
    the same seeds in virtual time, so the figures do not depend on the machine.  There is no
    verdict.
    """
    from automcm_evaluation.loss import window_bench

    with progress() as notify:
        rows = window_bench.run(sessions, seed, notify)
    if not write_json(json_, [row.as_dict() for row in rows]):
        return
    table = table_of("loss", "window", "agreed", "mean ms", "95 % within ms", "messages", "ratio")
    for row in rows:
        for name, of in (("fixed", row.fixed), ("early", row.early)):
            ratio = f"{row.ratio:.1f}" if of is row.early else ""
            mean, figures = f"{of.mean_ms:,.0f}", (f"{of.q95_ms:,}", f"{of.messages:.1f}", ratio)
            table.add_row(f"{row.loss}%", name, f"{of.agreed:.1%}", mean, *figures)
    console_of().print(table)


def radio(
    seconds: Annotated[float, typer.Option(help="Approximate duration in seconds.", min=0.1)] = 20,
    json_: Json = None,
) -> None:
    """Measure the speed of the simulated radio channel.

    The result is in simulated seconds a second on one core.  Every vehicle sends a CAM at 10 Hz.
    The baseline of the same run is a coin for each receiver.  There is no verdict: the figures
    depend on the machine, the ratio less so.
    """
    from automcm_maintenance.benches import radio_bench

    with progress() as notify:
        report = radio_bench.run(seconds, notify)
    if write_json(json_, report.as_dict()):
        columns = ("receptions a second", "simulated s a second", "with coins", "ratio")
        table = table_of("vehicles", *columns)
        for rate in report.rates:
            speeds = f"{rate.table:.1f}", f"{rate.coins:.1f}", f"{rate.table / rate.coins:.2f}"
            table.add_row(str(rate.vehicles), f"{rate.receptions:,}", *speeds)
        console_of().print(table)


def show(report: StationFigures, console: Console) -> None:
    """Print the tables."""
    from automcm_maintenance.benches.core_bench import POINTS

    core = report.core
    console.print(f"the core, {core.messages} messages of a session of four stations")
    table = table_of("", "us a message", "core costs")
    table.add_row("core", f"{core.core_us:.2f}", "")
    for name, us in (
        ("decoding it (pydantic, JSON)", core.decode_us),
        ("a dictionary look-up", core.lookup_us),
        ("a python-statemachine transition", core.statemachine_us),
    ):
        table.add_row(name, f"{us:.2f}", f"{core.core_us / us:.2f} times that")
    console.print(table)
    console.print(f"messages a second: {1e6 / core.core_us:,.0f}\n", highlight=False)
    columns = ("decoding us", "core us", "ratio", "rules us", "timers us", "rest us")
    table = table_of("by type", "messages", *columns)
    for type_, p in core.by_type.items():
        rest = p.core_us - p.decide_us - p.timers_us
        ratio = p.core_us / p.decode_us
        row = (p.decode_us, p.core_us, ratio, p.decide_us, p.timers_us, rest)
        table.add_row(type_, str(p.messages), *(f"{figure:.2f}" for figure in row))
    console.print(table)
    table = table_of(
        f"\nPrescription, {POINTS} points",
        "bytes",
        "encoding us",
        "to json",
        "decoding us",
        "to json",
    )
    first = report.codings[0]
    for coding in report.codings:
        table.add_row(
            coding.codec,
            f"{coding.size:,}",
            f"{coding.encode_us:.1f}",
            f"{coding.encode_us / first.encode_us:.1f}",
            f"{coding.decode_us:.1f}",
            f"{coding.decode_us / first.decode_us:.1f}",
        )
    console.print(table)
    table = table_of("\nsessions", "loss", "a second", "to no loss", "messages a second", "agreed")
    for each in report.sessions:
        perfect = next(s for s in report.sessions if (s.t_timeout, s.loss) == (each.t_timeout, 0.0))
        table.add_row(
            f"t_timeout {each.t_timeout} ms",
            f"{each.loss:.0%}",
            f"{each.per_second:,.0f}",
            f"{each.per_second / perfect.per_second:.2f}",
            f"{each.messages_per_second:,.0f}",
            f"{each.agreed / each.sessions:.0%}",
        )
    console.print(table)
    m = report.memory
    table = table_of(f"\nmemory, {m.stations} stations", "bytes a station", "to idle")
    for name, size in (("idle", m.idle), ("waiting", m.waiting), ("acting", m.acting)):
        table.add_row(name, f"{size:,}", f"{size / m.idle:.2f}")
    table.add_row(f"one trajectory of {POINTS} points", f"{m.trajectory:,}", "")
    console.print(table)


def show_kernels(report: KernelReport, console: Console) -> None:
    """Print one row for each kernel, number of points and number of pairs."""
    from automcm_maintenance.benches.kernel_bench import PEERS

    table = table_of("kernel", "points", "pairs", "us a pair", "to floor", *PEERS)
    for row in report.rows:
        table.add_row(
            row.kernel,
            str(row.points),
            f"{row.pairs:,}",
            f"{row.us:.2f}",
            f"{row.to_floor:.1f}",
            *(f"{row.ahead[name]:.2f}" if name in row.ahead else "" for name in PEERS),
        )
    console.print(table)
    for points, ratios in report.discs_to_points.items():
        text = ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items())
        console.print(f"{points} points, ratio to closest_approach: {text}", highlight=False)
    for name, reason in report.missing.items():
        console.print(f"not measured: {name} ({reason})", highlight=False)


def show_security(report: SecurityReport, console: Console) -> None:
    """Print the tables."""
    console.print(f"bytes added; a certificate has {report.certificate}", highlight=False)
    columns = ("message", "with digest", "with certificate", "fits a frame")
    table = table_of("", "codec", "points", *columns)
    for size in report.sizes:
        added = (size.message, f"+{size.digest}", f"+{size.certificate}", size.fits and "yes")
        row = (size.type, size.codec, size.points or "-", *added)
        table.add_row(*(str(each or "no") for each in row))
    console.print(table)
    table = table_of("\na second on one core", "signatures", "to openssl", "verifications", "to it")
    last = report.rates[-1]
    for rate in report.rates:
        pairs = (rate.signatures, last.signatures), (rate.verifications, last.verifications)
        cells = []
        for own, theirs in pairs:
            cells += [f"{own:,.0f}" if own else "", f"{own / theirs:.2f}" if own and theirs else ""]
        table.add_row(rate.name, *cells)
    console.print(table)
    spent = ", ".join(f"{us:.0f} us at {name}" for name, us in report.latency_us.items())
    console.print(f"\nsigning and verifying a CAM: {spent}", highlight=False)
    for vehicles, part in report.needed.items():
        console.print(
            f"CAMs of {vehicles} vehicles at 10 Hz: {part:.0%} of a core", highlight=False
        )
