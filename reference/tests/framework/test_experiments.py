"""Sweeps: cells, seeds, interruptions, and the parts of a report."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fixed_cells import committed
from pydantic import Field

from automcm_evaluation.framework import experiment
from automcm_evaluation.framework.experiment import (
    Experiment,
    ExperimentError,
    Settings,
)
from automcm_evaluation.framework.intervals import quantile, wilson
from automcm_evaluation.sweeps import catalogue, report, sweep

Json = Any


CLAIMS = """
[names]
double = "2 * fair"

[[claim]]
claim = "dice | fall"
paper = "{{ double|fmt('g') }}"
here = "{{ s.sum }}"
full = "s.sum == double"
shape = "s.sum > 0"
why = "they are two"

[[claim]]
each = "settings.sides"
claim = "{{ it }} sides"
here = "at most"
holds = "it < 9"
"""


class Dice(Settings):
    sides: tuple[int, ...] = (6, 20)
    throws: int = Field(default=3, ge=1, le=100)


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
            profiles={"quick": Dice(), "standard": Dice(throws=9)},
            cells=lambda s: [{"sides": n, "throws": s.throws} for n in s.sides],
            run=self.run,
            summary=lambda cells: {"sum": sum(sum(c.result["thrown"]) for c in cells)},
            names=lambda r: {"fair": 3.5},
            figures=_figures,
        )


def _figures(r: Json) -> Iterator[Any]:
    yield from ()


@pytest.fixture
def dice(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Thrown:
    thrown = Thrown()
    made = thrown.experiment()
    pages = tmp_path_factory.mktemp("pages")
    shutil.copy(experiment.PAGES / "experiment.md.j2", pages)
    (pages / "dice.md.j2").write_text("Sum {{ s.sum }}.\n\n![](falls.svg)\n")
    (pages / "dice.claims.toml").write_text(CLAIMS)
    for module in (sweep, report):
        monkeypatch.setattr(module, "experiment", lambda name: made)
    for module in (experiment, report):
        monkeypatch.setattr(module, "PAGES", pages)
    return thrown


def run(thrown: Thrown, folder: Path, seed: int = 1, again: bool = False, **changes: Json) -> Json:
    made = thrown.experiment()
    about = sweep.header(made, "quick", seed, made.set("quick", changes))
    cells = sweep.sweep(made, about, folder, workers=1, again=again)
    return report.assemble(made, about, cells)


def test_an_unknown_experiment_is_named() -> None:
    with pytest.raises(ExperimentError, match="no experiment 'luck'; there are: bandwidth"):
        catalogue.experiment("luck")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"throws": 0}, "throws: 0: Input should be greater than or equal to 1"),
        ({"throws": 101}, "throws: 101: Input should be less than or equal to 100"),
        ({"sides": [6, "x"]}, r"sides\.1: 'x'"),
        ({"luck": 1}, "luck: there is no such setting; there are: sides, throws"),
    ],
)
def test_an_impossible_setting_is_named_with_its_range(changes: Json, text: str) -> None:
    with pytest.raises(ExperimentError, match=text):
        Thrown().experiment().set("quick", changes)


def test_an_unknown_profile_is_named() -> None:
    with pytest.raises(ExperimentError, match="no profile 'slow'; there are: quick, standard"):
        Thrown().experiment().set("slow", {})


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
    run(dice, tmp_path / "cut", again=True)
    assert dice.ran == [6, 20, 6, 20]


def test_a_process_that_breaks_off_is_named(tmp_path: Path) -> None:
    """As when a library crashes: the sweep says in which cell, and keeps what is finished."""
    wanted = [{"code": code} for code in (0, 0, 9)]
    with pytest.raises(ExperimentError, match=r'a process broke off; it ran .*"code":9'):
        sweep.finish(wanted[1:], ends, {"of": "it"}, tmp_path, workers=2)


def ends(values: Json) -> Json:
    if values["code"]:
        os._exit(values["code"])
    return values


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


def test_a_damaged_cell_is_named(dice: Thrown, tmp_path: Path) -> None:
    run(dice, tmp_path)
    kept = next((tmp_path / "cells").iterdir())
    kept.write_bytes(kept.read_bytes().replace(b'"result"', b'"resolt"', 1))
    with pytest.raises(ExperimentError, match=rf"{kept.name}: not a finished cell"):
        run(dice, tmp_path)


def test_a_cell_twice_is_refused(dice: Thrown, tmp_path: Path) -> None:
    with pytest.raises(ExperimentError, match="contains a cell twice"):
        run(dice, tmp_path, sides=[6, 6])


def test_a_folder_that_cannot_be_written_is_told_before_a_cell_is_run(
    dice: Thrown, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        run(dice, tmp_path / "file" / "below")
    assert not dice.ran


def test_a_full_disk_is_told_before_a_cell_is_run(
    dice: Thrown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep, "FREE_BYTES", 1 << 80)
    with pytest.raises(OSError, match="bytes are free"):
        run(dice, tmp_path)
    assert not dice.ran


def test_a_report_is_written_and_read_again(dice: Thrown, tmp_path: Path) -> None:
    made = run(dice, tmp_path)
    written = [path.name for path in report.write(made, tmp_path)]
    assert written == ["results.json", "README.md"]
    assert report.load(tmp_path / "results.json") == made
    assert "code" not in made, "of the code at that time, so never the present one"
    lines = (tmp_path / "results.json").read_text().splitlines()
    cells = [line for line in lines if line.startswith('  {"result": ')]
    assert len(cells) == len(made["cells"])
    text = (tmp_path / "README.md").read_text()
    found = made["summary"]["sum"]
    assert f"| dice \\| fall | 7 | {found} | **in shape only** | they are two |" in text
    assert "| 6 sides | - | at most | **beyond the paper** |  |" in text
    assert "| 20 sides | - | at most | **not reproduced** |  |" in text
    assert f"\n\nSum {found}.\n\n![](falls.svg)\n\nGenerated by" in text
    assert "`automcm experiment dice --profile quick --seed 1`" in text


def test_large_results_are_compressed(
    dice: Thrown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = run(dice, tmp_path / "dice")
    (plain, *_) = report.write(made, tmp_path / "dice")
    monkeypatch.setattr(report, "LARGE_BYTES", 100)
    (packed, *_) = report.write(made, tmp_path / "dice")
    assert packed.name == "results.json.xz" and not plain.exists()
    assert report.load(plain) == report.load(packed) == made
    assert report.results(tmp_path) == [packed]


@pytest.mark.parametrize("text", ["", "{}", '{"experiment": "dice", "cells": [1]}'])
def test_what_is_no_report_is_named(dice: Thrown, tmp_path: Path, text: str) -> None:
    (tmp_path / "results.json").write_text(text)
    with pytest.raises(ExperimentError, match=r"results\.json: not a report"):
        report.load(tmp_path / "results.json")


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
    with pytest.raises(ValueError, match="at least one value"):
        quantile([], 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", catalogue.NAMES)
def test_the_page_shows_the_figures_that_are_drawn(name: str) -> None:
    pytest.importorskip("matplotlib", reason="automcm[plot] is not installed")
    made = committed(name)
    drawn = [figure for figure, _ in catalogue.experiment(name).figures(made)]
    shown = [line for line in report.page(made).splitlines() if line.startswith("![")]
    assert sorted(line.split("](")[1] for line in shown) == [f"{n}.svg)" for n in sorted(drawn)]


@pytest.mark.slow
def test_dask_gives_the_same(dice: Thrown, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="automcm[dask] is not installed")
    here = run(dice, tmp_path / "here")
    made = dice.experiment()
    about = sweep.header(made, "quick", 1, made.set("quick", {}))
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        there = sweep.sweep(made, about, tmp_path / "there", scheduler=cluster.scheduler_address)
    assert report.assemble(made, about, there) == here
    assert sorted(dice.ran) == [6, 6, 20, 20], "they were run there"


def test_a_scheduler_that_is_not_there_is_named(
    dice: Thrown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="automcm[dask] is not installed")
    monkeypatch.setattr(sweep, "CONNECT_S", 0.2)
    made = dice.experiment()
    about = sweep.header(made, "quick", 1, made.set("quick", {}))
    with pytest.raises(OSError, match=r"tcp://127\.0\.0\.1:1"):
        sweep.sweep(made, about, tmp_path, scheduler="tcp://127.0.0.1:1")
