"""Logs with one thing wrong, beside those of the corpus.

Each function is given the records of a good log, spoils them, and returns the line where it shows.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

Json = Any
Records = list[dict[str, Json]]


def find(records: Records, ev: str, nth: int = 0, start: int = 0, **wanted: Json) -> int:
    """The index of an event with these fields, its message's, timer's, and so on."""
    for n, record in enumerate(records):
        inner = dict(record)
        for part in ("message", "timer", "indication", "command"):
            inner |= record.get(part, {})
        if n >= start and record.get("ev") == ev and wanted.items() <= inner.items():
            if nth == 0:
                return n
            nth -= 1
    raise LookupError(wanted)


Spoil = Callable[[Records], int]
WRONG: dict[str, tuple[str, Spoil, str]] = {}
"""Which log to spoil, how, and the rule if it is not only to be that of the other engine."""


def wrong(base: str, rule: str = "") -> Callable[[Spoil], Spoil]:
    def note(spoil: Spoil) -> Spoil:
        WRONG[spoil.__name__] = (base, spoil, rule)
        return spoil

    return note


RECEIVER, PRESCRIBER = "rounds/2002", "rounds/1001"


def change(records: Records, n: int, part: str, **fields: Json) -> int:
    """The line of record n, with fields of a part of it changed."""
    inner = records[n] if part == "" else records[n][part]
    inner |= fields
    return n + 1


@wrong("twice/1001")
def a_session_number_is_used_again(r: Records) -> int:
    n = find(r, "send", type="Advertisement", session=[1001, 2])
    text = json.dumps(r[n:]).replace("[1001, 2]", "[1001, 1]")
    r[n:] = json.loads(text)
    return n + 1


@wrong(PRESCRIBER)
def act_4_the_prescribers_lease_lasts_the_full_time(r: Records) -> int:
    n = find(r, "timer", op="arm", name="lease")
    return change(r, n, "", deadline=r[n]["t_ms"] + 20_000)


@wrong(PRESCRIBER)
def act_4_the_header_tells_no_margin(r: Records) -> int:
    del r[0]["parameters"]["clock_drift"]
    return find(r, "timer", op="arm", name="lease") + 1


@wrong(RECEIVER)
def act_4_the_receivers_lease_is_shorter_too(r: Records) -> int:
    n = find(r, "timer", op="arm", name="lease")
    return change(r, n, "", deadline=r[n]["t_ms"] + 20_000 - 201)


@wrong(RECEIVER)
def a_timer_is_stopped_that_goes_on(r: Records) -> int:
    n = find(r, "timer", op="arm", name="lease")
    stop = {key: r[n][key] for key in ("rec", "t_ms", "ev", "timer")} | {"op": "stop"}
    r.insert(n + 1, stop)
    return n + 2


@wrong(RECEIVER)
def end_5_a_message_sent_has_an_unknown_field(r: Records) -> int:
    return change(r, find(r, "send", type="Intention"), "message", note=1)


@wrong(RECEIVER)
def act_5_a_cam_that_is_older_counts(r: Records) -> int:
    n = find(r, "timer", 2, op="arm", name="cam")
    assert r[n - 1]["message"]["type"] == "CAM"
    r[n - 1]["message"]["generation_ms"] = 0
    return n + 1


@wrong(RECEIVER)
def act_5_a_cam_that_is_too_far_ahead_counts(r: Records) -> int:
    n = find(r, "timer", 2, op="arm", name="cam")
    first = find(r, "timer", 1, op="arm", name="cam") - 1
    elapsed = r[n - 1]["t_ms"] - r[first]["t_ms"]
    most = r[first]["message"]["generation_ms"] + elapsed - -elapsed // 100 + 400
    r[n - 1]["message"]["generation_ms"] = most + 1
    return n + 1


@wrong(RECEIVER)
def end_5_bytes_that_are_no_message_are_answered(r: Records) -> int:
    n = find(r, "receive", type="Prescription")
    del r[n]["message"], r[n]["phase"], r[n]["role"]
    r[n]["raw"] = "AAAA"
    return n + 2


def reported(r: Records, times: int) -> int:
    """A Prescription of version 2, and that it was discarded; the line after."""
    n = find(r, "receive", type="Prescription")
    r[n]["message"]["v"] = 2
    del r[n]["phase"], r[n]["role"]
    event = {"rec": "event", "t_ms": r[n]["t_ms"], "ev": "indication"}
    r[n + 1 : n + 1] = [event | {"indication": {"name": "discarded"}} for _ in range(times)]
    return n + times + 2


@wrong(RECEIVER)
def end_5_a_message_that_was_reported_is_obeyed(r: Records) -> int:
    return reported(r, 1)


@wrong(RECEIVER)
def end_5_a_message_is_reported_twice(r: Records) -> int:
    return reported(r, 2) - 1


@wrong(RECEIVER)
def cmd_1_a_command_out_of_place_is_not_refused(r: Records) -> int:
    command = {"name": "complete", "session": [1001, 1]}
    n = find(r, "receive", type="Prescription")
    event = {"rec": "event", "t_ms": r[n]["t_ms"], "ev": "command", "command": command}
    r.insert(n, event)
    return n + 1


@wrong(PRESCRIBER)
def mem_1_a_station_too_many_is_recorded(r: Records) -> int:
    r[0]["parameters"]["max_participants"] = 1
    first = find(r, "receive", type="Intention")
    other = {2002: 3003, 3003: 2002}[r[first]["message"]["src"]]
    return find(r, "send", type="Ack", dst=other) + 1


@wrong(PRESCRIBER)
def mem_1_a_session_is_opened_without_room(r: Records) -> int:
    r[0]["parameters"]["outbox_limit"] = 32
    return find(r, "command", name="request") + 1


@wrong("twice/2002")
def mem_1_a_prescriber_too_many_is_remembered(r: Records) -> int:
    r[0]["parameters"]["memory_limit"] = 1
    return find(r, "receive", type="Advertisement", src=3003, phase="INTENDING") + 1


def resent_first(r: Records, giving_up: Json) -> int:
    """A message goes out once more at the instant at which its sending ends; the line."""
    n = find(r, "timer", op="expire", **giving_up)
    last = find(r, "timer", op="arm", deadline=r[n]["t_ms"], name="resend")
    sent = max(
        k for k in range(last) if r[k].get("ev") == "send" and "marks" not in r[k]["message"]
    )
    expires = {k: v for k, v in r[last].items() if k != "deadline"} | {"op": "expire"}
    again = {**r[last], "deadline": r[n]["t_ms"] + 100}
    copy = {**r[sent], "tx": "9:9"}
    r[n:n] = [{**one, "t_ms": r[n]["t_ms"]} for one in (expires, copy, again)]
    return n + 1


@wrong(PRESCRIBER, "PRE-1")
def an_advertisement_goes_out_at_the_end_of_the_window(r: Records) -> int:
    return resent_first(r, {"name": "advertise"})


@wrong("deaf/1", "REL-1")
def a_fin_goes_out_once_too_often(r: Records) -> int:
    n = find(r, "send", type="Fin")
    message = {"type": "Fin", "to": 2, "session": [1, 1], "seq": r[n]["message"]["seq"]}
    return resent_first(r, {"name": "giveup", "message": message})


@wrong("deaf/1", "REL-1")
def of_two_messages_the_younger_goes_out_first(r: Records) -> int:
    n = find(r, "timer", start=find(r, "send", type="Prescription"), op="expire", name="resend")
    assert r[n]["t_ms"] == r[n + 3]["t_ms"] and r[n + 3]["op"] == "expire"
    r[n : n + 6] = r[n + 3 : n + 6] + r[n : n + 3]
    return n + 1


@wrong(RECEIVER, "ADV-8")
def a_message_comes_first_at_the_instant_of_a_timer(r: Records) -> int:
    n = find(r, "timer", op="expire", name="forget")
    ack = {"v": 1, "type": "Ack", "src": 1001, "dst": 2002, "session": [1001, 1], "seq": 0}
    message = ack | {"of": {"type": "Fin", "seq": 9}}
    r.insert(n, {"rec": "event", "t_ms": r[n]["t_ms"], "ev": "receive", "message": message})
    return n + 1


@wrong(RECEIVER, "END-5")
def end_5_a_message_without_a_session_is_not_reported(r: Records) -> int:
    n = find(r, "receive", type="Prescription")
    del r[n]["message"]["session"]
    return n + 1


@wrong(RECEIVER)
def a_timer_expires_whose_message_is_not_told(r: Records) -> int:
    n = find(r, "timer", op="expire", name="resend")
    del r[n]["timer"]["message"]
    return n + 1
