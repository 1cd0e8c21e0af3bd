"""A radio that does what a script says: when each copy of a message arrives, and whether."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Literal

from automcm_conformance.adapter.protocol import MESSAGE_TYPES, Object
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.parameters import derived, longest_delay


@dataclass(frozen=True, slots=True)
class Rule:
    """What happens to the copies of these ``types`` from ``src`` to ``dst``; 0 is any station.

    ``lose``: none arrives.  ``again``: each arrives once more, ``by_ms`` later.  ``late``: once
    more, as late as t_life lets it.  ``jitter``: its delay is random, up to half of t_resend.
    """

    does: Literal["lose", "again", "late", "jitter"]
    types: tuple[str, ...] = (*MESSAGE_TYPES, "CAM")
    src: int = 0
    dst: int = 0
    chance: float = 1.0
    first: bool = False
    """Only the first copy of a message that would reach a station."""
    acting_ms: int | None = None
    """Only from so many ms after a prescriber has entered ACTUATING."""
    by_ms: int = 0


class Radio:
    """A copy takes a tenth of t_resend where no rule says otherwise.  The same seed, the same
    fate.  ``parameters`` are those of ``reset``; ``acting_at`` is when a prescriber began to act.
    """

    def __init__(self, rules: Sequence[Rule], parameters: Mapping[str, int], seed: int) -> None:
        self.acting_at: int | None = None
        self._rules = rules
        self._random = Random(seed)
        self._resend = parameters["t_resend"]
        self._life = derived(parameters)["t_life"]
        self._delay = longest_delay(parameters)
        self._heard: set[tuple[int, str]] = set()

    def arrivals(self, m: Object, src: int, dst: int, now: int) -> list[int]:
        """When copies of this transmission arrive at ``dst``, in ms; those of one time in order."""
        first = (dst, canonical(m)) not in self._heard
        self._heard.add((dst, canonical(m)))
        delays = [max(1, self._resend // 10)]
        for rule in self._rules:
            if not self._about(rule, m, src, dst, now) or (rule.first and not first):
                continue
            if rule.chance < 1 and self._random.random() >= rule.chance:
                continue
            match rule.does:
                case "lose":
                    delays = []
                case "again":
                    delays += [delay + rule.by_ms for delay in delays]
                case "late":
                    delays += [self._life - self._resend // 10 for _ in delays]
                case "jitter":
                    delays = [self._random.randint(1, max(1, self._delay - 1)) for _ in delays]
        return [now + delay for delay in delays]

    def _about(self, rule: Rule, m: Object, src: int, dst: int, now: int) -> bool:
        if m["type"] not in rule.types or rule.src not in (0, src) or rule.dst not in (0, dst):
            return False
        if rule.acting_ms is None:
            return True
        return self.acting_at is not None and now >= self.acting_at + rule.acting_ms
