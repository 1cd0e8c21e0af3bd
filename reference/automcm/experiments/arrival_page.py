"""The page of ``arrival`` and its figures, from the report alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from automcm.experiments import figures as drawing
from automcm.experiments.arrival_claims import FIG_9_S, NEAR_S, PAPER, SPEEDS_KMH, sumo_gain
from automcm.experiments.experiment import Values
from automcm.experiments.intervals import wilson
from automcm.experiments.sumo import HOWS
from automcm.scenarios.lane_change import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {"with": "tab:blue", "without": "tab:orange"}
NAMES = {
    "notice": "noticed that far from its lane's middle, m",
    "brake": "brakes at (at least), m/s²",
    "restart_s": "stands at least, s",
    "restart_gap": "restarts at a gap of, m",
    "acceleration": "acceleration of all, m/s²",
}


def page(report: Values) -> list[str]:
    """All but title and claims."""
    return [
        *_run(report),
        *_times(report),
        *_baseline(report),
        *_way(report),
        *_sumo(report),
        "",
        "## Doubts",
        "",
        "- The paper tells what the vehicle without coordination does, with no figure for it. Here",
        "  one figure, the gap at which it restarts, was chosen so that the paper's two gains come",
        "  out. They are fitted, not confirmed; other baselines fit as well, or give other gains.",
        "- The stop is a rule of the baseline. A follower that only keeps its distance brakes hard",
        "  and does not stop (SUMO's, below), and then a prescription costs time.",
        "- The paper's Fig. 8 is not available as data: means are compared, not distributions.",
        "- Which way the paper times is not told. The signal's place is chosen for its per cent.",
    ]


def _run(report: Values) -> list[str]:
    s = report["settings"]
    end_m, beside_m = s["signal_m"] + s["signal_span_m"], s["beside_m"] + s["beside_span_m"]
    rows = [
        ("speed of both, km/h", " and ".join(map(str, SPEEDS_KMH)), "paper"),
        ("target, m from the receiver's start", f"{s['target_m']:g}", "paper"),
        ("trials at each speed", str(s["trials"]), "100 in the paper"),
        ("ΔV, gap gained, Δt1, time-out, resending", "Table I", "paper"),
        ("signal, m after the start, even", f"{s['signal_m']:g} to {end_m:g}", "calibrated"),
        (
            "prescriber ahead, centre to centre, m, even",
            f"{s['beside_m']:g} to {beside_m:g}",
            "assumed",
        ),
        (f"baseline: {NAMES['restart_gap']}", f"{s['restart_gap']:g}", "calibrated"),
        (f"baseline: {NAMES['restart_s']}", f"{s['restart_s']:g}", "assumed"),
        (f"baseline: {NAMES['brake']}", f"{s['brake']:g}", "assumed"),
        (f"baseline: {NAMES['notice']}", f"{s['notice']:g}", "assumed"),
        (NAMES["acceleration"], f"{s['acceleration']:g}", "assumed"),
    ]
    return [
        "## What was run",
        "",
        "A straight road of two lanes, a prescriber and a receiver. After some way the prescriber",
        "signals; the clock starts. With coordination it advertises, prescribes, waits for its gap",
        "and moves over. Without, it moves over at once; the receiver notices when the other has",
        "left its lane's middle, brakes hard to a stop, and restarts when the gap is sufficient.",
        "Each trial is driven both ways from the same start. The clock stops when the receiver is",
        "at the target. Following is by the intelligent driver model, which brakes harder than",
        "asked if it must.",
        "",
        "| parameter | value | source |",
        "|---|---|---|",
        *(f"| {name} | {value} | *{source}* |" for name, value, source in rows),
    ]


def _times(report: Values) -> list[str]:
    lines = [
        "",
        "## Arrival times (Fig. 8)",
        "",
        "![Share of trials that have arrived by each time, at 30 and at 50 km/h](arrival.svg)",
        "",
        "| | mean, s | 5 % to 95 %, s | lost, s | stood, s | stopped (95 % interval) "
        "| slowest, m/s | hardest braking, m/s² | the same since the lane change began |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    found = report["summary"]["speeds"]
    for speed_kmh in SPEEDS_KMH:
        here = found[str(speed_kmh)]
        for which in ("with", "without"):
            of = here[which]
            low, high = wilson(of["stopped"], here["trials"])
            lines.append(
                f"| {speed_kmh} km/h, {which} | {of['mean_s']:.2f} "
                f"| {of['q05_s']:.2f} to {of['q95_s']:.2f} | {of['lost_s']:.2f} "
                f"| {of['stood_s']:.1f} "
                f"| {of['stopped']} of {here['trials']} ({low:.0%} to {high:.0%}) "
                f"| {of['slowest']:.1f} | {of['hardest']:.1f} | {of['after']:.1f} |"
            )
    timed = " and ".join(f"{found[str(kmh)]['timed_m']:.1f}" for kmh in SPEEDS_KMH)
    done = " and ".join(
        f"{found[str(kmh)]['with']['completed']} of {found[str(kmh)]['trials']}"
        for kmh in SPEEDS_KMH
    )
    asked = " and ".join(f"{Plan().gain_m / kmh * 3.6:.1f}" for kmh in SPEEDS_KMH)
    return [
        *lines,
        "",
        f"Lost: against driving on undisturbed over the way timed, {timed} m on average.",
        f"Medians of slowest speed and braking. With coordination {done} sessions were completed.",
        "",
        f"**What explains it.** The gap that a prescription asks for costs {asked} s at the two",
        "speeds; the rest of what is lost with coordination is driving off again behind the other.",
        "The stop costs braking, standing and driving off; the first and the last grow with the",
        "speed. So coordination costs less at the higher speed, the stop more.",
    ]


def _baseline(report: Values) -> list[str]:
    found, s = report["summary"], report["settings"]
    tried = found["tried"]
    best = tried["best"]
    lines = [
        "",
        "## How much of it is the baseline",
        "",
        "![Gain over the gap at which the receiver restarts and the time it stands](baseline.svg)",
        "",
        f"Framed: the paper's gain. Of {tried['baselines']} baselines tried, {tried['fit']} give",
        f"both of the paper's gains, to {NEAR_S:g} s; the gain is {tried['least_s']['30']:.1f} to "
        f"{tried['greatest_s']['30']:.1f} s at 30 km/h and {tried['least_s']['50']:.1f} to "
        f"{tried['greatest_s']['50']:.1f} s at 50 km/h.",
        f"In {tried['grows']} it is greater at 50 km/h. Nearest to the paper on the grid of brake,",
        f"gap and standing time: {best['brake']:g} m/s², {best['restart_gap']:g} m and "
        f"{best['restart_s']:g} s, with {best['gain_s']['30']:.2f} and "
        f"{best['gain_s']['50']:.2f} s; used are {s['brake']:g} m/s², "
        f"{s['restart_gap']:g} m and {s['restart_s']:g} s.",
        f"Each is the mean of {s['draws']} starts, spread evenly. One parameter at a time:",
        "",
        "| parameter (used) | value | gain at 30 km/h, s | gain at 50 km/h, s |",
        "|---|---|---|---|",
    ]
    slow, fast = (found["ones"][str(speed_kmh)] for speed_kmh in SPEEDS_KMH)
    for name, text in NAMES.items():
        for (value, a), (_, b) in zip(slow[name], fast[name], strict=True):
            lines.append(f"| {text} ({s[name]:g}) | {value:g} | {a:.2f} | {b:.2f} |")
    return lines


def _way(report: Values) -> list[str]:
    found, target_m = report["summary"], report["settings"]["target_m"]
    lines = [
        "",
        "## 5 s and 15 %, 7 s and 28 %",
        "",
        "Seconds and per cent together give both arrival times. Read as time saved, share = gain /",
        "without; read as speed gained, share = without / with - 1. Take off what coordination",
        "costs here, and the rest is a way at constant speed:",
        "",
        "| | gain | as time saved | timed way then (as rounded) | as speed gained "
        "| timed way then (as rounded) |",
        "|---|---|---|---|---|---|",
    ]
    for speed_kmh in SPEEDS_KMH:
        gain, share = PAPER[speed_kmh]
        of = found["ways"][str(speed_kmh)]
        (a, a_low, a_high), (b, b_low, b_high) = of["reduction"], of["ratio"]
        saved, gained = gain / share, gain / share + gain
        lines.append(
            f"| paper, {speed_kmh} km/h | {gain:.0f} s "
            f"| {share:.0%}: {saved:.1f} to {saved - gain:.1f} s "
            f"| {a:.0f} m ({a_low:.0f} to {a_high:.0f}) "
            f"| {share:.0%}: {gained:.1f} to {gained - gain:.1f} s "
            f"| {b:.0f} m ({b_low:.0f} to {b_high:.0f}) |"
        )
    for speed_kmh in SPEEDS_KMH:
        here = found["speeds"][str(speed_kmh)]
        lines.append(
            f"| here, {speed_kmh} km/h | {here['gain_s']:.2f} s | {here['reduction']:.1%} "
            f"| {here['timed_m']:.0f} m | {here['ratio']:.1%} | {here['timed_m']:.0f} m |"
        )
    for speed_kmh in SPEEDS_KMH:
        here = found["speeds"][str(speed_kmh)]
        with_s = target_m / speed_kmh * 3.6 + here["with"]["lost_s"]
        lines.append(
            f"| here, {speed_kmh} km/h, clock from the start | {here['gain_s']:.2f} s "
            f"| {here['gain_s'] / (with_s + here['gain_s']):.1%} | {target_m:.0f} m "
            f"| {here['gain_s'] / with_s:.1%} | {target_m:.0f} m |"
        )
    best = found["by_29_s"]
    low, high = wilson(best["with"], best["trials"])
    return [
        *lines,
        "",
        "The reading that gives about the same way at both speeds is the one to be believed; the",
        "place of the signal is calibrated to it. The last two rows time all of the way. Fig. 9's",
        f"best class at 30 km/h, {FIG_9_S:g} s or less, agrees: here {best['with']} of "
        f"{best['trials']} trials with",
        f"coordination ({low:.0%} to {high:.0%}) and {best['without']} without are in it.",
    ]


def _sumo(report: Values) -> list[str]:
    found = report["summary"]["sumo"]
    lines = ["", "## A second opinion: SUMO", ""]
    if not all(found[str(speed_kmh)] for speed_kmh in SPEEDS_KMH):
        return [
            *lines,
            "Not run: it needs `automcm[sumo]`, and the setting `sumo` (`--set sumo=true`).",
        ]
    lines += [
        "The same starts in SUMO, with its own followers (Krauss, no imperfection, its defaults of",
        f"acceleration and braking), {report['settings']['trials']} of them spread evenly:",
        "",
        "| | arrival, mean, s | lost, s | slowest of all, m/s | hardest of all, m/s² | collisions "
        "| gain of the prescription, s |",
        "|---|---|---|---|---|---|---|",
    ]
    for speed_kmh in SPEEDS_KMH:
        for how in HOWS:
            of = found[str(speed_kmh)][how]
            gain = sumo_gain(report["summary"], speed_kmh, how)
            shown = "" if how == "prescribed" else f"{gain:+.2f}"
            lines.append(
                f"| {speed_kmh} km/h, {how} | {of['arrival_s']:.2f} | {of['lost_s']:.2f} "
                f"| {of['slowest']:.1f} | {of['hardest']:.1f} | {of['collisions']} | {shown} |"
            )

    def lost(how: str, which: str) -> str:
        ours = report["summary"]["speeds"]
        return "; ".join(
            f"{found[name][how]['lost_s']:.1f} s there, {ours[name][which]['lost_s']:.1f} s here"
            for name in map(str, SPEEDS_KMH)
        )

    return [
        *lines,
        "",
        *(f"- *{how}*: {text}." for how, text in HOWS.items()),
        "",
        "A positive gain would be the paper's. At the two speeds a prescription loses",
        f"{lost('prescribed', 'with')}. A lane change at once loses",
        f"{lost('forced', 'without')}. The difference is the stop: a follower that",
        "brakes without stopping loses less than the gap costs that is prescribed. So the paper's",
        "gain is that over its baseline, a planner that stops.",
    ]


def figures(report: Values) -> Iterator[tuple[str, Figure]]:
    """Fig. 8, and the gain over two parameters of the baseline."""
    yield "arrival", _arrival(report)
    yield "baseline", _grid(report)


def _arrival(report: Values) -> Figure:
    figure, plots = drawing.plots(2, 1, height=6)
    for plot, speed_kmh, letter in zip(plots, SPEEDS_KMH, "ab", strict=True):
        cells = [
            cell["result"]
            for cell in report["cells"]
            if cell["values"]["part"] == "trials" and cell["values"]["speed_kmh"] == speed_kmh
        ]
        here = report["summary"]["speeds"][str(speed_kmh)]
        for which, colour in COLOURS.items():
            times = sorted(t for cell in cells for t in cell[which]["arrival_s"])
            shares = [100 * (n + 1) / len(times) for n in range(len(times))]
            plot.step([times[0], *times], [0, *shares], where="post", color=colour)
            middle = here[which]["mean_s"]
            label = f"{which} coordination, mean {middle:.1f} s"
            plot.axvline(middle, color=colour, linestyle="--", linewidth=1, label=label)
        plot.set_title(f"({letter}) {speed_kmh} km/h: {here['gain_s']:.2f} s earlier")
        plot.set_ylabel("trials arrived, %")
        plot.legend(loc="center")
    plots[-1].set_xlabel("time since the prescriber's signal, s")
    return figure


def _grid(report: Values) -> Figure:
    figure, plots = drawing.plots(1, 2, height=3.8)
    grids, used = report["summary"]["grid"], report["settings"]
    brakes = {point["brake"] for point in grids[str(SPEEDS_KMH[0])]}
    brake = min(brakes, key=lambda b: (abs(b - used["brake"]), b))
    top = max(point["gain_s"] for grid in grids.values() for point in grid)
    for plot, speed_kmh in zip(plots, SPEEDS_KMH, strict=True):
        points = [p for p in grids[str(speed_kmh)] if p["brake"] == brake]
        waits = sorted({p["restart_s"] for p in points})
        gaps = sorted({p["restart_gap"] for p in points})
        gain = {(p["restart_gap"], p["restart_s"]): p["gain_s"] for p in points}
        rows = [[gain[gap, wait] for wait in waits] for gap in gaps]
        image = plot.imshow(rows, origin="lower", aspect="auto", cmap="viridis", vmin=0, vmax=top)
        for y, row in enumerate(rows):
            for x, value in enumerate(row):
                _cell(
                    plot, x, y, value, value < top / 2, abs(value - PAPER[speed_kmh][0]) <= NEAR_S
                )
        plot.grid(visible=False)
        plot.set_xticks(range(len(waits)), [f"{wait:g}" for wait in waits])
        plot.set_yticks(range(len(gaps)), [f"{gap:g}" for gap in gaps])
        plot.set_xlabel("stands at least, s")
        plot.set_title(f"{speed_kmh} km/h; framed: {PAPER[speed_kmh][0]:.0f} ± {NEAR_S:g} s")
    plots[0].set_ylabel("restarts at a gap of, m")
    figure.colorbar(image, ax=plots, label=f"gain, s (brakes at {brake:g} m/s²)")
    return figure


def _cell(plot: Axes, x: int, y: int, value: float, dark: bool, framed: bool) -> None:
    box = {"boxstyle": "round,pad=0.25", "fill": False, "edgecolor": "tab:red", "linewidth": 1.5}
    plot.text(
        x,
        y,
        f"{value:.1f}",
        ha="center",
        va="center",
        color="white" if dark else "black",
        bbox=box if framed else None,
    )
