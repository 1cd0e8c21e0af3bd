"""The TLC driver, on real runs of TLC."""

import threading
from pathlib import Path

import pytest

from automcm_spec.model_checking import tlc, toolchain
from automcm_spec.model_checking.tlc import Progress, TlcError

CLOCK = """---- MODULE Clock ----
EXTENDS Naturals, Sequences, TLC
CONSTANT Mode
VARIABLE x
Init == x = 0
Next == CASE Mode = "cycle" -> x' = (x + 1) % 3
          [] Mode = "stops" -> x < 2 /\\ x' = x + 1
          [] Mode = "print" -> PrintT(<<"x", x>>) /\\ PrintT("ü @!@!@") /\\ x' = (x + 1) % 2
          [] Mode = "endless" -> x' = x + 1
          [] Mode = "huge" -> x' = [y \\in 1 .. 20000000 |-> y]
          [] Mode = "wrong" -> x' = IF x = 1 THEN Len(x) ELSE x + 1
          [] Mode = "unset" -> x < 3
          [] Mode = "symbol" -> x' = Nat
Fair == Init /\\ [][Next]_x /\\ WF_x(Next)
NotZero == x # 0
NotTwo == x # 2
Grows == [][x' > x]_x
Seven == <>(x = 7)
Idle == <>[](x = 0)
====
"""


@pytest.fixture(autouse=True)
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files, which must be empty after each test."""
    folder = tmp_path / "automcm" / "scratch"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return folder


@pytest.fixture
def clock(tmp_path: Path) -> Path:
    folder = tmp_path / "tla"
    folder.mkdir()
    (folder / "Clock.tla").write_text(CLOCK, encoding="utf-8")
    return folder


def cfg(folder: Path, mode: str, *lines: str, spec: str = "INIT Init\nNEXT Next") -> Path:
    path = folder / f"{mode}.cfg"
    path.write_text("\n".join([f'CONSTANT Mode = "{mode}"', spec, *lines]), encoding="utf-8")
    return path


def fails(module: str, cfg: Path, tla_dir: Path, scratch: Path, **options: object) -> TlcError:
    with pytest.raises(TlcError) as caught:
        tlc.run(module, cfg, tla_dir=tla_dir, **options)  # type: ignore[arg-type]
    assert list(scratch.iterdir()) == []
    return caught.value


def test_it_holds(clock: Path, scratch: Path) -> None:
    seen: list[Progress] = []
    result = tlc.run("Clock", cfg(clock, "cycle"), tla_dir=clock, on_progress=seen.append)
    assert (result.outcome, result.property, result.trace) == ("holds", None, ())
    assert (result.distinct_states, result.states, result.depth) == (3, 4, 3)
    assert result.seconds > 0
    assert seen[-1] == Progress(depth=3, states=4, distinct_states=3, queue=0)
    assert sorted(p.name for p in clock.iterdir()) == ["Clock.tla", "cycle.cfg"]
    assert list(scratch.iterdir()) == []


@pytest.mark.slow
def test_an_invariant(clock: Path) -> None:
    result = tlc.run("Clock", cfg(clock, "cycle", "INVARIANT NotTwo"), tla_dir=clock)
    assert (result.outcome, result.property) == ("violates", "NotTwo")
    assert [(s.index, s.action, s.values) for s in result.trace] == [
        (1, tlc.INITIAL, {"x": 0}),
        (2, "Next", {"x": 1}),
        (3, "Next", {"x": 2}),
    ]


FAIR = "SPECIFICATION Fair"


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("mode", "lines", "named", "length", "loop"),
    [
        ("cycle", ["INVARIANT NotZero"], "NotZero", 1, None),
        ("cycle", ["PROPERTY Grows"], "Grows", 4, None),
        ("stops", [], tlc.DEADLOCK, 3, None),
        ("cycle", ["PROPERTY Seven", FAIR], None, 3, 1),
        ("cycle", ["PROPERTY Idle", FAIR], None, 3, 1),
        ("stops", ["PROPERTY Seven", "CHECK_DEADLOCK FALSE", FAIR], None, 3, 3),  # it stutters
    ],
)
def test_what_is_violated(
    mode: str, lines: list[str], named: str | None, length: int, loop: int | None, clock: Path
) -> None:
    """An invariant at once, an action property, a deadlock, temporal properties."""
    spec = "" if FAIR in lines else "INIT Init\nNEXT Next"
    result = tlc.run("Clock", cfg(clock, mode, *lines, spec=spec), tla_dir=clock)
    assert (result.outcome, result.property) == ("violates", named)
    assert (len(result.trace), result.loop) == (length, loop)


@pytest.mark.slow
def test_what_it_prints_is_streamed(clock: Path) -> None:
    lines: list[str] = []
    tlc.run("Clock", cfg(clock, "print"), tla_dir=clock, on_print=lines.append)
    assert lines == ['<<"x", 0>>', '"ü @!@!@"', '<<"x", 1>>', '"ü @!@!@"']


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("NotZero ==", "NotZero = =", ""),
        ("NotTwo ==", "NotTwo == Nowhere(x) /\\", "Unknown operator: `Nowhere'"),
    ],
)
def test_a_parse_error(clock: Path, scratch: Path, old: str, new: str, text: str) -> None:
    """In a module that the model's extends."""
    (clock / "Outer.tla").write_text("---- MODULE Outer ----\nEXTENDS Clock\n====\n")
    (clock / "Clock.tla").write_text(CLOCK.replace(old, new))
    line = 1 + [line.startswith(new) for line in CLOCK.replace(old, new).splitlines()].index(True)
    error = fails("Outer", cfg(clock, "cycle"), clock, scratch)
    assert (error.kind, error.module) == ("parse", "Clock")
    assert error.line is not None and abs(error.line - line) <= (not text)
    assert str(error).startswith(f"Clock.tla line {error.line}: ")
    assert str(error).count(text) == 1 or not text


def test_a_module_that_is_missing(tmp_path: Path, clock: Path, scratch: Path) -> None:
    error = fails("None", cfg(clock, "cycle"), clock, scratch)
    assert error.kind == "parse"
    assert "Cannot find source file for module None" in str(error)


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("PROPERTY Nonesuch", "cycle.cfg: The property Nonesuch specified in"),
        ("INVARIANT Nonesuch", "cycle.cfg: The invariant Nonesuch specified in"),
        ("CONSTANT NotTwo <- Nonesuch", "undefined identifier Nonesuch"),
        ("CONSTANT a 1", "cycle.cfg: TLC found an error in the configuration file at line 4"),
        (None, "File not found"),
    ],
)
def test_a_wrong_cfg(clock: Path, scratch: Path, line: str | None, message: str) -> None:
    path = clock / "none.cfg" if line is None else cfg(clock, "cycle", line)
    error = fails("Clock", path, clock, scratch)
    assert error.kind == "config"
    assert message in str(error)


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "line"), [("wrong", 11), ("unset", None)])
def test_an_error_while_checking(clock: Path, scratch: Path, mode: str, line: int | None) -> None:
    error = fails("Clock", cfg(clock, mode), clock, scratch)
    assert (error.kind, error.line) == ("other", line)
    assert "TLC threw" not in str(error)


def test_a_value_that_cannot_be_read(clock: Path, scratch: Path) -> None:
    error = fails("Clock", cfg(clock, "symbol", "PROPERTY Grows"), clock, scratch)
    assert error.kind == "other"


@pytest.mark.slow
def test_out_of_memory(clock: Path, scratch: Path) -> None:
    path = cfg(clock, "huge")
    assert fails("Clock", path, clock, scratch, heap_mb=64).kind == "memory"
    assert fails("Clock", path, clock, scratch, heap_mb=2).kind == "memory"


def test_a_timeout(clock: Path, scratch: Path) -> None:
    error = fails("Clock", cfg(clock, "endless"), clock, scratch, timeout_s=0.2)
    assert (error.kind, str(error)) == ("timeout", "TLC did not end within 0.2 s")


@pytest.mark.slow
def test_another_thread_stops_it(clock: Path, scratch: Path) -> None:
    stop = tlc.TlcStop()
    threading.Timer(1, stop.now).start()
    for _ in range(2):  # the one that runs, and one that starts later
        error = fails("Clock", cfg(clock, "endless"), clock, scratch, stop=stop)
        assert (error.kind, str(error)) == ("other", "TLC was stopped")


def test_a_callback_that_raises_ends_the_run(clock: Path, scratch: Path) -> None:
    def interrupt(_: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tlc.run("Clock", cfg(clock, "print"), tla_dir=clock, on_print=interrupt)
    assert list(scratch.iterdir()) == []


def test_a_disk_that_cannot_be_written(clock: Path, scratch: Path) -> None:
    with pytest.raises(TlcError) as caught:
        tlc.run("Clock", cfg(clock, "cycle"), tla_dir=clock, extra=["-metadir", "/dev/null/x"])
    assert caught.value.kind == "disk"


def test_no_java(clock: Path, scratch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(toolchain, "java", lambda: clock / "java")
    assert fails("Clock", cfg(clock, "cycle"), clock, scratch).kind == "java"
    monkeypatch.undo()
    monkeypatch.setenv(toolchain.OVERRIDE, str(clock / "none.jar"))
    with pytest.raises(TlcError, match="which is not a file") as caught:
        tlc.run("Clock", cfg(clock, "cycle"), tla_dir=clock)
    assert caught.value.kind == "java"


def test_a_jar_that_is_none(clock: Path, scratch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(toolchain.OVERRIDE, str(clock / "Clock.tla"))
    error = fails("Clock", cfg(clock, "cycle"), clock, scratch)
    assert error.kind == "java"
    assert "exit code 1" in str(error)
