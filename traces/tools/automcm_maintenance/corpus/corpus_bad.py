"""Logs with one defect, made from good ones by a small edit, with their correct verdicts.

The line of the verdict follows from the edit.  A missing effect is reported at the input of its
step; every other defect at the edited line.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

Json = Any
INPUTS = ("receive", "command", "restart")


@dataclass(frozen=True)
class Bad:
    """One bad log: its text, its story, and its correct verdict.

    ``rule`` is empty if no rule required the event.  ``beside`` is the station whose good log is
    checked with it, 0 for none.
    """

    name: str
    base: str
    story: str
    text: bytes
    verdict: Literal["allowed", "diverges", "unreadable", "cannot_tell"]
    line: int
    rule: str = ""
    beside: int = 0


class EditedLog:
    """The records of a good log, for editing.  Lines count from 1."""

    def __init__(self, text: bytes) -> None:
        self.records: list[Json] = [json.loads(line) for line in text.splitlines()]

    def find(self, ev: str, nth: int = 1, **wanted: Json) -> int:
        """The line of the nth event of this kind whose message or payload has these fields."""
        for number, record in enumerate(self.records, 1):
            inner = dict(record)
            for part in ("message", "command", "indication", "timer"):
                inner |= record.get(part, {})
            if record.get("ev") == ev and wanted.items() <= inner.items():
                nth -= 1
                if not nth:
                    return number
        raise LookupError(f"the good log has no event {ev} with {wanted}")

    def input_of(self, line: int) -> int:
        """The line of the input of a line's step."""
        while not _is_input(self.records[line - 1]):
            line -= 1
        return line

    def at(self, line: int) -> Json:
        """The record of a line."""
        return self.records[line - 1]

    def drop(self, line: int) -> None:
        """Remove a line."""
        del self.records[line - 1]

    def text(self) -> bytes:
        """The log with renumbered events."""
        number = 0
        for record in self.records:
            if record["rec"] == "event":
                number += 1
                record["seq"] = number
            elif record["rec"] == "end":
                record["seq"] = number
        return self.as_it_is()

    def as_it_is(self) -> bytes:
        """The log with its present numbers."""
        return b"".join(_line(record) for record in self.records)


def _is_input(record: Json) -> bool:
    return record["ev"] in INPUTS or record.get("op") == "expire"


def _line(record: Json) -> bytes:
    return json.dumps(record, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"


Edit = Callable[[EditedLog], tuple[int, bytes | None]]
"""Changes a log; returns the line of the verdict, and the text if the records do not have it."""


def _set(ev: str, change: Mapping[str, Json], nth: int = 1, **wanted: Json) -> Edit:
    """Change fields of the message or of the event; the verdict names the edited line."""

    def edit(log: EditedLog) -> tuple[int, bytes | None]:
        line = log.find(ev, nth, **wanted)
        record = log.at(line)
        for name, value in change.items():
            holder = record
            *path, last = name.split(".")
            for part in path:
                holder = holder[part]
            holder[last] = value(holder[last]) if callable(value) else value
        return line, None

    return edit


def _drop(ev: str, nth: int = 1, **wanted: Json) -> Edit:
    """Remove an effect; the verdict names the input of its step."""

    def edit(log: EditedLog) -> tuple[int, bytes | None]:
        line = log.find(ev, nth, **wanted)
        named = log.input_of(line)
        log.drop(line)
        return named, None

    return edit


def _drop_input(ev: str, **wanted: Json) -> Edit:
    """Remove an input; the verdict names the event that followed it."""

    def edit(log: EditedLog) -> tuple[int, bytes | None]:
        line = log.find(ev, **wanted)
        log.drop(line)
        return line, None

    return edit


def _twice(ev: str, **wanted: Json) -> Edit:
    """Duplicate an event; the verdict names the second."""

    def edit(log: EditedLog) -> tuple[int, bytes | None]:
        line = log.find(ev, **wanted)
        log.records.insert(line, json.loads(json.dumps(log.at(line))))
        return line + 1, None

    return edit


def _step_later(ms: int, nth: int = 1, **wanted: Json) -> Edit:
    """Delay an expiry and all later events; the verdict names the expiry."""

    def edit(log: EditedLog) -> tuple[int, bytes | None]:
        line = log.find("timer", nth, op="expire", **wanted)
        now = log.at(line)["t_ms"]
        for record in log.records[line - 1 :]:
            if record.get("t_ms") == now:
                record["t_ms"] += ms
                if "deadline" in record:
                    record["deadline"] += ms
        return line, None

    return edit


def _raw(change: Callable[[list[bytes]], tuple[int, bytes]]) -> Edit:
    """Edit the lines as bytes."""

    def edit(log: EditedLog) -> tuple[int, bytes | None]:
        return change([_line(record) for record in log.records])

    return edit


def _header(**change: Json) -> Edit:
    def edit(log: EditedLog) -> tuple[int, bytes | None]:
        log.records[0] |= change
        return 1 if "schema" in change else 0, None

    return edit


def _lost(log: EditedLog) -> tuple[int, bytes | None]:
    log.records[-1]["lost_records"] = 5
    return 0, None


def _seq(change: int) -> Edit:
    def edit(log: EditedLog) -> tuple[int, bytes | None]:
        log.records[9]["seq"] += change
        return 10, log.as_it_is()

    return edit


def _back(log: EditedLog) -> tuple[int, bytes | None]:
    log.records[20]["t_ms"] = log.records[19]["t_ms"] - 1
    return 21, log.as_it_is()


def _cut(lines: list[bytes]) -> tuple[int, bytes]:
    return 0, b"".join(lines[:-1]) + lines[-1][:20]


def _busy_accepted(log: EditedLog) -> tuple[int, bytes | None]:
    line = log.find("send", type="Acceptance", reason="busy")
    message = log.at(line)["message"]
    del message["reason"]
    message |= {"accepted": True, "selected": {"t0": 0, "points": [[0, 0, 0]]}}
    return line, None


def _malformed(log: EditedLog) -> tuple[int, bytes | None]:
    line = log.find("receive", type="Prescription")
    record = log.at(line)
    record["message"]["v"] = 2
    for hint in ("rule", "phase", "role"):
        del record[hint]
    return line + 1, None


def _forged_content(log: EditedLog) -> tuple[int, bytes | None]:
    line = log.find("receive", type="Prescription")
    told = log.at(log.find("indication", name="verify"))["indication"]["prescription"]
    for prescription in (log.at(line)["message"], told):
        prescription["hold_ms"] = 1
    return line, None


SEEDS: tuple[tuple[str, str, str, Edit, str, str, int], ...] = (
    # name, base, story, edit, verdict, rule, beside
    ("ack_missing", "pair-1001", "The Intention is recorded, but its Ack is never sent.",
     _drop("send", type="Ack"), "diverges", "ADV-5", 0),
    ("fin_not_acked_again", "pair-2002", "The second copy of the Fin gets no Ack.",
     _drop("send", 5, type="Ack"), "diverges", "END-3", 0),
    ("ack_twice", "pair-2002", "One copy of the Prescription is acked twice.",
     _twice("send", type="Ack"), "diverges", "NEG-1", 0),
    ("ack_of_another_seq", "pair-1001", "The Ack of the refusal names the seq before it.",
     _set("send", {"message.of": {"type": "Acceptance", "seq": 1}}, 3, type="Ack"),
     "diverges", "NEG-7", 0),
    ("seq_skipped", "pair-1001", "The second Prescription takes a seq further on.",
     _set("send", {"message.seq": 7}, 2, type="Prescription"), "diverges", "NEG-7", 0),
    ("seq_repeated", "pair-1001", "The second Prescription takes the seq of the first.",
     _set("send", {"message.seq": 2}, 2, type="Prescription"), "diverges", "NEG-7", 0),
    ("copy_changed", "pair-2002", "A copy of the refusal gives another reason.",
     _set("send", {"message.reason": "undecided"}, 2, type="Acceptance", seq=2),
     "diverges", "REL-1", 0),
    ("copy_too_late", "pair-2002", "The refusal is sent again 60 ms after it is due.",
     _step_later(60, 2, name="resend"), "diverges", "REL-1", 0),
    ("window_closed_early", "pair-1001", "The window closes one millisecond early.",
     _set("timer", {"t_ms": lambda t: t - 1}, name="advertise", op="expire"),
     "diverges", "PRE-1", 0),
    ("window_too_long", "pair-1001", "The window is to last 100 ms longer than t_advertise.",
     _set("timer", {"deadline": lambda t: t + 100}, name="advertise", op="arm"),
     "diverges", "ADV-1", 0),
    ("lease_longer", "pair-2002", "The receiver's lease is a second longer than prescribed.",
     _set("timer", {"deadline": lambda t: t + 1000}, name="lease", op="arm"),
     "diverges", "NEG-2", 0),
    ("hold_not_stopped", "pair-2002", "A Prescription comes, and the hold timer runs on.",
     _drop("timer", name="hold", op="stop"), "diverges", "NEG-1", 0),
    ("hold_not_armed", "pair-2002", "The Intention is acked, and no hold timer is armed.",
     _drop("timer", name="hold", op="arm"), "diverges", "ADV-6", 0),
    ("timer_of_another_message", "pair-2002", "The give-up timer of the Intention names seq 2.",
     _set("timer", {"timer.message.seq": 2}, name="giveup", op="arm"), "diverges", "ADV-3", 0),
    ("mark_missing", "pair-1001", "A CAM of a bound station names no session.",
     _set("send", {"message.marks": []}, 2, type="CAM"), "diverges", "ACT-5", 0),
    ("mark_kept", "pair-1001", "A CAM names the session after the Fin is acked.",
     _set("send", {"message.marks": [[1001, 1]]}, 7, type="CAM"), "diverges", "ACT-5", 0),
    ("wrong_addressee", "pair-2002", "The Intention goes to a station that did not advertise.",
     _set("send", {"message.dst": 3003}, type="Intention"), "diverges", "ADV-3", 0),
    ("wrong_session", "pair-2002", "The Acceptance names the next session.",
     _set("send", {"message.session": [1001, 2]}, type="Acceptance", accepted=True),
     "diverges", "NEG-2", 0),
    ("wrong_proposal", "pair-2002", "The Acceptance of proposal 2 names proposal 1.",
     _set("send", {"message.proposal": 1}, type="Acceptance", accepted=True),
     "diverges", "NEG-2", 0),
    ("another_trajectory", "pair-2002", "What is accepted is not what the application selected.",
     _set("send", {"message.selected": {"t0": 0, "points": [[0, 0, 0]]}},
          type="Acceptance", accepted=True), "diverges", "NEG-2", 0),
    ("refused_as_accepted", "pair-2002", "The application refuses, the message accepts.",
     _set("send", {"message.accepted": True}, type="Acceptance"), "diverges", "NEG-3", 0),
    ("not_told_of_the_end", "pair-2002", "The Fin comes, and the application is not told.",
     _drop("indication", name="finished"), "diverges", "ACT-3", 0),
    ("told_a_fallback", "pair-2002", "The Fin comes, and the application is told a fallback.",
     _set("indication", {"indication.name": "fallback"}, name="finished"),
     "diverges", "ACT-3", 0),
    ("accepts_unasked", "pair-2002", "The Acceptance goes out, but nobody commanded it.",
     _drop_input("command", name="accept"), "diverges", "NEG-9", 0),
    ("finishes_unasked", "pair-1001", "The Fin goes out, but nobody commanded it.",
     _drop_input("command", name="complete"), "diverges", "ACT-5", 0),
    ("busy_accepted", "busy", "A bound receiver accepts what it must refuse as busy.",
     _busy_accepted, "diverges", "NEG-4", 0),
    ("busy_silent", "busy", "A bound receiver says nothing to another's Prescription.",
     _drop("send", type="Acceptance", reason="busy"), "diverges", "NEG-4", 0),
    ("busy_with_a_seq", "busy", "The busy answer takes a seq, as if it were to be acked.",
     _set("send", {"message.seq": 3}, type="Acceptance", reason="busy"), "diverges", "NEG-4", 0),
    ("wrong_reason", "abort", "The application aborts, the Cancel says timeout.",
     _set("send", {"message.reason": "timeout"}, type="Cancel", reason="abort"),
     "diverges", "END-1", 0),
    ("closed_with_a_seq", "closed", "Cancel(closed) is an answer, but takes a seq.",
     _set("send", {"message.seq": 2}, type="Cancel", reason="closed"), "diverges", "ADV-5", 0),
    ("no_quarantine_armed", "restart", "The station restarts and arms no quarantine.",
     _drop("timer", name="quarantine", op="arm"), "diverges", "END-8", 0),
    ("restart_left_out", "restart", "The quarantine is armed, but no restart came before it.",
     _drop_input("restart"), "diverges", "", 0),
    ("forged_content", "pair-2002", "The Prescription received is not the one that was sent.",
     _forged_content, "diverges", "forged", 1001),
    ("forged_message", "pair-2002", "A Prescription comes in a transmission nobody made.",
     _set("receive", {"tx": "1001:999"}, type="Prescription"), "diverges", "forged", 1001),
    ("cam_of_another", "pair-1001", "The station sends a CAM in another's name.",
     _set("send", {"message.src": 2002}, 2, type="CAM"), "diverges", "ACT-5", 0),
    ("timer_of_another_session", "pair-2002", "The give-up timer names a session it is not in.",
     _set("timer", {"timer.message.session": [1001, 2]}, name="giveup", op="arm"),
     "diverges", "ADV-3", 0),
    ("malformed_acked", "pair-2002", "A Prescription of version 2 is acked, not discarded.",
     _malformed, "diverges", "END-5", 0),
    ("empty", "pair-1001", "A file of no bytes.",
     _raw(lambda lines: (0, b"")), "unreadable", "", 0),
    ("rubbish", "pair-1001", "A file that is no text.",
     _raw(lambda lines: (1, bytes(range(256)))), "unreadable", "", 0),
    ("rubbish_inside", "pair-1001", "One line inside is no text.",
     _raw(lambda lines: (8, b"".join([*lines[:7], b"\xff\xfe\x00\n", *lines[8:]]))),
     "unreadable", "", 0),
    ("no_header", "pair-1001", "The header is missing.",
     _raw(lambda lines: (1, b"".join(lines[1:]))), "unreadable", "", 0),
    ("header_again", "pair-1001", "A second header, as if two logs were put together.",
     _raw(lambda lines: (11, b"".join([*lines[:10], lines[0], *lines[10:]]))),
     "unreadable", "", 0),
    ("another_version", "pair-1001", "The log is of version 2 of the format.",
     _header(schema="automcm.trace/2"), "unreadable", "", 0),
    ("mixed_versions", "pair-1001", "Half-way, a header of version 2 begins.",
     _raw(lambda lines: (11, b"".join(
         [*lines[:10], lines[0].replace(b"trace/1", b"trace/2"), *lines[10:]]))),
     "unreadable", "", 0),
    ("after_the_end", "pair-1001", "An event follows the end.",
     _raw(lambda lines: (len(lines) + 1, b"".join([*lines, lines[1]]))), "unreadable", "", 0),
    ("seq_twice", "pair-1001", "An event has the seq of the one before.",
     _seq(-1), "unreadable", "", 0),
    ("seq_gap", "pair-1001", "A seq is left out: an event is missing before line 10.",
     _seq(1), "cannot_tell", "", 0),
    ("time_backwards", "pair-1001", "The clock goes back by a millisecond.",
     _back, "unreadable", "", 0),
    ("a_float", "pair-1001", "A time with a fraction.",
     _raw(lambda lines: (5, b"".join(
         [*lines[:4], lines[4].replace(b'"t_ms":300', b'"t_ms":300.5'), *lines[5:]]))),
     "unreadable", "", 0),
    ("lost_records", "pair-1001", "The implementation says that it failed to log five events.",
     _lost, "cannot_tell", "", 0),
    ("no_timers_promised", "pair-1001", "Not all timers are promised: what is there is allowed.",
     _header(complete=["command", "receive", "restart", "send"]), "allowed", "", 0),
    ("no_events", "pair-1001", "A header and an end, nothing between.",
     _raw(lambda lines: (0, lines[0] + _line(
         {"rec": "end", "seq": 0, "reason": "clean", "lost_records": 0}))),
     "cannot_tell", "", 0),
    ("cut", "pair-1001", "The last line is cut: what is there is allowed, and a warning says so.",
     _raw(_cut), "allowed", "", 0),
)  # fmt: skip


def bad_logs(bases: Mapping[str, bytes]) -> Iterator[Bad]:
    """Every bad log.  ``bases`` are the good ones by name: "pair-1001" and so on.

    Raises LookupError if a base does not contain the line to edit.
    """
    for name, base, story, edit, verdict, rule, beside in SEEDS:
        log = EditedLog(bases[base])
        line, text = edit(log)
        yield Bad(
            name,
            base,
            story,
            log.text() if text is None else text,
            verdict,  # type: ignore[arg-type]
            line,
            rule,
            beside,
        )


#: Further good logs that are needed, and the events that each must contain.
WANTED: Mapping[str, tuple[str, Mapping[str, Json]]] = {
    "busy": ("send", {"type": "Acceptance", "reason": "busy"}),
    "abort": ("send", {"type": "Cancel", "reason": "abort"}),
    "closed": ("send", {"type": "Cancel", "reason": "closed"}),
    "restart": ("restart", {}),
}


def bases_among(logs: Sequence[bytes]) -> dict[str, bytes]:
    """The first of the shortest of these logs with the events of ``WANTED``."""
    found: dict[str, bytes] = {}
    for text in sorted(logs, key=len):
        for name, (ev, fields) in WANTED.items():
            if name in found:
                continue
            try:
                EditedLog(text).find(ev, **fields)
            except LookupError:
                continue
            found[name] = text
    return found
