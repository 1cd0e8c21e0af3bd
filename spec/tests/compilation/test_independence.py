"""The lemmas N-1 to N-3 on the compiled station, in more sessions than TLC has.

They notice every edit of Station.tla that couples sessions, and no member of the interface between
sessions can be left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
from coupled_stage import COUPLED, edited

from automcm_maintenance.compilation import independence, sany
from automcm_maintenance.compilation.independence import LEMMAS, OpenLimits, WalkSample
from automcm_spec.model_checking import models
from automcm_spec.vocabulary.parameters import Parameters

PARAMETERS = Parameters()
REAL = OpenLimits(
    max_rounds=PARAMETERS.max_rounds,
    max_participants=PARAMETERS.max_participants,
    outbox_limit=PARAMETERS.outbox_limit,
    memory_limit=PARAMETERS.memory_limit,
    peers=frozenset({2, 3, 4, 5}),
    own_sessions=frozenset({1, 2, 3, 4}),
    peer_sessions=frozenset({1, 2}),
)
SCARCE = replace(
    REAL, max_rounds=2, max_participants=2, outbox_limit=4, memory_limit=2, peers=REAL.peers - {5}
)
"""Sessions compete for room in the outbox and in the memory."""
LIMITS = (REAL, SCARCE)
FEW, MANY, EDITED = 2_000, 50_000, 60_000


@pytest.fixture(scope="module")
def xml() -> bytes:
    return sany.export(independence.PLAN.module)


def sampled(module: ModuleType, number: int, *lemmas: str) -> Iterator[WalkSample]:
    for limits in LIMITS:
        yield independence.sample(limits.station(module), number, 1, lemmas or tuple(LEMMAS))


def check(number: int, xml: bytes) -> list[WalkSample]:
    samples = list(sampled(independence.load(xml=xml), number))
    assert [found.violation for found in samples] == [None, None]
    return samples


@pytest.mark.slow
def test_the_lemmas_hold_with_many_sessions(xml: bytes) -> None:
    check(FEW, xml)


@pytest.mark.slow
def test_the_lemmas_hold_for_a_hundred_thousand_inputs(xml: bytes) -> None:
    samples = check(MANY, xml)
    station = REAL.station(independence.load(xml=xml))
    assert [found.phases for found in samples] == [station.phases] * 2
    assert samples[0].sessions >= 4


LEMMA_MODELS = [m for m in models.load() if m.module == independence.PLAN.module]


@pytest.mark.slow
@pytest.mark.parametrize(
    "model", [m for m in LEMMA_MODELS if m.expect == "violates"], ids=lambda m: m.cfg
)
def test_a_must_fail_model_fails_the_sample_too(model: models.Model, xml: bytes) -> None:
    module = independence.load(xml=xml, substitutions=models.replaced_in(model.config))
    assert model.property is not None
    assert any(found.violation for found in sampled(module, EDITED, model.property))


@pytest.mark.slow
@pytest.mark.parametrize("what", COUPLED)
def test_an_edit_that_couples_sessions_breaks_a_lemma(what: str, tmp_path: Path) -> None:
    module = independence.load(edited(COUPLED[what], tmp_path))
    assert any(found.violation for found in sampled(module, EDITED))
