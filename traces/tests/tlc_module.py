"""Writes logs as a TLA+ module, with numbers that ``TraceCheck.tla`` can represent.

TLC's integers have 31 bits, and it cannot compare the content of strings. So stations become 1, 2,
... in order of appearance (the log's own is 1), session numbers become their rank, times begin at
1, and equal contents become equal numbers. Generation times of CAMs keep their differences, except
those that are too large for ACT-5 whatever happens in the log.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any, get_args

from automcm_spec.log_format.log import (
    ApplicationCommand,
    ApplicationIndication,
    Event,
    Receive,
    Restart,
    Send,
    Timer,
    TimerArm,
    TimerEnd,
    problems,
)
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary import parameters
from automcm_spec.vocabulary.application import Indication, names
from automcm_spec.vocabulary.messages import CancelReason, MessageType, RefusalReason
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.checker.compared import told
from automcm_traces.checker.track import CONTENT, PHASES, ROLES

Json = Any
LARGEST = 10**9
"""The largest time, duration, seq or proposal; the sum of two must be below 2^31."""
UNKNOWN = -1
INDICATIONS = names(Indication)
NAMED = (*get_args(MessageType), "none")
REASON = (*get_args(RefusalReason), *get_args(CancelReason), "none", "")


class TooLarge(Exception):
    """A log whose numbers are too large for TLC; the text says which."""


def limits(log: Log) -> tuple[int, ...]:
    """max_rounds, max_participants, outbox_limit and memory_limit: the constants of Station.tla."""
    known = log.header.known
    return tuple(
        min(known.get(name, parameters.DEFAULTS[name]), LARGEST) for name in parameters.LIMITS
    )


def module(name: str, logs: Sequence[str]) -> str:
    """A module with these logs (each a ``Translation.text``) as ``TheLogs``."""
    parts = [f"L{n} ==\n{text}" for n, text in enumerate(logs, 1)]
    names = ", ".join(f"L{n}" for n in range(1, len(logs) + 1))
    dashes = "-" * 32
    head = f"{dashes} MODULE {name} {dashes}\nEXTENDS TraceCheck\n"
    return head + "\n".join([*parts, f"TheLogs == <<{names}>>", "=" * 78, ""])


class Translation:
    """One log in small numbers. Raises TooLarge.

    ``stations`` and ``numbers`` map back to the real ids, and per station to the real session
    numbers.
    """

    def __init__(self, log: Log, late_ms: int | None = None) -> None:
        self._log = log
        self._me = log.header.station
        self.stations = [0, self._me]
        self._places = {0: 0, self._me: 1}
        self._base = log.events[0][1].t_ms - 1 if log.events else 0
        if log.events and log.events[-1][1].t_ms - self._base > LARGEST:
            raise TooLarge(f"the log spans more than {LARGEST} ms")
        self.numbers = _ranks(log)
        self._generations = _generations(log)
        self._contents: dict[str, int] = {}
        self._large: dict[int, int] = {}
        self._messages: dict[str, int] = {}
        self._timers: dict[str, int] = {}
        self._texts: dict[str, str] = {}
        self._statements: dict[str, int] = {}
        self.text = self._write(late_ms)

    def station(self, real: Json) -> int:
        """The small number of a station; 0 is none, or all."""
        if not _is_int(real):
            return 0
        if real not in self._places:
            self._places[real] = len(self.stations)
            self.stations.append(real)
        return self._places[real]

    # -- the log

    def _write(self, late_ms: int | None) -> str:
        header = self._log.header
        late = header.longest_delay if late_ms is None else late_ms
        drift = header.known.get("clock_drift", 0)
        lasts = (f"{n} |-> {_clamped(ms)}" for n, ms in parameters.durations(header.known).items())
        ranks = (f"{name} |-> {row.rank}" for name, row in parameters.TIMERS.items())
        events = ",\n".join(self._event(n) for n in range(len(self._log.events)))
        statements = ",".join(str(self._statement(event)) for _, event in self._log.events)
        complete = ", ".join(f'"{kind}"' for kind in header.complete)
        return (
            f"[ me |-> 1, ended |-> {_bool(self._log.ended)}, complete |-> {{{complete}}},\n"
            f"largest |-> {LARGEST},\n"
            f"late |-> {min(late, LARGEST)}, lasts |-> [{', '.join(lasts)}],\n"
            f"rank |-> [{', '.join(ranks)}, advertised |-> {parameters.ADVERTISED_RANK}],\n"
            f"drift |-> {drift}, "
            f"slack |-> {_clamped(parameters.cam_lead(drift, header.t_resend, 0))},\n"
            f"messages |-> <<{_table(self._messages)}>>,\n"
            f"timers |-> <<{_table(self._timers)}>>,\n"
            f"said |-> <<{_table(self._statements)}>>,\nsays |-> <<{statements}>>,\n"
            f"events |-> <<{events}>> ]"
        )

    def _event(self, n: int) -> str:
        line, event = self._log.events[n]
        at = f"{line},{event.t_ms - self._base}"
        match event:
            case Receive(message=None):
                return f"Malformed({at},FALSE)"
            case Receive():
                return self._received(at, event)
            case Send(message={"type": "CAM"} as m):
                if problems(m):
                    return f"CamSent({at},0,{{}})"
                return f"CamSent({at},{self.station(m['src'])},{self._marks(m)})"
            case Send(message=m):
                return f"Sent({at},{self._message(m)})"
            case TimerArm(timer=timer, deadline=deadline):
                lasts = max(-LARGEST, min(deadline - event.t_ms, LARGEST))
                return f"Armed_({at},{self._timer(timer)},{lasts})"
            case TimerEnd(op=op, timer=timer):
                name = "Stopped" if op == "stop" else "Expires"
                return f"{name}({at},{self._timer(timer)})"
            case ApplicationCommand():
                return self._command(at, n, event)
            case ApplicationIndication(indication=indication):
                name = self._safe(indication.name, INDICATIONS)
                return f'Told({at},"{name}",{self._told(event)})'
            case Restart():
                return f'Event("restart",{at})'

    def _statement(self, event: Event) -> int:
        """The number of the phase and role that an event states; 0 if it states none."""
        if event.phase is None and event.role is None:
            return 0
        phase, role = event.phase or "", event.role or ""
        text = f'<<"{self._safe(phase, ("", *PHASES))}","{self._safe(role, ("", *ROLES))}">>'
        return _place(self._statements, text)

    def _received(self, at: str, event: Receive) -> str:
        m = event.message
        assert m is not None
        if problems(m):
            mine = m.get("dst", self._me) == self._me  # others may be dropped silently (MSG-1)
            return f"Malformed({at},{_bool(mine)})"
        if m["type"] == "CAM":
            generation = self._generations[_int_or_0(m["generation_ms"])]
            return f"CamReceived({at},{self.station(m['src'])},{self._marks(m)},{generation})"
        given = {} if event.planned is None else {"planned": event.planned}
        concerned = _bool(event.planned is not None)
        return f"Received({at},{self._message(m)},{concerned},{self._content(given)})"

    def _command(self, at: str, n: int, event: ApplicationCommand) -> str:
        name, c = event.command.name, event.command.model_extra or {}
        opens = self._opened(n) if name == "request" else 0
        return (
            f'Commanded({at},"{name}",{self._session(c.get("session"))},'
            f"{self._small(c.get('proposal', 0))},{self.station(c.get('target', 0))},"
            f"{self._content(c)},{self._own_lease(c)},{opens})"
        )

    def _opened(self, n: int) -> int:
        """The session number of the Advertisement that follows the request; 0 if none does."""
        for _, event in self._log.events[n + 1 :]:
            match event:
                case Send(message={"type": "Advertisement"} as m):
                    q, number = _session(m.get("session")) or (0, 0)
                    return self._number(q, number) if q == self._me else 0
                case Send(message={"type": "CAM"}) | Receive() | ApplicationCommand() | Restart():
                    return 0
                case TimerEnd(op="expire"):
                    return 0
        return 0

    # -- the contents of events

    def _message(self, m: dict[str, Json]) -> int:
        body = json.dumps(m, sort_keys=True)
        if body not in self._texts:
            self._texts[body] = self._message_text(m, self._interned(body))
        return _place(self._messages, self._texts[body])

    def _message_text(self, m: dict[str, Json], body: int) -> str:
        of = m.get("of")
        of = of if isinstance(of, dict) else {}
        return (
            f'M("{self._safe(m["type"], NAMED)}",{self.station(m.get("src"))},'
            f"{self.station(m.get('dst', 0))},{self._session(m.get('session'))},"
            f"{self._small(m.get('seq'))},{self._small(m.get('proposal', 0))},"
            f'{_bool(m.get("accepted") is True)},"{self._reason(m.get("reason", "none"))}",'
            f'<<"{self._safe(of.get("type", "none"), NAMED)}",{self._small(of.get("seq", 0))}>>,'
            f"{body},{self._content(m)},{self._lease(m)},"
            f"{_bool(not problems(m))})"
        )

    def _lease(self, m: dict[str, Json]) -> int:
        """The duration of the lease timer with a Prescription that is sent or received."""
        return self._own_lease(m) if m.get("src") == self._me else _clamped(m.get("lease_ms"))

    def _own_lease(self, given: dict[str, Json]) -> int:
        """The duration of the lease timer with a Prescription of the station itself."""
        lease_ms: Json = given.get("lease_ms")
        drift = self._log.header.known.get("clock_drift", 0)
        return _clamped(
            parameters.lease_lasts(drift, "prescriber", int(lease_ms))
            if _is_int(lease_ms)
            else lease_ms
        )

    def _timer(self, timer: Timer) -> int:
        named = timer.model_dump(exclude_none=True)
        m = named.get("message", {})
        return _place(
            self._timers,
            f'T("{timer.name}","{self._safe(m.get("type", "none"), NAMED)}",'
            f"{self.station(m.get('to', 0))},{self._session(m.get('session'))},"
            f"{self._small(m.get('seq', 0))},{self.station(named.get('station', 0))})",
        )

    def _told(self, event: ApplicationIndication) -> str:
        """The content of an indication that is compared, as a record."""
        found = []
        indication = event.indication
        for name, value in told(indication.name, indication.model_extra or {}).items():
            match name:
                case "session":
                    text = self._session(value)
                case "proposal":
                    text = str(self._small(value))
                case "rule":
                    text = f'"{self._safe(value, tuple(RULES))}"'
                case "reason":
                    text = f'"{self._reason(value)}"'
                case "lease_left_ms":
                    text = str(_clamped(value))
                case "stations" | "intentions":
                    ids = [self.station(s) for s in value] if isinstance(value, list) else [0]
                    ids += [0] if len({*ids}) < len(ids) else []
                    text = "{" + ",".join(map(str, sorted({*ids}))) + "}"
                case "prescription" | "acceptance":
                    text = str(self._interned(json.dumps(value, sort_keys=True)))
                case _:
                    text = str(self._interned(value))
            found.append(f"{name} |-> {text}")
        return f"[{', '.join(found)}]" if found else "<<>>"

    def _marks(self, m: dict[str, Json]) -> str:
        return "{" + ",".join(sorted({self._session(s) for s in m["marks"]})) + "}"

    def _session(self, session: Json) -> str:
        pair = _session(session)
        if pair is None:
            return "<<0,0>>"
        return f"<<{self.station(pair[0])},{self._number(*pair)}>>"

    def _number(self, q: int, n: int) -> int:
        return self.numbers[q].index(n) if n > 0 else 0

    def _content(self, fields: dict[str, Json]) -> str:
        given = [f"{name} |-> {self._interned(fields[name])}" for name in CONTENT if name in fields]
        return f"[{', '.join(given)}]" if given else "<<>>"

    def _interned(self, value: Json) -> int:
        text = json.dumps(value, sort_keys=True)
        return self._contents.setdefault(text, len(self._contents) + 1)

    def _small(self, n: Json) -> int:
        """A number unchanged, or a substitute if it is too large."""
        if not _is_int(n) or n < 0:
            return 0
        return n if n < LARGEST else LARGEST + self._large.setdefault(n, len(self._large))

    def _reason(self, text: Json) -> str:
        return self._safe(text, REASON)

    def _safe(self, text: Json, known: Sequence[str]) -> str:
        return text if text in known else f"other{self._interned(text)}"


def _ranks(log: Log) -> dict[int, list[int]]:
    """For each station, 0 and then its session numbers in order."""
    found: dict[int, set[int]] = {}
    for _, event in log.events:
        for session in _sessions(event):
            if pair := _session(session):
                found.setdefault(pair[0], set()).add(pair[1])
    return {q: [0, *sorted(n for n in numbers if n > 0)] for q, numbers in found.items()}


def _sessions(event: Event) -> Iterator[Json]:
    """All values in the event that name a session."""
    match event:
        case Receive(message=dict() as m) | Send(message=m):
            yield m.get("session")
            marks = m.get("marks")
            yield from marks if isinstance(marks, list) else []
        case ApplicationIndication(indication=indication):
            yield (indication.model_extra or {}).get("session")
        case ApplicationCommand(command=command):
            yield (command.model_extra or {}).get("session")
        case TimerArm(timer=timer) | TimerEnd(timer=timer):
            message = getattr(timer, "message", None)
            if message is not None:
                yield message.session


def _session(value: Json) -> tuple[int, int] | None:
    if isinstance(value, (list, tuple)) and len(value) == 2 and all(map(_is_int, value)):
        return value[0], value[1]
    return None


def _generations(log: Log) -> dict[int, int]:
    """A small number for each generation time of the received CAMs.

    Differences are kept up to the largest lead that ACT-5 allows in this log, and a larger one
    stays larger. Raises TooLarge.
    """
    times = {
        _int_or_0(m.get("generation_ms"))
        for _, event in log.events
        if isinstance(event, Receive) and (m := event.message)
    }
    if not times:
        return {}
    span = log.events[-1][1].t_ms - log.events[0][1].t_ms
    known = log.header.known
    most = 1 + parameters.cam_lead(known.get("clock_drift", 0), log.header.t_resend, span)
    before, *later = sorted(times)
    numbers = {before: 1}
    for t in later:
        numbers[t] = numbers[before] + min(t - before, most)
        before = t
    if numbers[before] > LARGEST:
        raise TooLarge(f"the generation times of its CAMs span more than {LARGEST} ms")
    return numbers


def _place(table: dict[str, int], text: str) -> int:
    return table.setdefault(text, len(table) + 1)


def _table(table: dict[str, int]) -> str:
    return ",\n".join(table)


def _clamped(duration: Json) -> int:
    return min(duration, LARGEST) if _is_int(duration) and duration >= 0 else UNKNOWN


def _is_int(value: Json) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _int_or_0(value: Json) -> int:
    return int(value) if _is_int(value) else 0


def _bool(value: bool) -> str:
    return "TRUE" if value else "FALSE"
