"""The values that a shell completes, by what an option or argument takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

PROFILES = ("quick", "full", "deep")


def _rules() -> Iterable[str]:
    from automcm_spec.vocabulary.rules import RULES

    return RULES


def _selectors() -> Iterable[str]:
    from automcm_conformance.suite import purposes

    return [*_rules(), *(purpose.id for purpose in purposes.load())]


def _models() -> Iterable[str]:
    from automcm_spec.model_checking import models

    return [model.cfg for model in models.load()]


def _properties() -> Iterable[str]:
    from automcm_spec.model_checking.models import PROPERTIES

    return PROPERTIES


def _languages() -> Iterable[str]:
    from automcm_conformance.adapter.new_adapter import FILES

    return FILES


def _scenarios() -> Iterable[str]:
    from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS

    return SCENARIOS


def _completes(values: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    def complete(incomplete: str) -> list[str]:
        return sorted(each for each in values() if each.startswith(incomplete))

    return complete


profiles = _completes(lambda: PROFILES)
rules, selectors, models = map(_completes, (_rules, _selectors, _models))
properties, languages, scenarios = map(_completes, (_properties, _languages, _scenarios))
