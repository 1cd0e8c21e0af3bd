"""The fate of each transmission in merged logs, and the messages that nobody can have sent."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterator
from itertools import chain
from typing import NamedTuple

from automcm_spec.log_format.log import Receive, Send
from automcm_spec.vocabulary.messages import Fields, same
from automcm_traces.checker.finding import Finding, Where
from automcm_traces.system.event_order import Node
from automcm_traces.system.fates import ANYONE, FATES, Fate, addressees
from automcm_traces.system.log_merge import Merged, sends


class Forged(NamedTuple):
    """A received message that nobody can have sent, and the reason."""

    at: Node
    where: str
    message: str
    why: str

    def __str__(self) -> str:
        return f"{self.where}: FORGED {self.message}: {self.why}"


class Deliveries:
    """The fates of all transmissions in merged logs."""

    def __init__(self, merged: Merged) -> None:
        self._merged = merged
        self.outcomes: dict[tuple[Node, int], Fate] = {}
        """By transmission and addressee, sorted by sender and line; a broadcast has an outcome for
        each other station with a log."""
        self.forged = [_forged(merged, node) for node in merged.forged]
        """Received messages that nobody can have sent."""
        fates: dict[tuple[Node | None, int], Fate] = {}
        came = Counter[tuple[Node | None, int]]()
        for arrow in chain.from_iterable(merged.arrows.values()):
            way = arrow.leaves, arrow.to
            fates.setdefault(way, arrow.fate)
            came[way] += arrow.fate != "rejected" and arrow.arrives is not None
        for node, sent in sends(merged):
            for to in addressees(merged.stations[node[0]], sent.message, merged.stations):
                way = node, to
                n = came[way]
                self.outcomes[way] = "duplicated" if n > 1 else "delivered" if n else fates[way]

    def counts(self) -> dict[str, dict[str, int]]:
        """By ``SRC-DST``, how often each outcome occurred, including CAMs."""
        found: dict[str, Counter[str]] = defaultdict(Counter)
        for ((i, _), to), outcome in self.outcomes.items():
            if to != ANYONE:
                found[f"{self._merged.stations[i]}-{to}"][outcome] += 1
        return {way: {o: n[o] for o in FATES if n[o]} for way, n in sorted(found.items())}

    def between(
        self, src: int, dst: int, first: int = 0, last: int | None = None, type_: str = ""
    ) -> Counter[str]:
        """The outcomes of the messages that ``src`` sent to ``dst`` in its events ``first`` to
        ``last``."""
        place, found = self._merged.place(src), Counter[str]()
        for ((i, k), to), outcome in self.outcomes.items():
            if (i, to) == (place, dst) and first <= k and (last is None or k <= last):
                event = self._merged.event((i, k))
                if isinstance(event, Send) and type_ in ("", event.message["type"]):
                    found[outcome] += 1
        return found


def _forged(merged: Merged, node: Node) -> Forged:
    e = merged.event(node)
    assert isinstance(e, Receive) and e.message is not None, "only received messages are forged"
    text = f"{e.message['type']} from {e.message.get('src')}" + (f", tx {e.tx}" if e.tx else "")
    return Forged(node, merged.where(node), text, merged.forged[node])


def forged_receptions(merged: Merged) -> dict[str, Finding]:
    """By file: the first received message that differs from the message its sender logged under the
    same ``tx``."""
    sent = {e.tx: e.message for _, e in reversed([*sends(merged)])}
    found: dict[str, Finding] = {}
    for i, k in merged.forged:
        (at, e), file = merged.logs[i].events[k], merged.logs[i].file
        if isinstance(e, Receive) and e.tx is not None and file not in found:
            m, original = e.message or {}, sent.get(e.tx)
            why = "its sender did not send it"
            if original:
                why = "that transmission was another message"
            received = f"receive {m.get('type')} from {m.get('src')} as transmission {e.tx}"
            text = f"{received}: forged, {why}"
            differ = tuple(_differences(original, m)) if original else ()
            found[file] = Finding("forged", "forged", "", Where(file, at), differ, text)
    return found


def _differences(original: Fields, m: Fields) -> Iterator[str]:
    """A line for each field in which a received message differs from the sent one."""
    for name in sorted(original.keys() | m.keys()):
        was, is_ = (
            "nothing" if one is None else json.dumps(one)
            for one in (original.get(name), m.get(name))
        )
        if not same(original.get(name), m.get(name)):
            yield f"{name}: {was} was sent, not {is_}"
