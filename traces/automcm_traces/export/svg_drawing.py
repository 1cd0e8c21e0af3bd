"""Draws a run as SVG: a line for each station, time downwards, an arrow for each message.

Events are ordered by time. Where clocks differ so much that a reception would come before its
transmission, they follow the partial order. Time between events takes no space. The line of a
station is thick while it acts. CAMs are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape

from automcm_traces.format.event_text import safe
from automcm_traces.format.log import Event, Receive, Send
from automcm_traces.system.clock_offsets import Clocks
from automcm_traces.system.delivery import Deliveries, Delivery
from automcm_traces.system.log_merge import Merged, Node

COLUMN, ROW, TOP, LEFT = 190, 15, 46, 160
"""In pixels: between stations, between events, above the first event, left of the first station."""
SHORT = 30
"""The distance in pixels from the addressee at which the arrow of an unreceived message ends."""
COLOURS = {"delivered": "#1a6e4a", "duplicated": "#1a6e4a", "lost": "#b3261e"}
OTHER = "#6b7280"
STYLE = (
    "text{font:11px sans-serif;fill:#1f2933}.name{font-weight:bold;font-size:13px}"
    ".t{fill:#6b7280;text-anchor:end}.phase{fill:#5b3fa0}"
)


@dataclass(frozen=True, slots=True)
class _Places:
    x: dict[int, float]
    """By station."""
    y: dict[Node, float]
    """By event."""


def drawing(merged: Merged, names: Mapping[int, str] | None = None) -> str:
    """The drawing; ``names`` replace the ids of stations."""
    deliveries = [d for d in Deliveries(merged, Clocks(merged)).all if _drawn(merged.event(d.sent))]
    addressed = {d.to for d in deliveries}
    stations = sorted({*merged.stations, *addressed})
    phases = _phases(merged)
    shown = [n for n in _ordered(merged) if n in phases or _drawn(merged.event(n))]
    places = _Places(
        {station: LEFT + k * COLUMN for k, station in enumerate(stations)},
        {node: TOP + ROW * (k + 1) for k, node in enumerate(shown)},
    )
    height = TOP + ROW * (len(shown) + 2)
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
        lines.append(f'<path d="M{x} 30V{height - ROW}" stroke="#c3c9d1"/>')
    lines += _acting(merged, phases, places, height - ROW)
    for delivery in deliveries:
        lines += _arrow(merged, delivery, places)
    lines += _labels(merged, places, phases)
    return "\n".join([*lines, "</svg>"]) + "\n"


def _ordered(merged: Merged) -> list[Node]:
    def time(node: Node) -> int:
        return merged.event(node).t_ms

    if any(time(to) < time(match.sent) for to, match in merged.matches.items()):
        return merged.order
    return sorted(merged.order, key=time)


def _drawn(event: Event) -> bool:
    message = event.message if isinstance(event, Send | Receive) else None
    return message is not None and message["type"] != "CAM"


def _phases(merged: Merged) -> dict[Node, str]:
    """The phases, where they change."""
    now = ["STANDALONE"] * len(merged.logs)
    found = {}
    for node in merged.order:
        phase = merged.event(node).phase
        if phase is not None and phase != now[node[0]]:
            now[node[0]] = found[node] = phase
    return found


def _acting(merged: Merged, phases: dict[Node, str], places: _Places, end: float) -> Iterator[str]:
    """A thick line from ACTUATING to the next phase."""
    for k, station in enumerate(merged.stations):
        own = [(places.y[node], phase) for node, phase in phases.items() if node[0] == k]
        for n, (y, phase) in enumerate(own):
            if phase == "ACTUATING":
                until = own[n + 1][0] if n + 1 < len(own) else end
                x = places.x[station]
                yield f'<path d="M{x} {y}V{until}" stroke="#5b3fa0" stroke-width="5"/>'


def _arrow(merged: Merged, delivery: Delivery, places: _Places) -> Iterator[str]:
    """An arrow from transmission to reception; if the message was lost, it ends in a cross."""
    x = places.x[merged.stations[delivery.sent[0]]]
    y, far = places.y[delivery.sent], places.x[delivery.to]
    colour = COLOURS.get(delivery.outcome, OTHER)
    for node in delivery.received:
        yield _head(x, y, far, places.y[node], colour)
    if not delivery.received:
        end = far - SHORT if far > x else far + SHORT
        dash = "" if delivery.outcome == "lost" else ' stroke-dasharray="3 3"'
        yield f'<path d="M{x} {y}H{end}" stroke="{colour}"{dash}/>'
        if delivery.outcome == "lost":
            yield f'<path d="M{end - 4} {y - 4}l8 8m0 -8l-8 8" stroke="{colour}"/>'


def _head(x: float, y: float, far: float, below: float, colour: str) -> str:
    way = 6 if far > x else -6
    return (
        f'<path d="M{x} {y}L{far} {below}m{-way} -4l{way} 4l{-way} 3" stroke="{colour}" '
        'fill="none"/>'
    )


def _labels(merged: Merged, places: _Places, phases: dict[Node, str]) -> Iterator[str]:
    """Times and types of sent messages, and phases, beside the line."""
    for node, y in places.y.items():
        event, x = merged.event(node), places.x[merged.stations[node[0]]]
        last = max(places.x.values())
        if isinstance(event, Send) and _drawn(event):
            dst = event.message.get("dst")
            to = places.x[dst] if isinstance(dst, int) and dst in places.x else last - 1
            side, anchor = (6, "start") if to > x else (-6, "end")
            text = escape(safe(_about(event)))
            yield f'<text x="{x + side}" y="{y - 3}" text-anchor="{anchor}">{text}</text>'
            yield f'<text class="t" x="{LEFT - 100}" y="{y + 4}">{event.t_ms / 1000:.2f} s</text>'
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
