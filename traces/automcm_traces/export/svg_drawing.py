"""Draws a run as SVG: a line for each station, time downwards, an arrow for each message.

Times count from the first event, with aligned clocks. Copies of a message are one arrow. Time
between events takes no space; a break marks a long wait. The line of a station is thick while it
acts. CAMs are left out. A legend says what the lines mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape

from automcm_spec.log_format.event_text import safe, summary
from automcm_spec.log_format.log import Event, Send
from automcm_traces.explain.log_table import Phases
from automcm_traces.system.copy_folding import Fold, Key, folded, key_of
from automcm_traces.system.event_order import Node
from automcm_traces.system.fates import ANYONE, Arrow
from automcm_traces.system.log_merge import Merged

COLUMN, ROW, TOP, LEFT = 190, 15, 46, 160
"""In pixels: between stations, between events, above the first event, left of the first station."""
SHORT = 30
"""The distance in pixels from the addressee at which the arrow of an unreceived message ends."""
WAIT_MS = 1000
"""A longer time between events is marked by a break."""
COLOURS = {"delivered": "#1a6e4a", "duplicated": "#1a6e4a", "lost": "#b3261e", "forged": "#b3261e"}
COLOURS["rejected"] = COLOURS["lost"]
OTHER = "#6b7280"
KEY = {
    "delivered": "received",
    "lost": "lost",
    "rejected": "rejected",
    "unobserved": "one end in no log",
}
"""By fate, the words of the legend."""
ENDS = {"delivered": "l-6 -4m6 4l-6 4", "lost": "m-4 -4l8 8m0 -8l-8 8", "rejected": "m0 -5v10"}
"""By fate, the end of a sample line in the legend."""
SAMPLE = 38
"""The distance in pixels from the start of a sample to its words."""
DASHED = ("unobserved", "in_flight", "sender_unobserved", "forged")
STYLE = (
    "text{font:11px sans-serif;fill:#1f2933}.name{font-weight:bold;font-size:13px}"
    ".t,.wait{fill:#6b7280;text-anchor:end}.phase{fill:#5b3fa0}"
)


@dataclass(frozen=True, slots=True)
class _Places:
    x: dict[int, float]
    """By station."""
    y: dict[Node, float]
    """By event."""


def drawing(
    merged: Merged,
    names: Mapping[int, str] | None = None,
    *,
    absolute: bool = False,
    unfold: bool = False,
) -> str:
    """The drawing; ``names`` replace the ids of stations.

    With ``absolute``, times are those of the logs, each on its own clock. With ``unfold``, each
    copy of a message is an arrow.
    """
    arrows = [a for a in merged.arrows() if a.fate == "rejected" or not _event(merged, a).is_cam]
    named = {station for a in arrows for station in (a.source, a.to)}
    stations = sorted({*merged.stations, *named} - {ANYONE})
    phases = _phases(merged)
    starts = merged.clocks.starts(merged.logs)
    folds = _folded(merged, arrows, phases, unfold)
    ends = {node for fold in folds for node in (fold.first.leaves, fold.first.arrives)}
    shown = [n for n in merged.order if n in phases or n in ends]
    times = [merged.event(n).t_ms - starts[n[0]] for n in shown]
    places = _Places({station: LEFT + k * COLUMN for k, station in enumerate(stations)}, {})
    breaks: list[tuple[float, int]] = []
    y = TOP
    for node, at, before in zip(shown, times, [*times[:1], *times], strict=False):
        if at - before > WAIT_MS:
            y += 2 * ROW
            breaks.append((y - ROW / 2, at - before))
        y += ROW
        places.y[node] = y
    bottom = y + ROW
    height = bottom + 2 * ROW
    width = LEFT + COLUMN * (len(stations) - 1) + 110
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" role="img" aria-label="messages between stations">',
        f"<style>{STYLE}</style>",
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    for station in stations:
        x = places.x[station]
        name = escape(safe((names or {}).get(station, str(station))))
        lines.append(f'<text class="name" x="{x}" y="20" text-anchor="middle">{name}</text>')
        lines.append(f'<path d="M{x} 30V{bottom}" stroke="#c3c9d1"/>')
    lines += _acting(merged, phases, places, bottom)
    lines += [_break(y, ms, width) for y, ms in breaks]
    lines += [_arrow(merged, fold, places) for fold in folds]
    lines += _labels(merged, places, phases, [0] * len(starts) if absolute else starts)
    fates = [fate for fate in KEY if any(fold.first.fate == fate for fold in folds)]
    lines += _legend(fates, any(fold.mark for fold in folds), height - ROW)
    return "\n".join([*lines, "</svg>"]) + "\n"


def _break(y: float, ms: int, width: int) -> str:
    """A wave across the lines, and how long nothing is drawn."""
    wave = f'<path d="M{LEFT - 96} {y}q6 -5 12 0t12 0{"t12 0" * ((width - LEFT + 70) // 12)}"'
    time = f'<text class="wait" x="{LEFT - 100}" y="{y + 4}">+{ms / 1000:.2f} s</text>'
    return f'{wave} stroke="{OTHER}" fill="none"/>{time}'


def _legend(fates: list[str], copies: bool, y: int) -> Iterator[str]:
    """What the lines of this drawing mean, in one row."""
    x = 20

    def text(word: str) -> str:
        nonlocal x
        at, x = x, x + 7 * len(word) + 14
        return f'<text x="{at}" y="{y + 4}">{word}</text>'

    for fate in fates:
        colour = COLOURS.get(fate, OTHER)
        dash = ' stroke-dasharray="3 3"' if fate in DASHED else ""
        yield f'<path d="M{x} {y}h28{ENDS.get(fate, "")}" stroke="{colour}"{dash} fill="none"/>'
        x += SAMPLE
        yield text(KEY[fate])
    yield f'<rect x="{x}" y="{y - 2}" width="28" height="5" fill="#5b3fa0"/>'
    x += SAMPLE
    yield text("acts as agreed")
    if copies:
        yield text("\u00d72: two copies")


def _folded(
    merged: Merged, arrows: list[Arrow], phases: dict[Node, str], unfold: bool
) -> list[Fold[Arrow]]:
    """The arrows in the order of their starts; copies between two changes of phase are one."""
    row_of = {node: row for row, node in enumerate(merged.order)}
    items: list[tuple[int, Arrow | None]] = [(row_of[node], None) for node in phases]
    items += [(row_of[_start(arrow)], arrow) for arrow in arrows]
    items.sort(key=lambda item: (item[0], item[1] is not None))

    def key(item: tuple[int, Arrow | None]) -> Key | None:
        arrow = item[1]
        if unfold or arrow is None:
            return None
        return key_of(arrow.source, _event(merged, arrow), (arrow.to, arrow.word))

    return [
        Fold(fold.first[1], fold.times) for fold in folded(items, key) if fold.first[1] is not None
    ]


def _start(arrow: Arrow) -> Node:
    node = arrow.leaves or arrow.arrives
    assert node is not None, "an arrow has an end that is logged"
    return node


def _event(merged: Merged, arrow: Arrow) -> Event:
    return merged.event(_start(arrow))


def _phases(merged: Merged) -> dict[Node, str]:
    """The phases, where they change."""
    phases = Phases()
    found = ((node, phases.change(node[0], merged.event(node))) for node in merged.order)
    return {node: phase for node, phase in found if phase}


def _acting(merged: Merged, phases: dict[Node, str], places: _Places, end: float) -> Iterator[str]:
    """A thick line from ACTUATING to the next phase."""
    for k, station in enumerate(merged.stations):
        own = [(places.y[node], phase) for node, phase in phases.items() if node[0] == k]
        for n, (y, phase) in enumerate(own):
            if phase == "ACTUATING":
                until = own[n + 1][0] if n + 1 < len(own) else end
                x = places.x[station]
                yield f'<path d="M{x} {y}V{until}" stroke="#5b3fa0" stroke-width="5"/>'


def _arrow(merged: Merged, fold: Fold[Arrow], places: _Places) -> str:
    """An arrow from transmission to reception; if the message was lost, it ends in a cross.

    An end that no log shows is level with the other, and short of its station.
    """
    arrow = fold.first
    at = [places.y[node] for node in (arrow.leaves, arrow.arrives) if node is not None]
    x = places.x.get(arrow.source, places.x.get(arrow.to, 0) - SHORT * 2)
    far = places.x.get(arrow.to, x + SHORT * 2)
    way = 1 if far > x else -1
    colour = COLOURS.get(arrow.fate, OTHER)
    dash = ' stroke-dasharray="3 3"' if arrow.fate in DASHED else ""
    if arrow.leaves is None:
        x += SHORT * way
    if arrow.arrives is None:
        end = far - SHORT * way
        drawn = f'<path d="M{x} {at[0]}H{end}" stroke="{colour}"{dash}/>'
        if arrow.fate == "lost":
            drawn += f'<path d="M{end - 4} {at[0] - 4}l8 8m0 -8l-8 8" stroke="{colour}"/>'
    else:
        head = f"L{far} {at[-1]}m{-6 * way} -4l{6 * way} 4l{-6 * way} 3"
        if arrow.fate == "rejected":  # a bar in place of a head
            head = f"L{far} {at[-1]}m{-6 * way} -6v12"
        drawn = f'<path d="M{x} {at[0]}{head}" stroke="{colour}" fill="none"{dash}/>'
    if fold.mark:
        anchor = "end" if way > 0 else "start"
        drawn += (
            f'<text x="{far - 10 * way}" y="{at[-1] - 4}" text-anchor="{anchor}">{fold.mark}</text>'
        )
    about = " ".join([f"{safe(summary(_event(merged, arrow)))}: {arrow.word}", fold.mark]).strip()
    return f"<g><title>{escape(about)}</title>{drawn}</g>"


def _labels(
    merged: Merged, places: _Places, phases: dict[Node, str], starts: list[int]
) -> Iterator[str]:
    """Times and types of sent messages, and phases, beside the line."""
    for node, y in places.y.items():
        event, x = merged.event(node), places.x[merged.stations[node[0]]]
        last = max(places.x.values())
        if isinstance(event, Send) and not event.is_cam:
            dst = event.message.get("dst")
            to = places.x[dst] if isinstance(dst, int) and dst in places.x else last - 1
            side, anchor = (6, "start") if to > x else (-6, "end")
            text = escape(safe(_about(event)))
            yield f'<text x="{x + side}" y="{y - 3}" text-anchor="{anchor}">{text}</text>'
            seconds = (event.t_ms - starts[node[0]]) / 1000
            yield f'<text class="t" x="{LEFT - 100}" y="{y + 4}">{seconds:.2f} s</text>'
        if node in phases:
            side, anchor = (-6, "end") if x == LEFT else (6, "start")
            yield (
                f'<text class="phase" x="{x + side}" y="{y + 11}" text-anchor="{anchor}">'
                f"{escape(safe(phases[node]))}</text>"
            )


def _about(event: Send) -> str:
    """The type of a message, and the field that distinguishes it from others of its type."""
    m, of = event.message, event.message.get("of")
    match m["type"]:
        case "Acceptance":
            return "Acceptance" if m.get("accepted") else f"Acceptance: {m.get('reason')}"
        case "Cancel":
            return f"Cancel: {m.get('reason')}"
        case "Ack" if isinstance(of, dict):
            return f"Ack of {of.get('type')}"
    return str(m["type"])
