"""The child process behind the kit: whatever it does, the kit goes on and nothing is left over."""

from __future__ import annotations

import os
import sys
import time
import tracemalloc
from pathlib import Path

import pytest
from test_children import alive, until

from automcm_conformance.adapter import process
from automcm_conformance.adapter.process import STDERR_LENGTH, STDERR_LINES, AdapterError, Process

LIMIT = 0.2
"""A time limit that the test waits for; other limits are generous for busy machines."""
LINE = b'{"cmd": "hello"}\n'

ECHO = """
import sys
for line in sys.stdin:
    print(line, end="", flush=True)
"""
FORGETS_TO_FLUSH = "import sys\nout = open(1, 'w')\nfor line in sys.stdin: out.write(line)"
SLEEPS = "import time\ntime.sleep(60)"
AWAY = "os.setsid(); print(os.getpid(), flush=True); os.write(here, b'.')"
FORK = """
import os, sys, time
there, here = os.pipe()
input()  # a line before that answers no command
if os.fork() == 0:
    {first}
    time.sleep(60)
"""


def start(code: str, *, limit_s: float = 5) -> Process:
    return Process([sys.executable, "-c", code], limit_s=limit_s)


def failure(code: str, lines: int = 1, limit_s: float = 5) -> AdapterError:
    with start(code, limit_s=limit_s) as child, pytest.raises(AdapterError) as caught:
        child.exchange([LINE] * lines)
    return caught.value


def gone(pid: int) -> bool:
    return until(lambda: not alive(pid))


def test_lines_come_back_in_order_although_both_pipes_are_full() -> None:
    lines = [b"%d %s\n" % (n, b"x" * 2_000) for n in range(10_000)]
    with start(ECHO) as child:
        assert child.exchange(lines) == [line[:-1] for line in lines]
        assert child.exchange([]) == []
        assert child.exchange([b"one\n", b"\n"]) == [b"one", b""]
        echo = repr(process.STOP.decode().strip())
        assert child.stop() == f"the adapter wrote a line that answers no command: {echo}"


def test_the_process_goes_on_while_the_kit_does_something_else(tmp_path: Path) -> None:
    lines = [b"%d %s\n" % (n, b"x" * 2_000) for n in range(2_000)]  # more than the pipes hold
    done = tmp_path / "done"
    with start(f"{ECHO}    if line[:5] == '1999 ': open({str(done)!r}, 'w')") as child:
        child.send(lines)
        until = time.monotonic() + 30
        while not done.exists() and time.monotonic() < until:
            child.pump()
        assert done.exists()
        assert child.answers() == [line[:-1] for line in lines]


def test_a_clean_stop_says_nothing() -> None:
    with start("import sys\nfor line in sys.stdin:\n if 'stop' in line: break") as child:
        assert child.stop() is None
        assert child.stop() is None
        with pytest.raises(AdapterError, match="already ended"):
            child.exchange([LINE])


def test_the_end_of_input_can_stop_too() -> None:
    with start(ECHO) as child:
        assert child.stop(b"") is None


def test_hang() -> None:
    code = "for name in 'ab': input(); print(name, flush=True)\n" + SLEEPS
    with start(code) as child:
        assert child.exchange([LINE]) == [b"a"]
        child.limit_s = LIMIT
        with pytest.raises(AdapterError) as caught:
            child.exchange([LINE] * 2)
    error = caught.value
    assert (error.kind, error.answers, error.exit_code) == ("hang", [b"b"], None)
    assert "no answer within 0.2 s after 1 of 2" in str(error)


def test_the_limit_is_for_each_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes nearly as long; the clock is the test's."""
    now, there = 0.0, list[bytes]()
    listen = Process._listen

    def one(child: Process, timeout_s: float) -> list[bytes]:
        nonlocal now
        while timeout_s > 0 and not there:
            there.extend(listen(child, timeout_s))
        now += 0.9 * child.limit_s
        return [there.pop(0)] if timeout_s > 0 else []

    with start(ECHO) as child, monkeypatch.context() as patched:
        patched.setattr(process, "monotonic", lambda: now)
        patched.setattr(Process, "_listen", one)
        assert child.exchange([LINE] * 4) == [LINE[:-1]] * 4


def test_crash_with_exit_code_and_the_end_of_stderr() -> None:
    code = """
import sys
input(); print("a", flush=True); input()
for n in range(100): print("line", n, file=sys.stderr)
print("y" * 5_000, file=sys.stderr)
sys.exit(7)
"""
    error = failure(code, 3)
    assert (error.kind, error.answers, error.exit_code) == ("crash", [b"a"], 7)
    assert str(error) == "the adapter exited after 1 of 3 answers, with exit code 7"
    assert error.stderr == [*(f"line {n}" for n in range(71, 100)), "y" * STDERR_LENGTH]
    assert len(error.stderr) == STDERR_LINES


def test_crash_between_two_exchanges() -> None:
    with start("input(); print(1)") as child:
        assert child.exchange([LINE]) == [b"1"]
        os.waitid(os.P_PID, child._process.pid, os.WEXITED | os.WNOWAIT)
        with pytest.raises(AdapterError) as caught:
            child.exchange([LINE])
    assert (caught.value.kind, caught.value.exit_code) == ("crash", 0)


def test_it_closes_its_input_but_lives() -> None:
    code = "import os\ninput()\nos.close(0)\nprint(1, flush=True)\n" + SLEEPS
    with start(code) as child:
        child.exchange([LINE])
        child.limit_s = LIMIT
        with pytest.raises(AdapterError, match="standard input") as caught:
            child.exchange([LINE])
    assert caught.value.kind == "closed"


def test_a_gigabyte_on_one_line_takes_no_memory() -> None:
    tracemalloc.start()
    try:
        error = failure(
            "import os\ninput()\nfor _ in range(1 << 14): os.write(1, b'x' * (1 << 16))"
        )
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert error.kind == "line"
    assert peak < 8 << 20


def test_answers_that_are_large_together() -> None:
    lines = [LINE] * 1_000
    code = "import os\ninput()\nwhile True: os.write(1, b'x' * 900 + b'\\n')"
    child = Process([sys.executable, "-c", code], max_line=1_000)
    with child, pytest.raises(AdapterError, match="answers have") as caught:
        child.exchange(lines)
    assert caught.value.kind == "output"


@pytest.mark.parametrize("more", ["2\\n", "2"])
def test_a_surplus_that_comes_late(more: str, tmp_path: Path) -> None:
    code = f"""
import sys, time
input(); print(1, flush=True); time.sleep(.1)
sys.stdout.write("{more}"); sys.stdout.flush()
open({str(tmp_path / "written")!r}, "w").close()
input()
"""
    with start(code) as child:
        assert child.exchange([LINE]) == [b"1"]
        while not (tmp_path / "written").exists():
            time.sleep(0.01)
        with pytest.raises(AdapterError, match="answers no command: '2'") as caught:
            child.exchange([LINE])
    assert caught.value.kind == "output"
    with start(code) as child:
        assert child.exchange([LINE]) == [b"1"]
        assert str(child.stop()).startswith(
            "the adapter wrote a line that answers no command: '2' (did you mean"
        )


FAILS = {
    "trickles": (
        "import os, time\ninput()\nwhile True: os.write(1, b'x'); time.sleep(.05)",
        *(1, LIMIT, "hang", [], None, "no answer"),
    ),
    "reads nothing": (SLEEPS, 100_000, LIMIT, "hang", [], None, "no answer"),
    "does not flush": (FORGETS_TO_FLUSH, 1, LIMIT, "hang", [], None, "flushed"),
    "aborts": ("import os\nos.abort()", 1, 5, "crash", [], -6, "SIGABRT"),
    "ends while the kit writes": ("import sys\nsys.exit(3)", 100_000, 5, "crash", [], 3, "code 3"),
    "ends in the middle of a line": (
        "import sys\ninput()\nsys.stdout.write('{\"messages\"')",
        *(1, 5, "crash", [], 0, "in the middle of a line"),
    ),
    "closes its output": ("import os\nos.close(1)\n" + SLEEPS, 1, 5, "closed", [], None, ""),
    "writes without end": (
        "import os\ninput()\nwhile True: os.write(1, b'{}\\n' * 1000)",
        *(2, 5, "output", [b"{}", b"{}"], None, ""),
    ),
    "answers twice": (
        "import sys\nfor line in sys.stdin: sys.stdout.write('1\\n2\\n'); sys.stdout.flush()",
        *(3, 5, "output", [b"1", b"2", b"1"], None, ""),
    ),
    "says more than its answer": (
        "import sys\nfor line in sys.stdin: print('DEBUG: late\\n{}', flush=True)",
        *(1, 5, "output", [b"DEBUG: late"], None, ": 'DEBUG: late' (did you mean to"),
    ),
}
"""A program, how many lines it is sent, the limit; what is said of it."""


@pytest.mark.parametrize("how", FAILS)
def test_a_program_that_breaks_is_named_for_it(how: str) -> None:
    code, lines, limit_s, kind, answers, exit_code, says = FAILS[how]
    error = failure(code, lines, limit_s)
    assert (error.kind, error.answers, error.exit_code) == (kind, answers, exit_code)
    assert says in str(error)


BEGETS = """
import os, sys, time
sys.stdin.readline()
if os.fork() == 0:
    {first}
    print(os.getpid(), flush=True)
    {then}
sys.stdin.readline()
"""
SETSID = "os.setsid()"
TWICE = f"{SETSID}\n    if os.fork(): os._exit(0)"
SLEEP = "time.sleep(60)"
DESCENDANTS = {
    "a child": ("pass", SLEEP),
    "of another session": (SETSID, SLEEP),
    "whose parent has ended": (TWICE, SLEEP),
    "with an empty environment": (TWICE, 'os.execve("/bin/sleep", ["sleep", "60"], {})'),
}


@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize("how", DESCENDANTS)
def test_its_descendants_end_with_it(how: str, stops: bool) -> None:
    first, then = DESCENDANTS[how]
    with start(BEGETS.format(first=first, then=then)) as child:
        pid = int(child.exchange([LINE])[0])
        assert alive(pid)
        assert not stops or child.stop() is None
    assert gone(pid) and not child.left


def test_a_child_that_went_away_and_holds_the_pipes_blocks_nobody(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(process.children, "descendants", lambda *_: set())  # it is not found
    away = FORK.format(first=AWAY)
    with start(away + "input()") as child:
        pid = int(child.exchange([LINE])[0])
        assert child.stop() is None
    assert alive(pid)
    os.kill(pid, 9)
    error = failure(away + "os.read(there, 1); sys.exit(4)", 2)
    os.kill(int(error.answers[0]), 9)
    assert (error.kind, error.exit_code) == ("crash", 4)


def test_stop_is_ignored() -> None:
    code = "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
    with start(code + "input(); print(1, flush=True)\nwhile True: time.sleep(1)") as child:
        child.exchange([LINE])
        child.limit_s = LIMIT
        assert child.stop() == "the adapter did not exit within 0.2 s of stop and was killed"


def test_stop_while_it_floods_its_output() -> None:
    with start("import os\ninput()\nwhile True: os.write(1, b'x' * 999)", limit_s=LIMIT) as child:
        assert "was killed" in str(child.stop())


def test_the_exit_code_after_stop() -> None:
    with start("import sys\ninput(); sys.exit(2)") as child:
        assert child.stop() == "the adapter exited on stop with exit code 2; expected exit code 0"


def test_it_had_ended_before_stop() -> None:
    with start("import os\ninput(); print(os.getpid(), flush=True)\nos.abort()") as child:
        assert gone(int(child.exchange([LINE])[0]))
        assert child.stop() == "the adapter exited before stop, with signal 6 (SIGABRT)"


@pytest.mark.parametrize(
    ("content", "mode", "why"),
    [
        (None, 0, "No such file"),
        (b"#!/bin/sh\n", 0o600, "Permission denied"),
        (b"#! /no/such/ruby -w\n", 0o700, "its interpreter '/no/such/ruby' does not exist"),
        (b"#!/bin/sh\r\n", 0o700, r"its interpreter '/bin/sh\\r' does not exist; write its lines"),
        (b"\xef\xbb\xbf#!/bin/sh\n", 0o700, "it begins with a byte order mark"),
        (b"print(1)\n", 0o700, "it is neither a program of this system nor a script"),
    ],
)
def test_a_command_that_cannot_be_started(
    content: bytes | None, mode: int, why: str, tmp_path: Path
) -> None:
    command = tmp_path / "run"
    if content is not None:
        command.write_bytes(content)
        command.chmod(mode)
    with pytest.raises(AdapterError, match=f"run cannot be started: {why}") as caught:
        Process([str(command)])
    assert caught.value.kind == "start"
    with pytest.raises(AdapterError, match="an empty command cannot be started"):
        Process([])


def test_a_flood_on_stderr_does_no_harm() -> None:
    code = """
import os
flood = b"z" * 65536 if {long} else b"words\\n" * 10000
while True:
    line = os.read(0, 100)
    if b"stop" in line or not line: break
    for _ in range(500): os.write(2, flood)
    os.write(1, b"1\\n")
"""
    tracemalloc.start()
    try:
        for long in (True, False):
            with start(code.format(long=long)) as child:
                assert child.exchange([LINE]) == [b"1"]
                assert child.stop() is None
                tail = child.stderr
            assert tail == (["z" * STDERR_LENGTH] if long else ["words"] * STDERR_LINES)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()


def test_a_child_that_cannot_be_ended_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "_ROUNDS", 1)
    monkeypatch.setattr(process.children, "descendants", lambda *_: {2**30})
    with start("import sys\nfor line in sys.stdin:\n if 'stop' in line: break") as child:
        assert child.stop() == f"processes of the adapter are still running: {2**30}"
