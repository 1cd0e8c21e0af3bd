"""The fate of each transmission in merged logs, and the messages that nobody can have sent."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterator

from automcm_spec.log_format.log import Receive
from automcm_spec.vocabulary.messages import Fields, same
from automcm_traces.checker.finding import Finding, Where
from automcm_traces.system.event_order import Node
from automcm_traces.system.fates import ANYONE, FATES, Fate, Fates, addressees
from automcm_traces.system.log_merge import Merged


def outcomes(merged: Merged) -> Iterator[tuple[Node, int, Fate]]:
    """Each transmission, by sender and line, with each addressee and what became of it there; a
    broadcast has an outcome for each other station with a log."""
    stations, fates = merged.stations, Fates(merged.matches)
    for i, ledger in enumerate(merged.matches.ledgers):
        for n, (k, t_ms) in enumerate(zip(ledger.sent.at, ledger.sent.times, strict=True)):
            for to in addressees(stations[i], merged.message((i, k)), stations):
                yield (i, k), to, fates.outcome(i, n, t_ms, to)


def counts(merged: Merged) -> dict[str, dict[str, int]]:
    """By ``SRC-DST``, how often each outcome occurred, including CAMs."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for (i, _), to, outcome in outcomes(merged):
        if to != ANYONE:
            found[f"{merged.stations[i]}-{to}"][outcome] += 1
    return {way: {o: n[o] for o in FATES if n[o]} for way, n in sorted(found.items())}


def named(merged: Merged, node: Node) -> str:
    """A received message, as text."""
    m, e = merged.message(node), merged.event(node)
    tx = f", tx {e.tx}" if isinstance(e, Receive) and e.tx else ""
    return f"{m['type']} from {m.get('src')}{tx}"


def forged(merged: Merged) -> tuple[str, ...]:
    """A line for each received message that nobody can have sent."""
    found = merged.forged.items()
    return tuple(f"{merged.where(at)}: FORGED {named(merged, at)}: {why}" for at, why in found)


def forged_receptions(merged: Merged) -> dict[str, Finding]:
    """By file: the first received message that differs from the message its sender logged under the
    same ``tx``."""
    found: dict[str, Finding] = {}
    for (i, k), why in merged.forged.items():
        (at, e), file = merged.logs[i].events[k], merged.logs[i].file
        if isinstance(e, Receive) and e.tx is not None and file not in found:
            m, sent = e.message or {}, merged.matches.find(e.tx)
            differ = () if sent is None else tuple(_differences(merged.message(sent), m))
            text = f"receive {named(merged, (i, k))}: forged, {why}"
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
