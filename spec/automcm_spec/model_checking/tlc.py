"""Runs TLC and parses its output (its "-tool" format: blocks with a message code)."""

import re
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Literal, NamedTuple

from automcm_spec.model_checking import tla_values, toolchain
from automcm_spec.support import children, scratch
from automcm_spec.support.paths import TLA

Outcome = Literal["holds", "violates"]
ErrorKind = Literal["parse", "config", "java", "memory", "disk", "timeout", "other"]

DEADLOCK = "Deadlock"
INITIAL = "Initial predicate"


class TlcError(Exception):
    """TLC gave no verdict. module and line locate the error, if TLC reported them.

    partial is the progress of TLC, if it had begun.
    """

    own_lines = True
    """Line feeds in the text are TLC's own (``automcm_cli.shared.common.code_3``)."""
    partial: "Progress | None" = None

    def __init__(
        self, kind: ErrorKind, message: str, module: str | None = None, line: int | None = None
    ) -> None:
        super().__init__(message)
        self.kind: ErrorKind = kind
        self.module = module
        self.line = line


class Location(NamedTuple):
    """A place in a module; lines and columns count from 1, the last column is included."""

    module: str
    line: int
    column: int
    end_line: int
    end_column: int


@dataclass(frozen=True)
class TraceState:
    """A state of a counterexample, and the action that led to it (INITIAL for the first).

    values are those of the variables in text, as TLC printed it. Raises TlcError if there are none.
    """

    index: int
    action: str
    text: str
    values: dict[str, tla_values.Value] = field(init=False)

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "values", tla_values.parse_state(self.text))
        except ValueError as error:
            raise TlcError("other", f"cannot parse a state that TLC printed: {error}") from error


@dataclass(frozen=True)
class Progress:
    """The progress of TLC: depth reached, states generated, distinct states, states left to
    visit."""

    depth: int
    states: int
    distinct_states: int
    queue: int


@dataclass(frozen=True)
class TlcResult:
    """A verdict of TLC.

    property is the TLA+ name of the violated property, "Deadlock", or None: TLC does not name a
    violated temporal property. loop is the index of the state to which a temporal counterexample
    returns. seconds includes the start of Java.
    """

    outcome: Outcome
    property: str | None
    distinct_states: int
    states: int
    depth: int
    seconds: float
    trace: tuple[TraceState, ...] = ()
    loop: int | None = None


class TlcStop:
    """Stops runs from another thread: current ones, and those started later."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[str]] = set()
        self.stopped = False

    def now(self) -> None:
        """Kill Java; each run raises TlcError."""
        with self._lock:
            self.stopped = True
            for process in self._running:
                process.kill()

    def _enter(self, process: subprocess.Popen[str]) -> None:
        with self._lock:
            self._running.add(process)
            if self.stopped:
                process.kill()

    def _leave(self, process: subprocess.Popen[str]) -> None:
        with self._lock:
            self._running.discard(process)


_SHORT = ("-XX:TieredStopAtLevel=1",)
_LONG = tuple(
    f"-XX:Tier4{name}Threshold={16 * usual}"
    for name, usual in [
        ("Invocation", 5_000),
        ("MinInvocation", 600),
        ("Compile", 15_000),
        ("BackEdge", 40_000),
    ]
)
"""Java optimises later: in half of the runs of several seconds, a fifth of the time went there."""
ARCHIVE_MB = 16
"""The smallest heap that has room for the archive."""


def run(
    module: str,
    cfg: Path,
    *,
    workers: int = 1,
    tla_dir: Path = TLA,
    extra: Sequence[str] = (),
    heap_mb: int | None = None,
    timeout_s: float | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_print: Callable[[str], None] | None = None,
    on_violation: Callable[[str | None, Sequence[TraceState]], None] | None = None,
    stop: TlcStop | None = None,
    short: bool = False,
) -> TlcResult:
    """Check a module of tla_dir with a cfg.

    short is for runs of a few seconds: Java then compiles fast instead of well, and uses one core.
    on_print receives each line that the specification prints, immediately; lines are not kept.
    on_violation receives the property and the counterexample of each violation, of which there are
    several only with the option -continue; the result has the last. With
    one worker, the counts, the depth and the counterexample are equal in every run. Raises TlcError
    for any result that is neither a clean pass nor a violation. In any case, afterwards Java is not
    running and has left nothing on disk.
    """
    java, jar = tools()
    with scratch.folder("tlc") as place:
        command = [
            str(java),
            "-Xss64m",
            "-XX:+UseSerialGC",
            *(_SHORT if short else _LONG),
            *quick_start(heap_mb),
            "-XX:+ExitOnOutOfMemoryError",
            "-XX:-UsePerfData",
            f"-XX:ErrorFile={place / 'java.log'}",
            f"-Djava.io.tmpdir={place}",
            "-Dfile.encoding=UTF-8",
            "-Dstdout.encoding=UTF-8",
            "-Duser.language=en",
            *([] if heap_mb is None else [f"-Xmx{heap_mb}m"]),
            *("-cp", str(jar), "tlc2.TLC", "-tool", "-fp", "0"),
            *("-workers", str(workers), "-metadir", str(place / "meta")),
            *("-config", str(cfg.resolve()), *extra, module),
        ]
        started = time.monotonic()
        reader = _Reader(on_progress, on_print, on_violation)
        try:
            with (place / "stderr").open("w+b") as stderr:
                code = _execute(command, tla_dir, stderr, timeout_s, reader.read, stop or TlcStop())
                stderr.seek(0)
                complaint = stderr.read(100_000).decode(errors="replace")
            return reader.result(cfg, code, complaint, time.monotonic() - started)
        except TlcError as error:
            error.partial = reader.progress
            raise


def tools() -> tuple[Path, Path]:
    """Java and TLC's jar. Raises TlcError if either is missing."""
    try:
        return toolchain.java(), toolchain.tla2tools()
    except toolchain.ToolError as error:
        raise TlcError("java", str(error)) from error


def quick_start(heap_mb: int | None = None) -> list[str]:
    """Java options that load TLC faster, if there is an archive of its classes."""
    archive = toolchain.archive()
    if archive is None or (heap_mb is not None and heap_mb < ARCHIVE_MB):
        return []
    return [f"-XX:AOTCache={archive}", "-Xlog:aot*=off"]


def _execute(
    command: Sequence[str],
    cwd: Path,
    stderr: IO[bytes],
    timeout_s: float | None,
    read: Callable[[Iterable[str]], None],
    stop: TlcStop,
) -> int:
    """Run TLC, pass its lines to ``read`` as they come, and return its exit code.

    Raises TlcError if it cannot be started, is stopped, or does not end in time. It ends with this
    process and with the calling thread.
    """
    try:
        process = children.popen(
            command,
            cwd=cwd,
            env=toolchain.environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            encoding="utf-8",
            errors="replace",
        )
    except OSError as error:
        raise TlcError("java", f"TLC could not be started: {error}") from error
    expired = threading.Event()

    def expire() -> None:
        expired.set()
        process.kill()

    timer = None if timeout_s is None else threading.Timer(timeout_s, expire)
    try:
        stop._enter(process)
        if timer:
            timer.start()
        assert process.stdout is not None
        read(process.stdout)
        code = process.wait()
    finally:
        if timer:
            timer.cancel()
        process.kill()
        process.wait()
        stop._leave(process)
        if process.stdout:
            process.stdout.close()
    if stop.stopped:
        raise TlcError("other", "TLC was stopped")
    if expired.is_set():
        raise TlcError("timeout", f"TLC did not end within {timeout_s:g} s")
    return code


# Message codes (class EC of the TLA+ tools).
_INITIALLY = {2107, 2108}  # an invariant, a property: in the initial state
_DEADLOCKED = 2114
_VIOLATIONS = _INITIALLY | {2110, 2112, _DEADLOCKED, 2116}  # invariant, action, temporal property
_TRACE_HEADINGS = {2121, 2264}
_SUCCESS, _SIMULATED, _FINISHED, _PARSE_FAILED, _NESTED = 2193, 2209, 2186, 3002, 2103
_ENDED_WELL = {_SUCCESS, _SIMULATED}
_SANY_STARTS, _SANY_ENDS = 2220, 2219
_INITIAL_STATES, _STATS, _DEPTH, _PROGRESS = 2190, 2199, 2194, 2200
_STATE, _STUTTERING, _BACK_TO_STATE = 2217, 2218, 2122
_KINDS: tuple[tuple[range, ErrorKind], ...] = (
    (range(1001, 1006), "memory"),
    (range(2221, 2250), "config"),
    (range(5001, 5007), "config"),
)

_START = re.compile(r"(.*)@!@!@STARTMSG (\d+):(\d+) @!@!@$")
_END = re.compile(r"@!@!@ENDMSG (\d+) @!@!@$")
_VIOLATED = re.compile(r"(?:Invariant|Property|Action property) (.+?) is violated")
_HEAD = re.compile(
    r"(\d+): (?:Back to state: )?<(.+?)(?: line \d+, col \d+ to line \d+, col \d+ of module \w+)?>$"
)
_PLACES = (
    re.compile(r"line (?P<line>\d+), col \d+ to line \d+, col \d+ of module (?P<module>\w+)"),
    re.compile(r"at line (?P<line>\d+), column \d+(?:.*?)In module (?P<module>\w+)", re.DOTALL),
    re.compile(r"[Ll]ine (?P<line>\d+), column \d+ to line \d+, column \d+ in (?P<module>\w+)"),
    re.compile(r"imported in module (?P<module>\w+)"),
)
_SANY_CHATTER = re.compile(r"Parsing file |Semantic processing of module |\s*$")
_TLC_CHATTER = re.compile(
    r"TLC threw an unexpected|This was probably caused|See the User Output|The exception was a "
)


@dataclass
class _Block:
    """A message of TLC; its text includes nested messages."""

    code: int
    severity: int
    lines: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        return "\n".join(self.lines)


class _Reader:
    """Parses the output line by line and keeps the data for the result."""

    def __init__(
        self,
        on_progress: Callable[[Progress], None] | None,
        on_print: Callable[[str], None] | None,
        on_violation: Callable[[str | None, Sequence[TraceState]], None] | None = None,
    ) -> None:
        self._on_violation = on_violation
        self._on_progress = on_progress
        self._on_print = on_print
        self._open: list[_Block] = []
        self._errors: list[_Block] = []
        self._codes: set[int] = set()
        self._in_sany = False
        self._sany: list[str] = []
        self._loose: deque[str] = deque(maxlen=20)
        self._violation: _Block | None = None
        self._trace: list[TraceState] = []
        self._loop: int | None = None
        self._states = self._distinct = self._depth = 0
        self.progress: Progress | None = None

    def read(self, lines: Iterable[str]) -> None:
        for raw in lines:
            line = raw.rstrip("\r\n")
            if "@!@!@" in line:
                if start := _START.match(line):
                    if start[1]:
                        self._text(start[1])
                    self._open.append(_Block(int(start[2]), int(start[3])))
                    continue
                if self._open and _END.match(line):
                    self._close(self._open.pop())
                    continue
            self._text(line)

    def _text(self, line: str) -> None:
        if self._open:
            self._open[-1].lines.append(line)
        elif self._in_sany:
            self._sany.append(line)
        else:
            self._loose.append(line)
            if self._on_print:
                self._on_print(line)

    def _close(self, block: _Block) -> None:
        if self._open:
            self._open[-1].lines.extend(block.lines)
        code = block.code
        self._codes.add(code)
        if code in (_SANY_STARTS, _SANY_ENDS):
            self._in_sany = code == _SANY_STARTS
        elif code in _VIOLATIONS:
            self._tell()
            self._violation, self._trace = block, []
            if code in _INITIALLY:
                head, _, state = block.text.partition("\n")
                block.lines = [head]
                self._trace = [TraceState(1, INITIAL, state)]
        elif code == _STATE:
            if self._violation:
                self._state(block)
        elif code == _STUTTERING:
            self._loop = len(self._trace)
        elif code == _BACK_TO_STATE:
            self._loop = _numbers(block.text)[0]
        elif code == _INITIAL_STATES:
            self._states = self._distinct = _numbers(block.text)[0]
        elif code == _STATS:
            self._states, self._distinct = _numbers(block.text)[:2]
        elif code == _DEPTH:
            self._depth = _numbers(block.text)[0]
        elif code == _PROGRESS:
            self._progress(block.text)
        elif block.severity == 1 and code not in _TRACE_HEADINGS:
            self._errors.append(block)
        if code not in _VIOLATIONS and self._open and self._open[-1].severity == 1:
            self._open[-1].code = code  # the inner message describes the error

    def _tell(self) -> None:
        """Pass the last violation on."""
        if self._violation and self._on_violation:
            self._on_violation(self._name, self._trace)

    @property
    def _name(self) -> str | None:
        assert self._violation is not None
        if self._violation.code == _DEADLOCKED:
            return DEADLOCK
        match = _VIOLATED.match(self._violation.text)
        return match[1] if match else None

    def _progress(self, text: str) -> None:
        match = re.search(
            r"Progress\((\d+)\).*?: ([\d,]+) states generated.*?"
            r"([\d,]+) distinct states found.*?([\d,]+) states left",
            text,
        )
        if match:
            self.progress = Progress(*(int(g.replace(",", "")) for g in match.groups()))
            if self._on_progress:
                self._on_progress(self.progress)

    def _state(self, block: _Block) -> None:
        head, _, state = block.text.partition("\n")
        match = _HEAD.match(head)
        if not match:
            raise TlcError("other", f"cannot parse a state that TLC printed: {head}")
        self._trace.append(TraceState(int(match[1]), match[2], state))

    def result(self, cfg: Path, code: int, complaint: str, seconds: float) -> TlcResult:
        """The result, once TLC has ended. Raises TlcError if it is not a verdict."""
        if error := self._error(cfg, code, complaint):
            raise error
        self._tell()
        return TlcResult(
            "violates" if self._violation else "holds",
            self._name if self._violation else None,
            distinct_states=self._distinct,
            states=self._states,
            depth=self._depth,
            seconds=seconds,
            trace=tuple(self._trace),
            loop=self._loop,
        )

    def _error(self, cfg: Path, code: int, complaint: str) -> TlcError | None:
        if _PARSE_FAILED in self._codes:
            return _parse_error("\n".join(self._sany))
        output = "\n".join([complaint, *self._loose])
        if "OutOfMemoryError" in output or "insufficient memory for the Java" in output:
            return TlcError("memory", "TLC ran out of memory (the heap of Java is too small)")
        if self._errors:
            return _tlc_error(self._errors, cfg)
        if _FINISHED in self._codes and (self._violation or self._codes & _ENDED_WELL):
            return None
        kind: ErrorKind = "disk" if _is_disk(output) else "java"
        return TlcError(kind, f"TLC failed with exit code {code}: {output.strip()}")


def _numbers(text: str) -> list[int]:
    return [int(n.replace(",", "")) for n in re.findall(r"\d[\d,]*", text)]


def _is_disk(text: str) -> bool:
    return bool(re.search(r"No space left|IOException|could not make a directory", text))


def _place(text: str) -> tuple[str | None, int | None]:
    """The module and line that a message names."""
    for pattern in _PLACES:
        for match in pattern.finditer(text):
            found = match.groupdict()
            return found["module"], int(found["line"]) if "line" in found else None
    return None, None


def _where(module: str | None, line: int | None) -> str:
    if module is None:
        return ""
    return f"{module}.tla: " if line is None else f"{module}.tla line {line}: "


def _parse_error(sany: str) -> TlcError:
    """The error printed by SANY, without progress lines and repetitions."""
    module, line = _place(sany)
    output = sany.partition("Residual stack trace")[0].replace("***Parse Error***", "")
    text = [x for x in dict.fromkeys(output.splitlines()) if x and not _SANY_CHATTER.match(x)]
    return TlcError("parse", _where(module, line) + "\n".join(text), module, line)


def _tlc_error(errors: list[_Block], cfg: Path) -> TlcError:
    first = errors[0]
    text = "\n".join(x for x in first.lines if x and not _TLC_CHATTER.match(x)).lstrip(": \n")
    kind: ErrorKind = next((kind for codes, kind in _KINDS if first.code in codes), "other")
    if kind == "config":
        return TlcError(kind, f"{cfg.name}: {text}")
    if kind == "other" and "heap space" in text:
        kind = "memory"
    if kind == "other" and _is_disk(text):
        kind = "disk"
    nested = [b for b in errors if b.code == _NESTED]
    # Of the nested expressions, the last is the innermost.
    module, line = _place("\n".join(reversed((nested[0] if nested else first).lines)))
    return TlcError(kind, _where(module, line) + text, module, line)
