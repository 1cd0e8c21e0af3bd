"""The properties bite: each kernel with one thing changed must fail one of its properties.

The change is made to a copy of the source, which the tests then use instead of the module.
"""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Callable, Iterator
from types import ModuleType

import pytest
from hypothesis import Phase, settings

import automcm.kernels.convert

QUICK = settings(
    max_examples=1000, database=None, phases=[Phase.explicit, Phase.generate], deadline=None
)

# kernel, old text, new text, the test file, the properties of which one must fail
MUTANTS = [
    ("convert", "/ v[:-1])", "/ v[1:])", "convert", "interpolation"),
    ("convert", "np.cumsum(np.hypot(steps[:, 0], steps[:, 1])", "np.cumsum(steps[:, 0]", "convert",
     "increases interpolation"),
    ("convert", ".min(axis=1)[:, None] + NANOMETRE).argmax", ".max(axis=1)[:, None]).argmax",
     "convert", "closest"),
    ("convert", "x[: standing[0] + 1], v[: standing[0] + 1]", "x[: standing[-1] + 1], "
     "v[: standing[-1] + 1]", "convert", "increases interpolation"),
    ("thin", "np.concatenate([[0, last], np.concatenate(splits)", "np.concatenate([[0], "
     "np.concatenate(splits)", "thin", "some_of within_the_bound"),
    ("thin", "furthest / position, ", "0 * furthest, ", "thin", "within_the_bound"),
    ("thin", "np.maximum.reduceat(faster, starts) / speed", "0 * furthest", "thin",
     "within_the_bound"),
    ("thin", "- share[:, None] * step[part]", "", "thin", "straight_and_even paper"),
    ("thin", "> budget else", "> budget + 1 else", "thin", "some_of"),
    ("thin", "np.argsort(-np", "np.argsort(np", "thin", "least_effect"),
    ("thin", "fits, thinned, more = count, tried, 2 * more", "fits, more = count, 2 * more",
     "thin", "within_the_bound"),
    ("collide", "np.minimum(np.maximum(share, 0), 1)", "share", "collide", "brute"),
    ("collide", "np.minimum(np.maximum(share, 0), 1)", "0", "collide", "brute"),
    ("collide", "t = np.concatenate([a.t, b.t])", "t = np.concatenate([a.t, a.t])", "collide",
     "brute symmetric"),
    ("collide", "+ number(\"speed\", speed, 0) * clock_error", "", "collide", "clock_error"),
    ("collide", "if not each.stopped", "", "collide", "brute"),
    ("collide", "min(c / (", "min(c / -(", "collide", "first_time"),
    ("collide", "(2 - ROUNDING) * least", "(1 - ROUNDING) * least", "collide", "pairs_as many_as"),
    ("collide", "bound[:, -1] = np.inf", "pass", "collide", "pairs_as many_as chunks"),
    ("collide", "square <= limit[:, None]", "square == least[:, None]", "collide", "rounding"),
    ("collide", "square <= tie(least)", "square <= least", "collide", "rounding"),
    ("extents", "discs_a.inmost + discs_b.inmost", "-nearer", "extents", "brute"),
    ("extents", "within * within)", "limit * limit)", "extents", "brute"),
    ("extents", "math.hypot(half, side)", "side", "extents", "discs_cover"),
    ("extents", "min(half, side))", "side)", "extents", "discs_cover"),
    ("extents", "[:, None] - off_b)", "[:, None] - 0 * off_b)", "extents", "brute"),
    ("extents", "np.maximum(along, -way - along)", "along", "extents", "brute"),
    ("extents", "np.maximum(along, -way - along), 0)", "np.abs(along), 0)", "extents", "brute"),
    ("extents", "turn[still], way[still] = 1, 0", "", "extents", "brute within"),
    ("extents", "searchsorted(segment, side=\"right\") - 1, 0)",
     "searchsorted(segment, side=\"right\") - 1, 1)", "extents", "brute standing"),
    ("extents", "if length.min(initial=np.inf) <= NANOMETRE", "if False", "extents", "standing"),
    ("extents", "gone.min()", "0", "extents", "brute symmetric lorry within"),
    ("extents", "enters.min()", "enters.max()", "extents", "first_disc"),
    ("discover", "> NANOMETRE).sum", "< -NANOMETRE).sum", "discover", "counts"),
    ("discover", "> NANOMETRE).sum", "> 0).sum", "discover", "abreast"),
    ("discover", "ahead <= NANOMETRE", "ahead < -1", "discover", "without_comparing"),
    ("discover", "key=lambda i: ids[i])", "key=lambda i: -ids[i])", "discover", "counts abreast"),
    ("discover", "return min((_in", "return max((_in", "discover", "counts"),
    ("discover", "(0 - edges[:, 0], edges[:, 1])", "(edges[:, 1], edges[:, 0])", "discover",
     "furthest"),
    ("discover", "<= (b[1]", ">= (b[1]", "discover", "furthest"),
    ("discover", "odd | on_edge", "odd", "discover", "inside_against"),
    ("discover", "np.where(step[:, 1] > 0, ahead, -ahead)", "ahead", "discover", "inside_against"),
    ("discover", "xy, n = xy[here], n[here]", "here = list(range(len(ids)))", "discover", "unique"),
    ("prescribe", "times[:-1] >= hold", "times[:-1] >= 0", "prescribe", "gap_at"),
    ("prescribe", "np.clip(v - v_min, 0, slower)", "slower", "prescribe", "gap_at"),
    ("prescribe", "np.minimum(gained, gain)", "gained", "prescribe", "gains_what"),
    ("prescribe", "(gain - gained[k - 1]) / reduced[k - 1]", "0", "prescribe", "gap_at ends_when"),
    ("prescribe", "np.concatenate([times, np.interp(arcs, ways, times)])", "times", "prescribe",
     "same_path"),
    ("verify", "off) <= limit", "off) <= 99", "prescribe", "elsewhere"),
    ("verify", "found.distance > limit", "found.distance > 2 * limit", "prescribe",
     "off_the_path"),
    ("verify", "return bool((np.hypot(off[:, 0], off[:, 1]) <= limit + NANOMETRE).all())",
     "return True", "prescribe", "back_and"),
    ("verify", "lateral(prescribed) > limits.lateral", "lateral(prescribed) > 99", "curves",
     "lateral"),
    ("verify", "a - 2 * b + c", "a - b", "curves", "lateral"),
    ("verify", "between + limits.reaction, side", "between, side", "prescribe", "mean_dec"),
    ("verify", "approach.distance >= limit", "approach.distance <= limit", "prescribe", "gaps"),
    ("verify", "prescribed.since(when), other", "prescribed, other", "prescribe", "from_now"),
    ("verify", "np.maximum.accumulate(foot) - foot > limit", "foot < 0", "prescribe", "back_and"),
    ("verify", ">= WINDOW", ">= 0", "prescribe", "tiny"),
    ("success", "1 + math.floor", "math.floor", "success", "sendings"),
    ("success", "* (1 + 1e-9)", "", "success", "sendings"),
    ("success", "q = (1 - _loss(loss)) ** 2", "q = 1 - _loss(loss)", "success", "mpmath counts"),
    ("success", "EXCHANGES = 3", "EXCHANGES = 2", "success", "mpmath"),
]  # fmt: skip


def mutated(kernel: str, old: str, new: str) -> ModuleType:
    package = "automcm_simulation.radio" if kernel == "success" else "automcm.kernels"
    module = importlib.import_module(f"{package}.{kernel}")
    source = inspect.getsource(module)
    assert source.count(old) >= 1, f"{kernel}: {old!r} is not there"
    copy = ModuleType(module.__name__)
    sys.modules[copy.__name__] = copy  # dataclasses look here
    exec(compile(source.replace(old, new), f"<{kernel} mutated>", "exec"), vars(copy))
    sys.modules[copy.__name__] = module
    return copy


@pytest.fixture(scope="module")
def quick() -> Iterator[None]:
    """Imports the tests anew, to fail without looking for a smaller example."""
    names = [f"test_trajectory_{each}" for each in ("convert", "thin", "collide", "extents",
                                                     "discover", "prescribe", "curves",
                                                     "success")]  # fmt: skip
    for name in names:
        sys.modules.pop(name, None)
    before = settings.get_current_profile_name()
    settings.register_profile("mutants", QUICK)
    settings.load_profile("mutants")
    for name in names:
        importlib.import_module(name)
    settings.load_profile(before)
    yield
    for name in names:
        sys.modules.pop(name, None)


@pytest.mark.sweep(6)
@pytest.mark.parametrize(
    ("kernel", "old", "new", "tests", "parts"),
    MUTANTS,
    ids=[f"{kernel}-{n}" for n, (kernel, *_) in enumerate(MUTANTS)],
)
def test_is_caught(
    kernel: str,
    old: str,
    new: str,
    tests: str,
    parts: str,
    quick: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = sys.modules[f"test_trajectory_{tests}"]
    names = [
        name
        for name in vars(module)
        if name.startswith("test_") and any(part in name for part in parts.split())
    ]
    assert names
    for name in names:
        check: Callable[..., None] = getattr(module, name)
        with monkeypatch.context() as patched:
            arguments = [patched] if "monkeypatch" in inspect.signature(check).parameters else []
            patched.setattr(module, kernel, mutated(kernel, old, new))
            try:
                check(*arguments)
            except (AssertionError, ValueError, IndexError, FloatingPointError):
                return
            except BaseException as error:
                if isinstance(error, pytest.fail.Exception | BaseExceptionGroup):
                    return
                raise
    pytest.fail(f"{kernel}: {old!r} for {new!r} passes {', '.join(names)}")


def test_the_kernels_are_restored() -> None:
    assert sys.modules["automcm.kernels.convert"] is automcm.kernels.convert
