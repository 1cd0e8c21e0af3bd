"""The matrix of mutants and properties: its modules, its cells, its page."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mutant_stage import tiny, with_cfg
from typer.testing import CliRunner

from automcm_cli.main import app
from automcm_maintenance.documents import matrix_page
from automcm_maintenance.documents.matrix_page import Head, MatrixEntry
from automcm_maintenance.spec_mutation import matrix, matrix_modules, mutants
from automcm_maintenance.spec_mutation.matrix import Matrix, MatrixCell
from automcm_maintenance.spec_mutation.mutant_runs import MutationError
from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.model_checking import models, tlc
from automcm_spec.model_checking.models import Model
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA

STATION = r"""---- MODULE Station ----
EXTENDS Naturals, FiniteSets
CONSTANT Top
\* Above and below.
Up(x) == IF /\ x < 3
            /\ x # 9 THEN x + 1 ELSE 0
Same(x) == IF x > 70 THEN 0 ELSE x
LimitsSuffice == Top \in Nat
====
"""
COUNTER = r"""---- MODULE Counter ----
EXTENDS Station
VARIABLE n
vars == <<n>>
Init == n = 0
Next == n' = Same(Up(n)) /\ n < 100
Spec == Init /\ [][Next]_vars
FairSpec == Init /\ [][Next]_vars /\ WF_vars(Next)
Small == n <= 3
Even == n # 5 /\ n \in 0 .. Top
SlowProp ==
  [][ \/ n' = 0
      \/ n' <= n + 1 ]_vars
BackProp == n = 3 ~> n = 0
HomeProp == n = 2 ~> n = 0
HeldProp ==
  /\ BackProp
  /\ [](n < 5)
====
"""
CFG = "CONSTANT Top = 9\nSPECIFICATION Spec\nINVARIANTS Small Even\nPROPERTY SlowProp\n"
HIGHER = "/\\ x < 3  =>  /\\ x <= 3"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "Station.tla").write_text(STATION)
    (tmp_path / "Counter.tla").write_text(COUNTER)
    (tmp_path / "count.cfg").write_text(CFG)
    lively = "CONSTANT Top = 9\nSPECIFICATION FairSpec\nPROPERTY BackProp\n"
    (tmp_path / "lively.cfg").write_text(lively)
    return tmp_path


COUNT = tiny("count", module="Counter")
LIVELY = tiny("lively", module="Counter")


def of(folder: Path, *chosen: Model, cells: Path | None = None) -> Matrix:
    return Matrix([with_cfg(folder, model) for model in chosen or (COUNT,)], folder, cells)


def by_change(folder: Path) -> dict[str, Mutant]:
    return {m.change: m for m in mutants.generate(folder, ["Station"])}


def made(number: int, old: bytes, new: bytes) -> Mutant:
    """A mutant of Up that the generator does not make."""
    start = STATION.encode().index(old)
    end = start + len(old)
    return Mutant(f"Station.Up.x.{number}", "Station", "Up", "x", 5, start, end, new, "", "")


def quiet(text: str) -> None: ...


# The modules


def test_the_specification_and_its_properties_are_read(folder: Path) -> None:
    texts = {path.stem: path.read_text() for path in folder.glob("*.tla")}
    found = matrix_modules.checks("Counter", CFG, texts)
    assert (found.init, found.next, found.variables, found.view) == ("Init", "Next", *["vars"] * 2)
    assert found.names == ("Small", "Even", "SlowProp") and found.rest.split() == [
        *["CONSTANT", "Top", "=", "9"]
    ]
    lively = matrix_modules.checks("Counter", (folder / "lively.cfg").read_text(), texts)
    assert lively.temporal == ("BackProp",) and "WF_vars(Next)" in lively.fairness


def test_temporal_properties_that_have_a_safety_part_are_known() -> None:
    texts = {path.stem: path.read_text() for path in TLA.glob("*.tla")}
    loaded, parts = {model.cfg: model for model in models.load()}, {}
    for name in ("promise_kept", "completes", "silence", "ends"):
        cfg = loaded[name].config
        parts |= matrix_modules.checks("Liveness", cfg, texts).parts
    refines = ("Fulfilled!Init", " Fulfilled!Next \\/ Fulfilled!vars' = Fulfilled!vars")
    assert parts == {"FulfilledProp": refines, "CompletesProp": ("~fallback", "  (~fallback)'")}


@pytest.mark.parametrize(
    ("body", "part"),
    [
        ("\n  /\\ [](n < 5)\n", "n < 5"),
        ("\n  /\\ BackProp\n  /\\ [](n < 5)\n  /\\ HomeProp\n", "n < 5"),
        ("\n  \\/ BackProp\n  \\/ /\\ HomeProp\n     /\\ [](n < 5)\n", None),
        ("\n  HomeProp => /\\ [](n < 5)\n", None),
    ],
)
def test_only_a_conjunct_of_the_whole_property_is_its_safety(body: str, part: str | None) -> None:
    found = matrix_modules._part(body, "", {})
    assert found == (None if part is None else (part, f"  ({part})'"))


def test_every_model_of_the_matrix_can_be_read_and_every_property_is_a_column() -> None:
    loaded = {model.cfg: model for model in models.load()}
    found = Matrix([loaded[name] for name in matrix.CFGS])
    columns: set[str] = set()
    for model in (loaded[name] for name in matrix.CFGS):
        assert model.expect == "holds"
        of_model = [u.checks.names for u in found.units if u.model is model]
        names = {name for names in of_model for name in names} - {matrix_modules.ORACLE}
        assert names == set(models.checked_in(model.config))
        columns |= {matrix.id_of(name) for name in names}
    # I-1 speaks of reachable states of the unchanged station; P-1 takes the full profile
    assert set(models.PROPERTIES) - {"I-1", "P-1"} <= columns


def test_a_batch_keeps_the_columns_of_each_version(folder: Path) -> None:
    """A list of conjuncts depends on them."""
    source = STATION.encode()
    one = by_change(folder)[HIGHER]
    text = matrix_modules.station(source, mutants.definitions(source), {7: one}).decode()
    assert "mut = 7 -> Up_m7(x)" in text and "OTHER -> Up_m0(x)" in text
    places = [line.index("/\\") for line in text.splitlines() if "/\\ x" in line]
    assert len(places) == 4 and len(set(places)) == 1
    assert "LimitsSuffice == TRUE" in text and "VARIABLE mut" in text
    assert matrix_modules.version_at(text.encode(), text[: text.index("<=")].count("\n") + 1) == 7
    assert (
        matrix_modules.version_at(text.encode(), text[: text.index("> 70")].count("\n") + 1) is None
    )


@pytest.mark.parametrize(
    ("cfg", "message"),
    [
        ("INIT Init\nNEXT Next\nINVARIANT Small\n", "must name a SPECIFICATION"),
        ("SPECIFICATION Gone\nINVARIANT Small\n", "no module defines Gone"),
        ("SPECIFICATION Small\nINVARIANT Even\n", "Small is not Init"),
        ("SPECIFICATION Spec\nINVARIANT Small\nPROPERTY BackProp\n", "temporal properties"),
    ],
)
def test_a_model_of_another_form_is_an_error(folder: Path, cfg: str, message: str) -> None:
    (folder / "count.cfg").write_text(cfg)
    with pytest.raises(MutationError, match=f"count: .*{message}"):
        of(folder)


# With TLC


@pytest.mark.slow
def test_each_property_by_itself_and_nothing_twice(folder: Path) -> None:
    """The cells of a batch: two properties violated, one, none, not evaluated, too many states."""
    fast = made(1, b"x + 1", b"x + 5")  # 0 5: Small, Even and SlowProp
    high = by_change(folder)[HIGHER]  # 0 .. 4: Small
    same = by_change(folder)["IF x > 70 THEN 0 ELSE x  =>  IF x >= 70 THEN 0 ELSE x"]
    wrong = made(2, b"x + 1", b'x + ""')
    long = made(3, b"/\\ x < 3\n            /\\ x # 9", b"TRUE")
    wanted, cells = [fast, high, same, wrong, long], folder / "runs" / "cells.jsonl"
    rows, complete = of(folder, cells=cells).run(wanted, 1, quiet)
    assert complete
    assert [sorted(row.kills) for row in rows] == [
        ["Even", "SlowProp", "Small"], ["Small"], [], [], ["Even", "Small"]
    ]  # fmt: skip
    assert [row.unfinished for row in rows] == [{}, {}, {}, {"count": "error"}, {"count": "states"}]
    with cells.open("a") as file:
        file.write('["half a li')
    with pytest.MonkeyPatch.context() as patch:
        patch.delattr(tlc, "run")
        again, _ = of(folder, cells=cells).run(wanted, 1, quiet)
    assert again == rows


@pytest.mark.slow
def test_a_temporal_property_of_each_mutant(folder: Path) -> None:
    stays = made(1, b"ELSE 0", b"ELSE x")
    high = by_change(folder)[HIGHER]
    rows, _ = of(folder, LIVELY).run([high, stays], 1, quiet)
    assert [sorted(row.kills) for row in rows] == [[], ["BackProp"]]


@pytest.mark.slow
def test_a_batch_finds_what_a_run_of_each_property_finds() -> None:
    loaded = {model.cfg: model for model in models.load()}
    found = Matrix([loaded["restarts"]])
    armed = [m for m in mutants.generate(modules=["Station"]) if m.operator == "Armed"]
    wanted = [m for m in armed if m.kind == "conjunct"]
    cells = found._explored(found.units[0], dict(enumerate(wanted, start=1)), {})
    rest, checked = models.split(loaded["restarts"].config)
    [number] = [n for n, cell in cells.items() if len(cell.kills) > 1][:1]
    violated = set()
    with scratch.folder("test") as place:
        for path in TLA.glob("*.tla"):
            (place / path.name).write_bytes(path.read_bytes())
        source = (TLA / "Station.tla").read_bytes()
        (place / "Station.tla").write_bytes(wanted[number - 1].apply(source))
        for keyword, name in checked:
            (place / "one.cfg").write_text(f"{rest}\n{keyword} {name}\n")
            result = tlc.run("Refinement", place / "one.cfg", tla_dir=place, short=True)
            if result.outcome == "violates":
                violated.add(matrix.id_of(name))
    assert set(cells[number].kills) == violated


@pytest.mark.slow
def test_temporal_properties_of_the_same_behaviour_are_explored_together_first(
    folder: Path,
) -> None:
    """What violates none needs one run instead of two; what violates one, a run for each."""
    (folder / "both.cfg").write_text(
        "CONSTANT Top = 9 \\* as lively\nSPECIFICATION FairSpec\nPROPERTIES BackProp HomeProp\n"
    )
    first = made(2, b"THEN x + 1", b"THEN IF x = 2 THEN 2 ELSE x + 1")
    high = by_change(folder)[HIGHER]
    ran: list[tuple[int, str]] = []

    class Told(Matrix):
        def _run(self, unit: Any, batch: Any, *more: Any) -> Any:
            if list(batch) != [matrix_modules.ORIGINAL]:
                ran.append((len(batch), " ".join(unit.checks.temporal)))
            return super()._run(unit, batch, *more)

    cells = folder / "cells.jsonl"
    of_both = (LIVELY, tiny("both", module="Counter"))
    rows, complete = Told([with_cfg(folder, m) for m in of_both], folder, cells).run(
        [high, first], 1, quiet
    )
    assert complete and [sorted(row.kills) for row in rows] == [[], ["HomeProp"]]
    assert ran == [
        (2, "BackProp HomeProp"),
        (1, "BackProp HomeProp"),
        (1, "BackProp"),
        (1, "BackProp HomeProp"),
        (1, "BackProp"),
        (1, "HomeProp"),
    ]


@pytest.mark.slow
def test_the_safety_of_a_temporal_property_is_checked_before_all_of_it(folder: Path) -> None:
    (folder / "held.cfg").write_text(
        "CONSTANT Top = 9\nSPECIFICATION FairSpec\nPROPERTY HeldProp\n"
    )
    high = by_change(folder)[HIGHER]
    jumps = made(3, b"THEN x + 1", b"THEN IF x = 2 THEN 7 ELSE x + 1")
    stays = made(4, b"ELSE 0", b"ELSE x")
    found = of(folder, tiny("held", module="Counter"))
    asked: list[tuple[bool, int]] = []
    explored = found._explored

    def told(unit: Any, batch: Any, known: Any) -> Any:
        if list(batch) != [matrix_modules.ORIGINAL]:
            asked.append((bool(unit.checks.temporal), len(batch)))
        return explored(unit, batch, known)

    found._explored = told  # type: ignore[method-assign]
    rows, complete = found.run([high, jumps, stays], 1, quiet)
    assert complete and [sorted(row.kills) for row in rows] == [[], ["HeldProp"], ["HeldProp"]]
    assert asked == [(False, 3), (True, 2)]


# Without TLC


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[list[int]]]:
    """Replaces TLC: says prints lines for the mutants of a run, and may return an error."""

    def install(
        says: Callable[[list[int], Callable[[int, str], None]], Any], same: Sequence[int] = ()
    ) -> list[list[int]]:
        ran: list[list[int]] = []

        def run(module: str, cfg: Path, *, tla_dir: Path, on_print: Any, **_: Any) -> tlc.TlcResult:
            def say(number: int, name: str) -> None:
                if number in numbers or name == "DIFFERS":
                    on_print(json.dumps(f'<<"MUTANT", {number}, "{name}">>'))

            text = (tla_dir / "Matrix.tla").read_text()
            found = re.search(r"MxMutants == \{(.*)\}", text)
            assert found is not None
            numbers = [int(n) for n in found[1].split(",")]
            station = (tla_dir / "Station.tla").read_text()
            if "mxValue" in station:  # all differ but those that are named as equal
                for n in set(re.findall(r"uP_m(\d+)", station)):
                    if int(n) not in same:
                        say(int(n), "DIFFERS")
            elif numbers != [matrix_modules.ORIGINAL]:
                ran.append(numbers)
                error = says(numbers, say)
                if error is not None:
                    raise error
            return tlc.TlcResult("holds", None, COUNT.distinct_states or 0, 1, 1, 1)

        monkeypatch.setattr(tlc, "run", run)
        return ran

    return install


def failure(kind: Any, at: int | None = None) -> tlc.TlcError:
    error = tlc.TlcError(kind, kind)
    error.state = None if at is None else f"1: <Next>\n/\\ mut = {at}\n/\\ n = 0"
    return error


FOUR = [made(n, b"x + 1", b"x + %d" % n) for n in range(2, 6)]


def test_after_an_error_the_others_are_explored_with_what_is_known(
    folder: Path, pretend: Any
) -> None:
    def says(numbers: list[int], say: Any) -> Any:
        say(1, "Small")
        if 2 in numbers:
            for name in ("Small", "Even", "SlowProp"):
                say(3, name)
            say(2, "Even")
            return failure("other", at=2)
        return None

    ran = pretend(says)
    rows, complete = of(folder).run(FOUR, 1, quiet)
    assert complete and ran == [[1, 2, 3, 4], [1, 4]]
    assert [sorted(row.kills) for row in rows] == [
        ["Small"], ["Even"], ["Even", "SlowProp", "Small"], []
    ]  # fmt: skip
    assert [row.unfinished for row in rows] == [{}, {"count": "error"}, {}, {}]


def test_an_error_without_a_state_is_found_by_halves_and_time_is_tried_again(
    folder: Path, pretend: Any
) -> None:
    cells = folder / "cells.jsonl"
    ran = pretend(lambda numbers, say: failure("timeout") if 3 in numbers else None)
    rows, _ = of(folder, cells=cells).run(FOUR, 1, quiet)
    assert ran == [[1, 2, 3, 4], [1, 2], [3, 4], [3], [4]]
    assert [row.unfinished for row in rows] == [{}, {}, {"count": "time"}, {}]
    again = pretend(lambda numbers, say: say(3, matrix_modules.LIMIT))
    rows, _ = of(folder, cells=cells).run(FOUR, 1, quiet)
    assert again == [[3]] and rows[2].unfinished == {"count": "states"}


def test_a_killed_property_and_a_mutant_that_fails_are_left_out_later(
    folder: Path, pretend: Any
) -> None:
    (folder / "more.cfg").write_text(CFG)

    def says(numbers: list[int], say: Any) -> Any:
        for name in ("Small", "Even", "SlowProp"):
            say(1, name)
        return failure("other", at=2) if 2 in numbers else None

    ran = pretend(says)
    rows, _ = of(folder, COUNT, tiny("more", module="Counter")).run(FOUR, 1, quiet)
    assert ran == [[1, 2, 3, 4], [3, 4], [3, 4]]
    assert rows[0].kills == dict.fromkeys(("Even", "Small", "SlowProp"), "count")


def test_a_mutant_that_is_equal_wherever_it_counts_is_not_explored(
    folder: Path, pretend: Any
) -> None:
    ran = pretend(lambda numbers, say: None, same=[2])
    rows, complete = of(folder).run(FOUR, 1, quiet)
    assert complete and ran == [[1, 3, 4]] and rows[1] == matrix.MatrixRow(FOUR[1], {}, {}, 1)


def test_a_change_repeats_only_what_it_affects(folder: Path, pretend: Any) -> None:
    cells = folder / "cells.jsonl"
    ran = pretend(lambda numbers, say: None)
    of(folder, cells=cells).run(FOUR, 1, quiet)
    for path, new in {
        "Station.tla": STATION.replace("Above and below.", "Below and above."),
        "Other.tla": "---- MODULE Other ----\n====\n",
    }.items():
        (folder / path).write_text(new)
    of(folder, cells=cells).run(FOUR, 1, quiet)
    assert len(ran) == 1
    (folder / "Counter.tla").write_text(COUNTER.replace("100", "99"))
    of(folder, cells=cells).run(FOUR[:2], 1, quiet)
    assert ran[1:] == [[1, 2]]
    found = of(folder)
    keys = {found.key(found.units[0], FOUR[0], known) for known in ((), ("Small",), ("S-1",))}
    assert len(keys) == 2  # a cell depends on what is still to be checked


def test_an_interrupted_run_keeps_its_cells(
    folder: Path, pretend: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(matrix, "_BATCH", 1)
    monkeypatch.setattr(matrix, "_BATCH_STATES", 0)

    def says(numbers: list[int], say: Any) -> Any:
        if 5 in numbers:
            raise KeyboardInterrupt
        return None

    cells = folder / "cells.jsonl"
    six = [made(n, b"x + 1", b"x + %d" % n) for n in range(2, 8)]
    ran = pretend(says)
    _, complete = of(folder, cells=cells).run(six, 1, quiet)
    assert not complete
    _, complete = of(folder, cells=cells).run(six[:4], 1, quiet)
    assert complete and ran == [[1, 2, 3, 4], [5, 6]]


def test_a_violation_without_a_mutant_ends_the_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Matrix, "_explored", lambda *_: {0: MatrixCell(("Small",), "finished")})
    with pytest.raises(MutationError, match="count is not as expected without a mutant"):
        of(folder).run(FOUR, 1, quiet)


def test_a_changed_model_has_its_own_number_of_states(
    folder: Path, pretend: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "count.cfg").write_text("CONSTANTS\n  Top = 9\n" + CFG.partition("\n")[2])
    changed = matrix.Changed({"Top": "5"}, 4)
    monkeypatch.setattr(matrix, "CHANGED", {"count": changed})
    [unit] = of(folder).units
    assert "  Top = 5\n" in unit.checks.rest
    pretend(lambda numbers, say: None)
    assert of(folder).run(FOUR, 1, quiet)[1]
    monkeypatch.setattr(matrix, "CHANGED", {"count": replace(changed, distinct_states=5)})
    with pytest.raises(MutationError, match="count without a mutant has 4 states, not 5"):
        of(folder).run(FOUR, 1, quiet)
    monkeypatch.setattr(matrix, "CHANGED", {"count": matrix.Changed({"Bottom": "5"}, 4)})
    with pytest.raises(MutationError, match="no constant Bottom"):
        of(folder)


def test_a_sparing_run_leaves_temporal_properties_out_that_another_makes_dispensable(
    folder: Path, pretend: Any
) -> None:
    def says(numbers: list[int], say: Any) -> None:
        say(1, "Small")

    ran = pretend(says)
    rows, complete = Matrix(
        [with_cfg(folder, m) for m in (COUNT, LIVELY)], folder, sparing=True
    ).run(FOUR, 1, quiet)
    assert complete and ran == [[1, 2, 3, 4], [2, 3, 4]]
    assert [row.unfinished for row in rows] == [{"lively BackProp": "left"}, {}, {}, {}]


def test_a_sparing_run_uses_what_an_earlier_run_has_found(folder: Path, pretend: Any) -> None:
    ran = pretend(lambda numbers, say: say(1, "Small"))
    cells = folder / "cells.jsonl"
    of(folder, COUNT, LIVELY, cells=cells).run(FOUR, 1, quiet)
    ran.clear()
    spares = Matrix([with_cfg(folder, m) for m in (COUNT, LIVELY)], folder, cells, sparing=True)
    rows, complete = spares.run(FOUR, 1, quiet)
    assert complete and ran == [] and [row.unfinished for row in rows] == [{}] * 4


def test_a_tool_that_fails_ends_the_run(folder: Path, pretend: Any) -> None:
    pretend(lambda numbers, say: failure("disk"))
    with pytest.raises(MutationError, match="disk"):
        of(folder).run(FOUR, 1, quiet)


# The page

HEAD = Head(models=["count"], changed={"count": {"Top": "5"}}, states=3)
KILLED = MatrixEntry(
    id="Station.Step.x.1", change="a  =>  b", kills={"S-1": "count"}, unfinished={}
)
SEEN = MatrixEntry(
    id="Station.Step.x.2", change="c  =>  d", kills={"oracle": "count"}, unfinished={}
)
ALIVE = MatrixEntry(
    id="Station.Same.x.3", change="e  =>  f", kills={}, unfinished={"count": "error"}
)


def test_the_page_counts_and_lists() -> None:
    entries = [KILLED, SEEN, ALIVE]
    text = matrix_page.section(HEAD, entries, {SEEN.id: "Only an answer.", ALIVE.id: "Nothing."})
    assert "| definition | mutants | S-1 | oracle | error | none |" in text
    assert "| `Step` | 2 | 1 | 1 |  | 1 |" in text and "| `Same` | 1 |  |  | 1 | 1 |" in text
    assert "each property by itself (`count` with `Top = 5`)" in text
    assert "left out" not in text
    left = KILLED.model_copy(update={"unfinished": {"lively": "left"}})
    assert "1 explorations were left out" in matrix_page.section(HEAD, [left], {})
    assert "2 of 3; the comparison with the oracle finds 1 of them" in text
    assert f"Only an answer.\n\n- `{SEEN.id}`: `c  =>  d`" in text and KILLED.id not in text


def test_the_file_is_read_as_written(tmp_path: Path) -> None:
    path = tmp_path / "matrix.jsonl"
    path.write_text(matrix_page.text(HEAD, [KILLED, ALIVE]))
    assert matrix_page.load(path) == (HEAD, [KILLED, ALIVE])
    path.write_text(path.read_text().replace('"change"', '"changed"'))
    with pytest.raises(matrix_page.MatrixFileError, match=r"matrix.jsonl:2: change: .*required"):
        matrix_page.load(path)
    path.write_text("")
    with pytest.raises(matrix_page.MatrixFileError, match="is empty"):
        matrix_page.load(path)


def test_a_mutant_that_no_property_kills_needs_a_reason_and_no_other() -> None:
    known = {SEEN.id: "a", KILLED.id: "b", "Station.Gone.x.0": "c"}
    assert matrix_page.problems([KILLED, SEEN, ALIVE], known) == [
        f"no property kills {ALIVE.id} (e  =>  f), and no-property.toml does not say why",
        f"no-property.toml lists {KILLED.id}, but a property kills it",
        "no-property.toml lists Station.Gone.x.0, but there is no such mutant",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[[reason]]\ntext = "a"\n', "must have text and mutants"),
        ('[[reason]]\ntext = " "\nmutants = ["a"]\n', "must have text and mutants"),
        ('[[reason]]\ntext = "a"\nmutants = []\n', "must be a list of ids"),
        ('[[reason]]\ntext = "a"\nmutants = ["b", "b"]\n', "lists b twice"),
        ("version = 1\n", "unknown key version"),
        ("[[reason\n", "line 1"),
    ],
)
def test_a_faulty_list_of_reasons(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(matrix_page.MatrixFileError, match=message):
        matrix_page.reasons(tmp_path / "r.toml")


def test_the_committed_reasons_fit_the_committed_matrix() -> None:
    if not matrix_page.MATRIX.is_file():
        pytest.skip("the matrix has not been run")
    _, entries = matrix_page.load()
    assert matrix_page.problems(entries, matrix_page.reasons()) == []


@pytest.mark.parametrize(
    "options",
    [
        ["--module", "System"],
        ["--write", "--only", "OnAck"],
        ["--write", "--limit", "3"],
        ["--model", "nothing"],
        ["--model", "bare_ack"],
        ["--only", "Nobody.At.All"],
    ],
)
def test_the_command_refuses(options: list[str]) -> None:
    assert CliRunner().invoke(app, ["spec", "mutate", "--matrix", *options]).exit_code == 2


def test_only_the_matrix_can_be_sparing() -> None:
    assert CliRunner().invoke(app, ["spec", "mutate", "--sparing"]).exit_code == 2


def test_the_command_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(self: Matrix, wanted: list[Mutant], *_: Any) -> Any:
        return [
            matrix.MatrixRow(m, {"S-1": "count"} if n else {}) for n, m in enumerate(wanted)
        ], True

    monkeypatch.setattr(Matrix, "run", run)
    answer = CliRunner().invoke(app, ["spec", "mutate", "--matrix", "--limit", "3"])
    assert answer.exit_code == 0 and "S-1 2" in answer.output and "No property" in answer.output
    answer = CliRunner().invoke(app, ["spec", "mutate", "--matrix", "--limit", "3", "--json", "-"])
    assert len(json.loads(answer.output)["mutants"]) == 3
    assert CliRunner().invoke(app, ["spec", "mutate", "--matrix"]).exit_code == 1  # no reasons
    monkeypatch.setattr(Matrix, "run", lambda *_: ([], False))
    assert CliRunner().invoke(app, ["spec", "mutate", "--matrix"]).exit_code == 4
