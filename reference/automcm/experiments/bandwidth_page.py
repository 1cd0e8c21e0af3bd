"""The page and the figures of the bandwidth experiment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from automcm.experiments import figures as drawing
from automcm.experiments.bandwidth_air import CODECS, FORMS
from automcm.experiments.bandwidth_summary import MARKED, drive
from automcm.experiments.experiment import Values
from automcm.experiments.markdown import table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {
    "CAM": "#bbbbbb",
    "Advertisement": "#0077bb",
    "Intention": "#ee7733",
    "Prescription": "#cc3311",
    "Acceptance": "#009988",
    "Cancel": "#aa3377",
    "Fin": "#000000",
    "Ack": "#ddaa33",
}
"""In the order in which they are stacked."""
ALWAYS = "always-on"
CASES = {
    "cams": "CAMs alone",
    "minute": "a lane change a minute",
    "maneuver": "during a lane change",
    "busiest": "busiest half second of one",
    "always": ALWAYS,
}


def page(report: Values) -> list[str]:
    """Markdown; every figure is from the report."""
    s = report["summary"]
    return [
        *_model(report),
        *_sizes(s),
        *_over_time(s),
        *_saving(s),
        *_loss(s),
        *_scaling(s),
        *_series(s),
        *_doubts(),
    ]


def apart(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """A table between blank lines."""
    return ["", *table(heads, rows), ""]


def _model(report: Values) -> list[str]:
    s, settings = report["summary"], report["settings"]
    points, free, lossy = s["points"], drive(s, 4), drive(s, 4, lossy=True)
    m, (low, high) = s["model"], s["model"]["delay_ms"]
    overhead = ", ".join(f"{name} {n}" for name, n in s["headers"].items())
    return [
        "## What was run",
        "",
        "The lane change of Fig. 6 on the road simulator, with two vehicles (prescriber and",
        f"receiver) and with four (prescriber, A, B, C): {free['trials']} drives of each without "
        "loss,",
        f"{lossy['trials']} with {settings['loss']:.0%} loss of each copy, and drives with up to "
        f"{max(settings['vehicles'])}",
        "vehicles. Each vehicle has a real service; what it puts on the air is counted, Acks and",
        "retransmissions included. Every message is sized in JSON and in UPER, with station ids of",
        "ten digits and times since 1970. Bytes are those of payloads, unless headers are named.",
        "",
        f"- *Paper*: {m['speed_kmh']:g} km/h, CAMs at {m['rate_hz']} Hz, t_resend "
        f"{m['t_resend_s']:g} s, t_timeout {m['t_timeout_s']:g} s, ΔV {m['delta_v_kmh']:g} km/h,",
        f"  a gap greater by {m['gain_m']:g} m.",
        f"- *Assumed*: a delay of {low} to {high} ms; {m['gap_m']:g} m between receivers; the "
        "models of",
        f"  `road.py`; no collisions on the air. A planned trajectory goes {m['ahead_m']:g} m "
        "ahead, thinned to",
        f"  every {m['every']}th point (KIN-2): {points['points']} points, {points['apart_m']:g} m "
        "apart. The paper's road of 260 m, with a",
        f"  point each metre thinned so, would have {points['paper']} (its number is not given); "
        "both are shown.",
        f"- *Always-on*: each vehicle broadcasts its planned trajectory at {m['rate_hz']} Hz, as "
        "an Intention",
        "  without a destination, and nothing else: Prescription and Acceptance would come on top.",
        "  It is sized once a second.",
        f"- *Headers* are *assumed* where they are named: {sum(s['headers'].values())} bytes a "
        "frame, without security",
        f"  ({overhead};",
        "  lengths from the sources of Vanetza).",
        "- *Calibrated*: nothing.",
        "",
    ]


def _sizes(s: Values) -> list[str]:
    four, points, etsi = drive(s, 4), s["points"], s["etsi"]
    rows: list[list[object]] = []
    for kind in COLOURS:
        row: list[object] = [kind]
        for name in CODECS:
            sent = four["cam_size"][name] if kind == "CAM" else _size(four, name, kind)
            ratio = s["ratios"][name].get(kind)
            row += [f"{s['sizes'][kind][name]:,}", f"{ratio:.1f}" if ratio else "-", f"{sent:.0f}"]
        rows.append(row)
    rows.append([MARKED, *(c for n in CODECS for c in (s["sizes"][MARKED][n], "-", "-"))])
    sizes = [("-", "-", f"{four['always_size'][name]:.0f}") for name in CODECS]
    rows.append([f"{ALWAYS} trajectory", *(cell for each in sizes for cell in each)])
    head = [
        text
        for name in ("JSON", "UPER")
        for text in (f"{name}, {points['paper']} points", "times a CAM", f"{name}, as sent")
    ]
    each = _size(four, "uper", "Intention") / points["points"]
    return [
        "## Sizes",
        "",
        f"Bytes of a message: with {points['paper']} points a kilometre from the origin, and the "
        "mean of",
        "what was sent in the drives of four. *Times a CAM*: of one in no session.",
        *apart(["message", *head], rows),
        f"An ETSI CAM with its basic and high-frequency containers has {etsi['cam']} bytes in "
        "UPER, encoded by",
        "pycrate (`python reference/tests/foreign_cam.py` encodes it again); an Intention of",
        f"{points['paper']} points is {etsi['ratio']} of these. Ten would be "
        f"{etsi['needed_per_point']} bytes a point; our UPER has",
        f"{etsi['here_per_point']}, since a point is told as a step from the one before. A step "
        "holds 8 m",
        f"(docs/messages.md); as sent, points are {points['apart_m']:g} m apart, told in full, and "
        f"an Intention has {each:.1f} bytes",
        "for each.",
        "",
    ]


def _size(of: Values, name: str, kind: str) -> float:
    count = of["count"].get(kind, 0)
    return float(of["bytes"][name].get(kind, 0) / count) if count else 0.0


def _over_time(s: Values) -> list[str]:
    two, four = drive(s, 2), drive(s, 4)
    rows: list[list[object]] = []
    for kind in list(COLOURS)[1:]:
        row: list[object] = [kind]
        for of in (two, four):
            row.append(f"{of['count'].get(kind, 0):g}")
            row += [f"{of['bytes'][name].get(kind, 0):,.0f}" for name in CODECS]
        rows.append(row)
    row = ["all"]
    for of in (two, four):
        row.append(f"{sum(of['count'].values()):g}")
        row += [f"{of['event']['sent'][name]:,.0f}" for name in CODECS]
    rows.append(row)
    head = [f"{n}: {what}" for n in (2, 4) for what in ("messages", "JSON", "UPER")]
    return [
        "## Over time: Fig. 7",
        "",
        "![Stacked bytes per second by message type over time for two and four vehicles, in JSON,"
        " with the always-on exchange as a line](fig7-json.svg)",
        "",
        "![The same in UPER](fig7-uper.svg)",
        "",
        "A lane change without loss, in messages and bytes, CAMs apart:",
        *apart(["message", *head], rows),
        "The first two seconds are the",
        f"Advertisement, broadcast {four['count']['Advertisement']:.0f} times for receivers that "
        "nobody knows yet (ADV-2). In the paper's",
        "text Fig. 7a has three times the Intentions; the four vehicles are in 7b.",
        "",
    ]


def _saving(s: Values) -> list[str]:
    rows, stations = [], []
    for n in (2, 4):
        of = drive(s, n)
        for form in FORMS:
            for name in CODECS:
                saving = of["saving"][form][name]
                rows.append(
                    [
                        n,
                        form,
                        name.upper(),
                        f"{of['event'][form][name]:,.0f}",
                        f"{of['always'][form][name]:,.0f}",
                        saving["factor"],
                        saving["with_cams"],
                        saving["break_even_per_min"],
                    ]
                )
        names = ("prescriber", "B") if n == 2 else ("prescriber", "A", "B", "C")
        for station, who in enumerate(names, 1):
            sent = of["by_station"][str(station)]
            per = {name: of["always"]["sent"][name] / n for name in CODECS}
            stations.append(
                [f"{n}: {who}"]
                + [f"{value[name]:,.0f}" for name in CODECS for value in (sent, per)]
            )
    seconds = drive(s, 4)["s"]
    return [
        "## What event-driven saves",
        "",
        f"Bytes over one lane change, {seconds:.1f} s from the first message to the last; how many "
        "times as",
        "many always-on takes, without CAMs and with them; and how many lane changes a minute"
        " would",
        "use up the saving. *Lean* is an Advertisement without its trajectory.",
        *apart(
            [
                "vehicles",
                "trajectories",
                "codec",
                "event-driven",
                ALWAYS,
                "times",
                "with CAMs",
                "break-even, 1/min",
            ],
            rows,
        ),
        f"One after another there is time for {60 / seconds:.1f} lane changes a minute. No "
        "receiver here makes",
        "use of the trajectory in the Advertisement.",
        "",
        "By vehicle, as sent, in bytes:",
        *apart(
            ["vehicle", "JSON", f"JSON, {ALWAYS}", "UPER", f"UPER, {ALWAYS}"],
            stations,
        ),
    ]


def _loss(s: Values) -> list[str]:
    rows = []
    for of in s["drives"]:
        low, high = of["interval"]
        row: list[object] = [
            of["vehicles"],
            f"{of['loss']:.0%}",
            of["trials"],
            f"{of['finished']} ({low:.0%} to {high:.0%})",
        ]
        for name in CODECS:
            least, most = of["range"][name]
            row.append(f"{of['event']['sent'][name]:,.0f} ({least:,} to {most:,})")
        row.append(of["saving"]["sent"]["json"]["factor"])
        rows.append(row)
    return [
        "## With packet loss",
        "",
        "Bytes of a lane change, mean and range of the drives; and those that ended with a Fin,"
        " with the",
        "95 % interval of their share.",
        *apart(
            ["vehicles", "loss", "drives", "finished", "JSON", "UPER", "saving (JSON), times"],
            rows,
        ),
    ]


def _scaling(s: Values) -> list[str]:
    m = s["model"]
    lines = [
        "## More vehicles in range",
        "",
        "![Share of a 6 Mbit/s channel by number of vehicles, event-driven and"
        " always-on, in JSON and UPER](scaling.svg)",
        "",
        "One lane change, all others receivers in one lane that answer its Advertisement. Share of"
        " a channel",
        f"of {s['channel_bit_s'] / 1e6:g} Mbit/s with CAMs at {m['rate_hz']} Hz and "
        f"{sum(s['headers'].values())} bytes of headers a frame; preambles, gaps between",
        "frames and collisions are not counted, so it is a lower bound. In these drives CAMs were"
        " sent at",
        f"{m['sparse_hz']:g} Hz, to save time, and counted at {m['rate_hz']} Hz: by the rules a "
        "CAM calls for no message."
        " *A lane change a",
        "minute* is arithmetic from one lane change.",
        "",
    ]
    for name in CODECS:
        rows = [
            [
                each["vehicles"],
                each["participants"],
                each["intentions"],
                f"{each['event'][name]:,}",
                each["factor"][name],
                *(f"{each['channel'][name][case]:.1%}" for case in CASES),
            ]
            for each in s["many"]
        ]
        head = [
            "vehicles",
            "max_participants",
            "Intentions",
            "bytes a lane change",
            "always-on, times",
        ]
        lines += [f"{name.upper()}:", *apart([*head, *CASES.values()], rows)]
    return lines


def _series(s: Values) -> list[str]:
    rows = [
        [
            n,
            "yes" if each["finished"] else "no",
            each["intentions"],
            *(f"{each[name]:,}" for name in CODECS),
            *(f"{each['always'][name]:,.0f}" for name in CODECS),
        ]
        for n, each in enumerate(s["series"], 1)
    ]
    return [
        "## One lane change after another",
        "",
        f"{s['series'][0]['vehicles']} vehicles, of which {len(s['series'])} change lanes one "
        "after another; who has moved over answers the next.",
        *apart(
            [
                "lane change",
                "finished",
                "Intentions",
                "JSON, bytes",
                "UPER, bytes",
                f"JSON, {ALWAYS}",
                f"UPER, {ALWAYS}",
            ],
            rows,
        ),
    ]


def _doubts() -> list[str]:
    return [
        "## What explains it, and doubts",
        "",
        "- Event-driven pays by lane change, always-on by second and vehicle. Both grow with the"
        " number of",
        "  vehicles, since each answers an Advertisement; but the Advertisement itself, most of"
        " what is sent,",
        "  is one vehicle's, and weighs less among more.",
        '- The paper gives no sizes, no encoding and no amount for always-on: its "more than 10'
        ' times" is the',
        "  only figure. Its Fig. 7 is compared in shape, not in bytes per second.",
        "- All Intentions fall into a few hundredths of a second. On a shared radio they would"
        " collide and be",
        "  sent again; this is not in the model, and counts against event-driven.",
        "- ETSI CAMs are sent 1 to 10 times a second, as the vehicle moves; at most, the paper's"
        " rate, their",
        "  part is largest, and what event-driven saves with CAMs smallest.",
        "- More than one lane change at the same time, and vehicles of which not all hear one"
        " another, were",
        "  not run.",
    ]


def figures(report: Values) -> Iterator[tuple[str, Figure]]:
    """Fig. 7 in each codec, and the scaling."""
    s = report["summary"]
    for name in CODECS:
        yield f"fig7-{name}", _fig_7(s, name)
    yield "scaling", _scaled(s)


def _fig_7(s: Values, name: str) -> Figure:
    figure, plots = drawing.plots(2, height=6.5)
    for plot, n, letter in zip(plots, ("2", "4"), "ab", strict=True):
        _stacked(plot, s["time"][n][name], s["bin_ms"] / 1000)
        plot.set_title(f"({letter}) {n} vehicles", loc="left", fontsize=10)
        plot.set_ylabel(f"kB/s ({name.upper()})")
    for plot in plots[:-1]:
        plot.sharex(plots[-1])
        plot.sharey(plots[-1])
    plots[-1].set_xlabel("time, s (the turn signal is set at 1 s)")
    handles, labels = plots[-1].get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside right upper", fontsize=8)
    return figure


def _stacked(plot: Axes, time: Values, width: float) -> None:
    number = len(time[ALWAYS])
    left = [width * n for n in range(number)]
    below = [0.0] * number
    for kind, colour in COLOURS.items():
        values = [value / width / 1000 for value in time.get(kind, [0] * number)]
        plot.bar(left, values, width, below, align="edge", color=colour, label=kind)
        below = [a + b for a, b in zip(below, values, strict=True)]
    edges = [*left, left[-1] + width]
    both = zip(time[ALWAYS], time["CAM"], strict=True)
    heights = [(offer + cam) / width / 1000 for offer, cam in both]
    label = f"{ALWAYS}, with CAMs"
    plot.stairs(heights, edges, baseline=None, color="black", linestyle="--", label=label)
    plot.set_xlim(0, edges[-1])


def _scaled(s: Values) -> Figure:
    figure, plots = drawing.plots(1, 2, height=4.2)
    usual = min(each["participants"] for each in s["many"])
    many = [each for each in s["many"] if each["participants"] == usual]
    styles = {
        "always": ("#cc3311", "o-"),
        "busiest": ("#ee7733", "v:"),
        "maneuver": ("#0077bb", "s-"),
        "minute": ("#009988", "^--"),
        "cams": ("#888888", "-"),
    }
    for plot, name in zip(plots, CODECS, strict=True):
        for case, (colour, style) in styles.items():
            plot.plot(
                [each["vehicles"] for each in many],
                [100 * each["channel"][name][case] for each in many],
                style,
                color=colour,
                markersize=4,
                label=CASES[case],
            )
        raised = [each for each in s["many"] if each["participants"] > usual]
        for case in ("busiest", "maneuver") if raised else ():
            plot.plot(
                [each["vehicles"] for each in raised],
                [100 * each["channel"][name][case] for each in raised],
                styles[case][1][0],
                color=styles[case][0],
                fillstyle="none",
                label="max_participants raised" if case == "maneuver" else None,
            )
        plot.set_title(name.upper(), loc="left", fontsize=10)
        plot.set_xlabel("vehicles in range")
        plot.set_ylabel(f"share of {s['channel_bit_s'] / 1e6:g} Mbit/s, CAMs included, %")
        plot.set_ylim(bottom=0)
    plots[0].legend(fontsize=8)
    return figure
