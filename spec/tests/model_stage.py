"""Models by name, and their verdicts, found once for all tests."""

from __future__ import annotations

from functools import cache

from automcm_spec.model_checking import models
from automcm_spec.model_checking.models import Model, ModelVerdict

LISTED = {model.cfg: model for model in models.load()}
_CHECK = models.check


@cache
def checked(cfg: str) -> ModelVerdict:
    """TLC's verdict, as expected."""
    verdict = _CHECK(LISTED[cfg])
    assert verdict.ok, verdict.problem
    return verdict


def judged(model: Model) -> ModelVerdict:
    """The verdict on a changed entry, from what TLC found in the model of that name."""
    verdict = checked(model.cfg)
    assert verdict.result is not None
    return models.judged(model, verdict.result, verdict.reached)
