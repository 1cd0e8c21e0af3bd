"""The values that a shell completes, by what an option or argument takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module


def _of(module: str, name: str) -> Iterable[str]:
    """The keys of a table, or the ids of what a function loads."""
    found = getattr(import_module(module), name)
    return [getattr(each, "id", "") or each.cfg for each in found()] if callable(found) else found


def _completing(*tables: tuple[str, str]) -> Callable[[str], list[str]]:
    def complete(incomplete: str) -> list[str]:
        values = [value for table in tables for value in _of(*table)]
        return sorted(value for value in values if value.startswith(incomplete))

    return complete


_MODELS = "automcm_spec.model_checking.models"
_RULES = "automcm_spec.vocabulary.rules", "RULES"
profiles, properties = _completing((_MODELS, "PROFILES")), _completing((_MODELS, "PROPERTIES"))
models, rules = _completing((_MODELS, "load")), _completing(_RULES)
selectors = _completing(_RULES, ("automcm_conformance.suite.purposes", "load"))
scenarios = _completing(("automcm_simulation.traffic_scenarios.catalogue", "SCENARIOS"))
