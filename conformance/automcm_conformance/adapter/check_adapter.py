"""``automcm conform check-adapter``: does an adapter speak the protocol of docs/adapter.md?

Looks for the usual mistakes of a new adapter.  The suite, not this command, checks the behaviour
of the station.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

from automcm_conformance.adapter.process import AdapterError, Process
from automcm_conformance.adapter.protocol import (
    DEFAULTS,
    INDICATIONS,
    SAY_HELLO,
    Answer,
    Object,
    ProtocolError,
    Refused,
    read_answer,
    read_hello,
)

Level = Literal["error", "warning", "ok"]

STATION = 4711
PEER = 77
START = 1_000_000
"""All times in ms are at least half of this, so that no duration looks like a time."""
SHORT = DEFAULTS | {"t_timeout": 200, "backoff_max": DEFAULTS["backoff_min"]}
DURATIONS = {"advertise": 40, "resend": 70, "giveup": 50}
PLANNED = {"t0": 0, "points": [[0, 0, 0], [1000, 8333, 0]]}
_NEVER = [STATION, 2**40]
"""A session that does not exist."""
_MALFORMED = "a malformed message must be discarded, not answered with an error (END-5)"
_SHOWN = 300


@dataclass(frozen=True, slots=True)
class Checked:
    """A check that passed (``ok``) or a mistake, with the command and its answer."""

    level: Level
    what: str
    sent: str = ""
    answered: str = ""
    stderr: list[str] = field(default_factory=list)
    """The last lines of standard error, if the process has ended."""


def check(command: Sequence[str], limit_s: float, notify: Callable[[str], None]) -> list[Checked]:
    """Start the adapter, try all commands, and return the findings, each mistake once.

    ``limit_s`` is the real time in seconds that an answer may take.  ``notify`` gets the name of
    each check as it begins.  Nothing that the adapter does raises an exception.
    """
    return _Check(command, limit_s, notify).run()


class _Check:
    def __init__(
        self, command: Sequence[str], limit_s: float, notify: Callable[[str], None]
    ) -> None:
        self._command, self._limit_s, self._notify = command, limit_s, notify
        self._findings: list[Checked] = []
        self._features: list[str] = []
        self._scenario = "lane_change"
        self._parameters: dict[str, int] = SHORT
        self._now = 0
        self._failed = False
        self._sent: list[bytes] = []
        self._answered: list[bytes] = []

    def run(self) -> list[Checked]:
        with self._part("the adapter starts and answers hello"), self._process() as process:
            self._hello(process)
            process.stop()
        if self._failed and not self._answered:
            return self._findings
        lines: list[bytes] = []
        with self._part("each command has a valid answer"):
            with self._process() as process:
                process.exchange([SAY_HELLO])
                self._script(process)
                if wrong := process.stop():
                    self._add("error", f"stop: {wrong}", b'{"cmd": "stop"}')
            lines, first = list(self._sent), list(self._answered)
        if lines:
            with self._part("the same commands get the same answers"):
                self._repeated(lines, first)
        for what, line in (
            ("an unknown command", b'{"cmd": "dance"}\n'),
            ("a line that is not JSON", b"dance\n"),
        ):
            with self._part(f"{what} is rejected, and the adapter continues"):
                self._refuses(what, line)
        return self._findings

    def _process(self) -> Process:
        return Process(self._command, limit_s=self._limit_s)

    @contextmanager
    def _part(self, what: str) -> Iterator[None]:
        """One check: an AdapterError becomes a finding; without an error the check is ok."""
        self._notify(what)
        self._failed, self._sent, self._answered = False, [], []
        try:
            yield
        except AdapterError as error:
            self._failed = True
            sent = _shown(self._sent[-1]) if self._sent else ""
            self._findings.append(Checked("error", str(error), sent, stderr=error.stderr))
        if not self._failed:
            self._findings.append(Checked("ok", what))

    def _add(self, level: Level, what: str, sent: bytes = b"", answered: bytes = b"") -> None:
        self._failed |= level == "error"
        if all(known.what != what for known in self._findings):
            self._findings.append(Checked(level, what, _shown(sent), _shown(answered)))

    def _exchange(self, process: Process, line: bytes) -> bytes:
        self._sent.append(line)
        [answered] = process.exchange([line])
        self._answered.append(answered)
        return answered

    def _ask(self, process: Process, value: Object, hint: str = "") -> Answer | None:
        """Send a command and check its answer.  None if the answer is invalid."""
        line = _line(value)
        answered = self._exchange(process, line)
        self._now = value.get("now", self._now)
        try:
            answer = read_answer(answered)
        except ProtocolError as error:
            what = f"{hint}: {error}" if hint and isinstance(error, Refused) else str(error)
            self._add("error", what, line, answered)
            return None
        for level, what in self._faults(answer):
            self._add(level, what, line, answered)
        return answer

    def _faults(self, answer: Answer) -> Iterator[tuple[Level, str]]:
        """Mistakes in an answer that no rules of a station could explain."""
        if answer.deadline is not None and answer.deadline <= self._now:
            if answer.deadline < START // 4:
                yield (
                    "error",
                    "'deadline' is the time at which a timer expires, not how long it runs",
                )
            else:
                yield "error", "'deadline' has passed: fire timers due at 'now' before answering"
        for message in answer.messages:
            if message["type"] == "Advertisement" and message.get("seq") != 1:
                yield "error", "an Advertisement must have seq 1: it begins its session"
        if answer.cams and "cam" not in self._features:
            yield "warning", "the answer has 'cams', but hello does not name the feature cam"

    def _hello(self, process: Process) -> None:
        answered = self._exchange(process, SAY_HELLO)
        try:
            hello = read_hello(answered)
        except ProtocolError as error:
            self._add("error", f"hello: {error}", SAY_HELLO, answered)
            return
        self._features = list(hello.features)
        self._scenario = hello.scenarios[0]
        self._parameters = hello.fitted(SHORT)
        if not {"prescriber", "receiver"} & set(hello.features):
            what = "the features name neither prescriber nor receiver: most cases are skipped"
            self._add("warning", what, SAY_HELLO, answered)

    def _script(self, process: Process) -> None:
        """Send each command once, and keep them all for ``_repeated``."""
        self._sent, self._answered = [], []
        self._ask(process, self._reset(START))
        if "prescriber" in self._features:
            answer = self._request(process)
            if answer and not _sends(answer, "Advertisement"):
                self._add(
                    "warning", "a request is not answered with an Advertisement", self._sent[-1]
                )
            self._advance(process, answer, 8)
        for command in self._commands():
            self._ask(process, {"cmd": "command", "now": self._now, "command": command})
        self._ask(process, self._reset(START // 2))  # earlier than before
        if "receiver" in self._features:
            self._join(process)
        for message in _messages():
            self._receive(process, message)
        for message in _malformed():
            self._receive(process, message, hint=_MALFORMED)
        if "restart" in self._features:
            self._ask(process, {"cmd": "restart", "now": self._now})
        if "durations" in self._features:
            self._durations(process)

    def _reset(self, now: int) -> Object:
        reset = {"cmd": "reset", "now": now, "station": STATION, "seed": 1}
        return {**reset, "parameters": self._parameters}

    def _request(self, process: Process) -> Answer | None:
        command = {"name": "request", "scenario": self._scenario, "details": {}}
        return self._ask(process, {"cmd": "command", "now": self._now, "command": command})

    def _receive(
        self, process: Process, message: Object, planned: Object | None = None, hint: str = ""
    ) -> Answer | None:
        value = {"cmd": "receive", "now": self._now, "message": message}
        return self._ask(process, value | ({"planned": planned} if planned else {}), hint)

    def _advance(self, process: Process, answer: Answer | None, times: int) -> None:
        """Advance from deadline to deadline, as the suite does."""
        for _ in range(times):
            if answer is None or answer.deadline is None or answer.deadline <= self._now:
                break
            answer = self._ask(process, {"cmd": "advance", "now": answer.deadline})
        self._ask(process, {"cmd": "advance", "now": self._now})

    def _commands(self) -> Iterator[Object]:
        """Each command of the application once, for a session that does not exist."""
        of = {"session": _NEVER, "proposal": 1}
        durations = {"hold_ms": 200, "lease_ms": 5000}
        if "prescriber" in self._features:
            yield {"name": "prescribe", **of, "target": PEER, "prescribed": PLANNED, **durations}
            yield {"name": "close", "session": _NEVER}
            yield {"name": "proceed", "session": _NEVER}
            yield {"name": "complete", "session": _NEVER}
        if "receiver" in self._features:
            yield {"name": "accept", **of, "selected": PLANNED}
            yield {"name": "refuse", **of}
        if self._features:
            yield {"name": "abort", "session": _NEVER}

    def _join(self, process: Process) -> None:
        """Take a receiver through a session, from the Advertisement to the Fin."""
        answer = self._receive(process, _advertisement(), PLANNED)
        if answer and not _sends(answer, "Intention"):
            self._add(
                "warning", "an Advertisement is not answered with an Intention", self._sent[-1]
            )
        self._advance(process, answer, 1)
        self._receive(process, _addressed("Ack", 0, of={"type": "Intention", "seq": 1}))
        prescribed = {"proposal": 1, "prescribed": PLANNED, "hold_ms": 200, "lease_ms": 5000}
        self._receive(process, _addressed("Prescription", 2, **prescribed))
        accept = {"name": "accept", "session": [PEER, 1], "proposal": 1, "selected": PLANNED}
        self._ask(process, {"cmd": "command", "now": self._now, "command": accept})
        self._receive(process, _addressed("Fin", 3))

    def _durations(self, process: Process) -> None:
        """Timers have the durations that were set, until the next reset."""
        self._ask(process, self._reset(START))
        self._ask(process, {"cmd": "durations", "durations": DURATIONS})
        if "prescriber" in self._features:
            answer, duration = self._request(process), DURATIONS["advertise"]
        else:
            answer = self._receive(process, _advertisement(), PLANNED)
            duration = DURATIONS["giveup"]
        if answer and answer.deadline not in (None, START + duration):
            what = f"durations has no effect: the deadline should be {START + duration}"
            self._add("error", what, self._sent[-1], self._answered[-1])

    def _repeated(self, lines: list[bytes], first: list[bytes]) -> None:
        """Repeat the commands in a new process, after another reset, and all written at once."""
        with self._process() as process:
            process.exchange([SAY_HELLO])
            for what in (
                "a new process gives another answer to the same commands: randomness or a clock?",
                "reset does not clear all state: the same commands get another answer after it",
            ):
                again = [self._exchange(process, line) for line in lines]
                if not self._same(what, lines, first, again):
                    return
            what = "the answer differs when several commands are written at once"
            self._same(what, lines, again, process.exchange(lines))
            if wrong := process.stop(b""):
                self._add("error", f"end of input: {wrong}")

    def _same(self, what: str, lines: list[bytes], first: list[bytes], again: list[bytes]) -> bool:
        """Whether the answers are equal.  The first difference becomes a finding."""
        for line, one, other in zip(lines, first, again, strict=True):
            if _compared(one, True) != _compared(other, True):
                self._add("error", f"{what}; before: {_shown(one)}", line, other)
                return False
            if _compared(one, False) != _compared(other, False):
                text = "a new session has another number after the same commands: allowed, but"
                self._add("warning", f"{text} a failure cannot be repeated exactly", line, other)
        return True

    def _refuses(self, what: str, line: bytes) -> None:
        with self._process() as process:
            process.exchange([SAY_HELLO])
            answered = self._exchange(process, line)
            try:
                read_answer(answered)
            except Refused:
                pass
            except ProtocolError as error:
                self._add("error", f"{what}: {error}", line, answered)
            else:
                text = f'{what} must be answered with {{"error": "why"}}'
                self._add("error", text, line, answered)
            self._ask(process, self._reset(START))


def _line(value: Object) -> bytes:
    return json.dumps(value).encode() + b"\n"


def _shown(line: bytes) -> str:
    text = line.decode(errors="replace").strip()
    return text if len(text) <= _SHOWN else text[:_SHOWN] + " ..."


def _sends(answer: Answer, kind: str) -> bool:
    return any(message["type"] == kind for message in answer.messages)


def _advertisement() -> Object:
    fields = {"scenario": "lane_change", "details": {}}
    return {"v": 1, "type": "Advertisement", "src": PEER, "session": [PEER, 1], "seq": 1} | fields


def _addressed(kind: str, seq: int, **fields: object) -> Object:
    """A message from the peer in its session."""
    head = {"v": 1, "type": kind, "src": PEER, "dst": STATION, "session": [PEER, 1], "seq": seq}
    return head | fields


def _messages() -> list[Object]:
    """Messages that any station may receive at any time."""
    cam = {"generation_ms": 1, "x_mm": 0, "y_mm": 0, "heading_mrad": 0, "speed_mm_s": 0}
    return [
        _advertisement(),
        {"v": 1, "type": "CAM", "src": PEER, **cam, "marks": [[PEER, 1]]},
        _addressed("Fin", 4),
        _addressed("Cancel", 5, reason="abort"),
        _addressed("Fin", 6, dst=STATION + 1),
    ]


def _malformed() -> list[Object]:
    fin = _addressed("Fin", 7)
    return [
        {},
        {key: value for key, value in fin.items() if key != "seq"},
        {**fin, "color": "red"},
        {**fin, "type": "Dance"},
        {**fin, "src": str(PEER)},
        {**fin, "session": None},
        {**fin, "session": [PEER]},
    ]


def _compared(line: bytes, numbered: bool) -> object:
    """The parts of an answer that are compared.

    ``numbered``: the numbers of the station's own sessions are made equal.
    """
    try:
        answer = read_answer(line)
    except ProtocolError:
        return line
    messages = [_numbered(message) if numbered else message for message in answer.messages]
    indications = [
        {key: _numbered(each[key]) if numbered else each[key] for key in INDICATIONS[each["name"]]}
        | {"name": each["name"]}
        for each in answer.indications
    ]
    messages.sort(key=lambda message: json.dumps(message, sort_keys=True))
    return messages, indications, answer.deadline, answer.phase, answer.cams


def _numbered(value: object) -> object:
    if isinstance(value, list):
        if len(value) == 2 and value[0] == STATION:
            return [STATION, 0]
        return [_numbered(each) for each in value]
    if isinstance(value, dict):
        return {key: _numbered(each) for key, each in value.items()}
    return value
