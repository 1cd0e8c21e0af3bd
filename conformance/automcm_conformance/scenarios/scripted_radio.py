"""A scripted radio: decides whether and when each copy of a message arrives."""

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
    """The fate of copies of messages of ``types`` from ``src`` to ``dst``; 0 means any station.

    ``lose``: none arrives.  ``again``: each arrives twice, the second time ``by_ms`` later.
    ``late``: each arrives twice, the second time as late as t_life allows.  ``jitter``: the delay
    is random, up to half of t_resend.
    """

    does: Literal["lose", "again", "late", "jitter"]
    types: tuple[str, ...] = (*MESSAGE_TYPES, "CAM")
    src: int = 0
    dst: int = 0
    chance: float = 1.0
    first: bool = False
    """Applies only to the first copy of a message that would reach a station."""
    acting_ms: int | None = None
    """Applies only from this many ms after a prescriber has entered ACTUATING."""
    by_ms: int = 0


class ScriptedRadio:
    """Applies ``rules`` to each copy; without a rule a copy takes a tenth of t_resend.

    ``parameters`` are those of ``reset``.  The same ``seed`` gives the same delays and losses.
    """

    def __init__(self, rules: Sequence[Rule], parameters: Mapping[str, int], seed: int) -> None:
        self.acting_at: int | None = None
        """The time in ms at which a prescriber entered ACTUATING."""
        self._rules = rules
        self._random = Random(seed)
        self._resend = parameters["t_resend"]
        self._life = derived(parameters)["t_life"]
        self._delay = longest_delay(parameters)
        self._transmitted: set[tuple[int, str]] = set()

    def arrivals(self, m: Object, src: int, dst: int, now: int) -> list[int]:
        """The times in ms at which copies of a message sent at ``now`` arrive at ``dst``."""
        first = (dst, canonical(m)) not in self._transmitted
        self._transmitted.add((dst, canonical(m)))
        delays = [max(1, self._resend // 10)]
        for rule in self._rules:
            if not self._applies(rule, m, src, dst, now) or (rule.first and not first):
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

    def _applies(self, rule: Rule, m: Object, src: int, dst: int, now: int) -> bool:
        if m["type"] not in rule.types or rule.src not in (0, src) or rule.dst not in (0, dst):
            return False
        if rule.acting_ms is None:
            return True
        return self.acting_at is not None and now >= self.acting_at + rule.acting_ms
