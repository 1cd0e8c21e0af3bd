"""Replays behaviours of the closed models: several stations, each behind its own adapter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from automcm_conformance.compare import Adapter
from automcm_spec.oracle import canonical

Json = Any
ME = 1


def _swap(id_: int, station: int) -> int:
    """Ids as ``station`` sees them: it is itself ME."""
    return {station: ME, ME: station}.get(id_, id_)


def _session(s: Json, station: int) -> Json:
    return [_swap(s[0], station), s[1]]


def _entry(e: Json, station: int) -> Json:
    return [e[0], _swap(e[1], station), _session(e[2], station), *e[3:]]


def _set(values: Sequence[Json]) -> Json:
    return sorted(values, key=canonical)


def state_seen(state: Json, station: int) -> Json:
    """A station's state with its own id as ME."""
    out = list(state)
    out[2] = _session(state[2], station)
    out[3], out[4] = (sorted(_swap(p, station) for p in state[n]) for n in (3, 4))
    out[5] = _swap(state[5], station)
    out[10] = _set([_session(s, station) for s in state[10]])
    out[11] = _set([_entry(e, station) for e in state[11]])
    return out


def input_seen(value: Json, station: int) -> Json:
    """An input with the station's own id as ME."""
    match value[0]:
        case "receive":
            m = list(value[1])
            m[1], m[2] = _swap(m[1], station), _swap(m[2], station)
            m[3] = _session(m[3], station)
            return ["receive", m, value[2]]
        case "command":
            _, name, session, proposal, target = value
            return ["command", name, _session(session, station), proposal, _swap(target, station)]
        case "expire" if len(value[1]) > 1:
            name, about = value[1]
            seen = _swap(about, station) if isinstance(about, int) else _entry(about, station)
            return ["expire", [name, seen]]
    return value


def replay(
    behaviour: Sequence[tuple[int, Json, Json]], adapter: Callable[[], Adapter]
) -> str | None:
    """Drive fresh stations through a behaviour.  None, or the first difference in words."""
    stations: dict[int, tuple[Adapter, Any]] = {}
    for n, (who, value, after) in enumerate(behaviour, 1):
        if who not in stations:
            fresh = adapter()
            fresh.reset()
            stations[who] = (fresh, fresh.save())
        station, saved = stations[who]
        station.put_state(saved)
        seen = input_seen(value, who)
        try:
            station.apply(seen)
        except Exception as error:  # an implementation may raise anything
            return f"step {n}, station {who}, {canonical(seen)}: {type(error).__name__}: {error}"
        wanted, found = state_seen(after, who), station.state()
        if wanted != found:
            return (
                f"step {n}, station {who}, {canonical(seen)}: "
                f"spec {canonical(wanted)}, code {canonical(found)}"
            )
        stations[who] = (station, station.save())
    return None
