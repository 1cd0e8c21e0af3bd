"""The list of models, and the comparison of what TLC finds with it."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from automcm_spec import models
from automcm_spec.models import Model, ModelError, Verdict
from automcm_spec.paths import MODELS


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(MODELS, tmp_path / "models"))


def edit(folder: Path, old: str, new: str) -> None:
    path = folder / models.EXPECTATIONS
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def model(cfg: str, **changes: object) -> Model:
    found = next(m for m in models.load() if m.cfg == cfg)
    return Model.model_validate(found.model_dump() | changes)


def test_every_property_is_shown_to_be_needed() -> None:
    broken = {m.property for m in models.load() if m.expect == "violates"}
    assert broken == set(models.PROPERTIES) - {"TypeInv"}


def test_models_that_hold_check_everything() -> None:
    for m in models.load():
        if m.expect == "holds" and m.module == "System":
            assert set(models.checked_in(MODELS / f"{m.cfg}.cfg")) == set(
                models.PROPERTIES.values()
            )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: (d / "extra.cfg").touch(), "extra.cfg is not listed"),
        (lambda d: (d / "rejoin.cfg").unlink(), "there is no rejoin.cfg"),
        (lambda d: (d / models.EXPECTATIONS).unlink(), "cannot be read"),
        (lambda d: edit(d, "[[model]]", "[[model"), "expectations.toml: "),
        (lambda d: edit(d, "[[model]]", "version = 1\n[[model]]"), "unknown key version"),
        (lambda d: edit(d, "depth = ", "deep = "), "deep: Extra inputs"),
        (lambda d: edit(d, "depth = ", "length = "), "a model that holds needs depth"),
        (lambda d: edit(d, "depth = ", "length = 3\ndepth = "), "holds has no length"),
        (lambda d: edit(d, 'module = "System"', 'module = "Sistem"'), "no module Sistem"),
        (lambda d: edit(d, 'property = "S-3"', 'property = "S-4"'), "S-4 is not AcceptedInv"),
        (lambda d: edit(d, 'cfg = "rejoin"', 'cfg = "retarget"'), "lists retarget twice"),
        (
            lambda d: shutil.copy(d / "unreduced.cfg", d / "rejoin.cfg"),
            "rejoin.cfg must check AgreementInv and nothing else",
        ),
        (lambda d: (d / "unreduced.cfg").write_text("INIT Init"), "unreduced.cfg checks nothing"),
    ],
)
def test_a_list_that_does_not_fit(
    folder: Path, change: Callable[[Path], object], message: str
) -> None:
    change(folder)
    with pytest.raises(ModelError) as caught:
        models.load(folder)
    assert message in str(caught.value)


def test_a_property_that_the_spec_lacks(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"System\.tla cannot be read"):
        models.load(MODELS, tmp_path)
    (tmp_path / "System.tla").write_text("TypeInv == TRUE\n")
    with pytest.raises(ModelError, match="does not define the property OneSessionProp"):
        models.load(MODELS, tmp_path)


def test_as_expected() -> None:
    seen: list[Verdict] = []
    chosen = [model("bare_ack"), model("unreduced")]
    verdicts = models.check_all(chosen, on_done=seen.append)
    assert [v.problem for v in verdicts] == [None, None]
    assert all(v.ok for v in verdicts)
    assert [(v.model.cfg, v.outcome, v.property) for v in verdicts] == [
        ("bare_ack", "violates", "S-6"),
        ("unreduced", "holds", None),
    ]
    assert len(verdicts[0].trace) == chosen[0].length
    assert sorted(v.model.cfg for v in seen) == ["bare_ack", "unreduced"]


def test_other_counts_than_expected() -> None:
    verdict = models.check(model("restarts", distinct_states=7))
    assert not verdict.ok
    assert verdict.result is not None
    assert verdict.problem == (f"distinct_states is {verdict.result.distinct_states}, 7 expected")
    length = model("bare_ack").length
    assert models.check(model("bare_ack", length=99)).problem == (
        f"length is {length}, 99 expected"
    )


def test_another_property_than_expected() -> None:
    verdict = models.check(model("bare_ack", property="S-5", breaks="NoHazardInv"))
    assert verdict.problem == "S-6 is violated; S-5 was to be"


FAILS = {"property": "S-6", "breaks": "AckedProp", "length": 6}
HOLDS = {"distinct_states": 1, "states": 1, "depth": 1}
NO_FAILS, NO_HOLDS = dict.fromkeys(FAILS), dict.fromkeys(HOLDS)


def test_another_outcome_than_expected() -> None:
    verdict = models.check(model("bare_ack", expect="holds", **HOLDS, **NO_FAILS))
    assert verdict.problem == "S-6 is violated; everything was to hold"
    verdict = models.check(model("restarts", expect="violates", **FAILS, **NO_HOLDS))
    assert verdict.problem == "nothing is violated; S-6 was to be"


def test_no_verdict() -> None:
    verdict = models.check(model("unreduced"), timeout_s=0.2)
    assert (verdict.outcome, verdict.result, verdict.trace, verdict.ok) == (
        "error",
        None,
        (),
        False,
    )
    assert verdict.error is not None
    assert verdict.error.kind == "timeout"


def test_an_interrupt_ends_all_runs() -> None:
    def interrupt(_: Verdict) -> None:
        raise KeyboardInterrupt

    chosen = [model("bare_ack", seconds=999.0), model("one_by_three"), model("two_by_one")]
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        models.check_all(chosen, on_done=interrupt)
    assert time.monotonic() - started < 10
