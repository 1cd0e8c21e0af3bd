"""Sweeps: cells, seeds and interruptions; intervals; the figures of a page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from fixed_cells import committed

from automcm_evaluation.framework import experiment
from automcm_evaluation.framework.experiment import Experiment, ExperimentSettings
from automcm_evaluation.framework.intervals import quantile, wilson
from automcm_evaluation.sweeps import catalogue, report, sweep

Json = Any


class Dice(ExperimentSettings):
    sides: tuple[int, ...] = (6, 20)
    throws: int = 3


class Thrown:
    """An experiment that notes which cells were run; from the nth on it dies."""

    def __init__(self) -> None:
        self.ran: list[int] = []
        self.dies_at = 99

    def run(self, values: Json, seed: int) -> Json:
        if len(self.ran) >= self.dies_at:
            raise KeyboardInterrupt
        self.ran.append(values["sides"])
        return {"thrown": [seed % values["sides"] for _ in range(values["throws"])], "seed": seed}

    def experiment(self) -> Experiment:
        return Experiment(
            name="dice",
            title="Dice",
            settings=Dice,
            cells=lambda s: [{"sides": n, "throws": s.throws} for n in s.sides],
            run=self.run,
            summary=lambda cells: {"sum": sum(sum(c.result["thrown"]) for c in cells)},
            names=lambda r: {"fair": 3.5},
            figures=lambda r: iter(()),
        )


@pytest.fixture
def dice(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Thrown:
    thrown = Thrown()
    made = thrown.experiment()
    pages = tmp_path_factory.mktemp("pages")
    (pages / "dice.claims.toml").write_text("claim = []\n")
    for module in (sweep, report):
        monkeypatch.setattr(module, "experiment", lambda name: made)
    monkeypatch.setattr(experiment, "PAGES", pages)
    profiles = {"quick": {}, "standard": {"throws": 9}}
    monkeypatch.setattr(experiment, "data", lambda file: {"dice": profiles})
    return thrown


def run(thrown: Thrown, folder: Path, seed: int = 1, **changes: Json) -> Json:
    made = thrown.experiment()
    about = sweep.header(made, "quick", seed, made.set("quick", changes))
    cells = sweep.sweep(made, about, folder, workers=1)
    return report.assemble(made, about, cells)


def test_seeds_differ_by_cell_and_by_sweep_and_do_not_depend_on_order() -> None:
    one, two = {"a": 1, "b": 2}, {"b": 2, "a": 1}
    assert sweep.seed_of("x", one, 1) == sweep.seed_of("x", two, 1)
    others = [("x", one, 2), ("y", one, 1), ("x", {"a": 1, "b": 3}, 1)]
    assert len({sweep.seed_of(*arguments) for arguments in [("x", one, 1), *others]}) == 4


def test_an_interrupted_sweep_goes_on_and_gives_the_same(dice: Thrown, tmp_path: Path) -> None:
    whole = run(dice, tmp_path / "whole")
    dice.ran, dice.dies_at = [], 1
    with pytest.raises(KeyboardInterrupt):
        run(dice, tmp_path / "cut")
    dice.dies_at = 99
    assert run(dice, tmp_path / "cut") == whole
    assert dice.ran == [6, 20]
    run(dice, tmp_path / "cut")
    assert dice.ran == [6, 20], "nothing is run twice"


def test_the_code_is_also_the_tables_and_maps(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sweep, "SOURCES", [tmp_path])
    found = {sweep.code()}
    for name in ("a.py", "radio.json", "ramp.nod.xml", "town.osm"):
        (tmp_path / name).write_text(name)
        found.add(sweep.code())
    (tmp_path / "page.md.j2").write_text("no result depends on it")
    assert len(found) == 5 and sweep.code() in found


def test_the_code_is_all_that_an_experiment_imports() -> None:
    imported = {
        name
        for folder in sweep.SOURCES
        for path in folder.rglob("*.py")
        for name in re.findall(r"^ *(?:from|import) (automcm\w*)", path.read_text(), re.MULTILINE)
    }
    deciding_nothing = {"automcm_cli", "automcm_maintenance"}
    assert imported - deciding_nothing == {folder.name for folder in sweep.SOURCES}


def test_a_cell_is_of_its_values_seed_and_code(
    dice: Thrown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sweeps share a folder: those of other settings also the cells."""
    run(dice, tmp_path)
    assert run(dice, tmp_path, sides=[20, 4])["cells"][0] == run(dice, tmp_path)["cells"][1]
    assert dice.ran == [6, 20, 4]
    run(dice, tmp_path, seed=2)
    run(dice, tmp_path, throws=4)
    monkeypatch.setattr(sweep, "code", lambda: "other")
    run(dice, tmp_path)
    assert dice.ran == [6, 20, 4, *[6, 20] * 3]


def test_wilson_against_published_values() -> None:
    """Newcombe, Two-sided confidence intervals for the single proportion (1998), Table I."""
    for hits, trials, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        found = wilson(hits, trials)
        assert found == pytest.approx((low, high), abs=5e-5)
    assert wilson(0, 0) == (0, 1)


def test_quantile() -> None:
    assert quantile([3.0, 1.0, 2.0], 0.5) == 2
    assert quantile([0.0, 1.0], 0.25) == 0.25
    assert quantile([5.0], 0.9) == 5
    with pytest.raises(IndexError):
        quantile([], 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", catalogue.NAMES)
def test_the_page_shows_the_figures_that_are_drawn(name: str) -> None:
    pytest.importorskip("matplotlib", reason="automcm[plot] is not installed")
    made = committed(name)
    drawn = [figure for figure, _ in catalogue.experiment(name).figures(made)]
    shown = [line for line in report.page(made).splitlines() if line.startswith("![")]
    assert sorted(line.split("](")[1] for line in shown) == [f"{n}.svg)" for n in sorted(drawn)]
