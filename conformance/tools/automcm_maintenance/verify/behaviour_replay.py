"""Replays behaviours of the closed models: several stations, each behind its own adapter."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import TYPE_CHECKING

from automcm_spec.model_checking.tlc_simulation import Behaviour
from automcm_spec.vocabulary import renumbering
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.station import Session

if TYPE_CHECKING:
    from automcm_maintenance.verify.spec_mapping import Reference

ME = 1


def seen_by(station: int) -> renumbering.Rename:
    """A renaming of sessions that exchanges the ids of ``station`` and ME."""
    ids = {station: ME, ME: station}

    def to(session: Session) -> Session:
        return ids.get(session[0], session[0]), session[1]

    return to


def replay(behaviour: Behaviour, adapter: Callable[[], Reference]) -> str | None:
    """Replay a behaviour with new stations.  Returns the first difference as text, or None."""
    stations: defaultdict[int, Reference] = defaultdict(adapter)
    for n, (who, value, after) in enumerate(behaviour, 1):
        reference = stations[who]
        reference.put_state(reference.station.state)  # with its timers armed anew
        to = seen_by(who)
        seen = renumbering.input_of(value, to)
        try:
            reference.apply(seen)
        except Exception as error:  # an implementation may raise any exception
            return f"step {n}, station {who}, {canonical(seen)}: {type(error).__name__}: {error}"
        wanted, found = renumbering.state(after, to), reference.state()
        if wanted != found:
            return (
                f"step {n}, station {who}, {canonical(seen)}: "
                f"spec {canonical(wanted)}, code {canonical(found)}"
            )
    return None
