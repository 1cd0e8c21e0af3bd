"""Stations that break one thing each: the reference with rows of its tables or its answers changed.

broken_stations.py NAME [ARGUMENT]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from automcm.adapters import adapter_lines as kit
from automcm.core import rules
from automcm.core.actuating import count_cam
from automcm.core.negotiating import foreign, instructed
from automcm.core.outcome import Outcome, Row, always, ignore, leave
from automcm.core.rules import RULES, gives_up
from automcm.core.state import State, Timer
from automcm.core.station import Station
from automcm_spec.vocabulary.application import Fallback

Json = dict[str, Any]
Edit = Callable[..., None]
Kit = kit.Kit
EDITS: dict[str, Edit] = {}
BREAKS: dict[str, tuple[str, str]] = {}
"""The scenario that a station fails, and the rule that it breaks."""
CAUSES: dict[str, tuple[str, str, str]] = {}
"""The rule that a station breaks, the operator of Station.tla that decides it, and what the first
entry of a report on it says."""
AGREEING = ("INTENDING", "WAITING")


class Broken(Kit):
    """The reference; ``edit`` may change its answers."""

    edit: Callable[[Kit, Json, Json], None] = staticmethod(lambda kit, command, answer: None)

    def answer(self, command: Json) -> Json:
        answer = super().answer(command)
        self.edit(self, command, answer)
        return answer


def broken(name: str = "nothing", *arguments: object) -> list[str]:
    """The command that starts a station."""
    return [sys.executable, __file__, name, *map(str, arguments)]


def edit(made: Edit) -> Edit:
    EDITS[made.__name__] = made
    return made


def breaks(scenario: str, rule: str) -> Callable[[Edit], Edit]:
    def note(made: Edit) -> Edit:
        BREAKS[made.__name__] = (f"scenario {scenario}", rule)
        return edit(made)

    return note


def cause(rule: str, operator: str, says: str) -> Callable[[Edit], Edit]:
    def note(made: Edit) -> Edit:
        CAUSES[made.__name__] = (rule, operator, says)
        return edit(made)

    return note


def answers(edit: Callable[[Kit, Json, Json], None]) -> None:
    Broken.edit = staticmethod(edit)


def first(key: str, rule: str, when: Any, then: Any = ignore) -> None:
    """A row before all others of this input."""
    RULES[key] = (Row(rule, when, then), *RULES[key])


@edit
def nothing() -> None:
    """The reference itself; it starts faster than the command does."""


@breaks("all arrives", "ACT-5")
def marks_only_from_actuating_on() -> None:
    @answers
    def unmarked(kit: Kit, command: Json, answer: Json) -> None:
        for cam in answer.get("cams", []):
            cam["marks"] = cam["marks"] if answer["phase"] == "ACTUATING" else []


@breaks("all arrives", "ACT-2")
def sends_no_cam() -> None:
    answers(lambda kit, command, answer: answer.pop("cams", None))


@breaks("one in five lost", "REL-1")
def an_acceptance_is_sent_once() -> None:
    first("expire resend", "REL-1", gives_up("Acceptance"))


@breaks("each lost once", "REL-1")
def the_fin_is_sent_once() -> None:
    first("expire resend", "REL-1", gives_up("Fin"))


@breaks("each twice", "NEG-1")
def a_copy_of_a_prescription_is_out_of_turn() -> None:
    rows = RULES["receive Prescription"]
    RULES["receive Prescription"] = rows[:4] + rows[5:]


@breaks("reordered", "NEG-7")
def an_acceptance_before_the_ack_is_lost_on_it() -> None:
    first("receive Acceptance", "NEG-6", lambda me, st, i: st.phase == "PRESCRIBING")


@breaks("all Acks lost", "NEG-9")
def a_commitment_ends_with_its_acceptance() -> None:
    first("expire giveup", "NEG-9", gives_up("Acceptance"), lambda me, st, i: Outcome(leave(st)))


@breaks("CAMs cut", "ACT-2")
def it_goes_on_by_its_lease_alone() -> None:
    @answers
    def patient(kit: Kit, command: Json, answer: Json) -> None:
        if command["cmd"] == "reset":
            Kit.answer(kit, {"cmd": "durations", "durations": {"cam": 50_000}})


@breaks("CAMs cut one way", "ACT-2")
def cam_loss_sends_no_cancel() -> None:
    def then(me: Any, st: State, i: Any) -> Outcome:
        return Outcome(leave(st), indication=Fallback(session=st.session, reason="cam_loss"))

    first("expire cam", "ACT-2", always, then)


@breaks("two prescribers", "NEG-4")
def busy_is_not_refused() -> None:
    first("receive Prescription", "NEG-4", foreign)


class TwoSessions:
    """A station for the sessions of each prescriber, and all that they say is true."""

    def __init__(self) -> None:
        self.all = {1001: Kit(), 1002: Kit()}
        self.me = 0

    def answer(self, command: Json) -> Json:
        self.me = command.get("station") or self.me
        default = [self.me if command["cmd"] == "command" else 0]
        session = command.get("message", command.get("command", {})).get("session", default)[0]
        if session in self.all:
            now = {"cmd": "advance", "now": command["now"]}
            each = [k.answer(command if p == session else now) for p, k in self.all.items()]
        else:
            each = [k.answer(command) for k in self.all.values()]
        if command["cmd"] == "hello":
            return each[0]
        cams = each[0].get("cams", [])
        for cam, other in zip(cams, each[1].get("cams", []), strict=False):
            cam["marks"] = sorted(cam["marks"] + other["marks"])
        deadlines = [a["deadline"] for a in each if a["deadline"] is not None]
        both = {name: each[0][name] + each[1][name] for name in ("messages", "indications")}
        return both | {"deadline": min(deadlines, default=None), "cams": cams}


@breaks("two prescribers", "ADV-4")
def one_station_in_two_sessions() -> None:
    kit.Kit = TwoSessions  # type: ignore[assignment,misc]


@breaks("prescriber restarts", "ADV-1")
def old_numbers_after_a_restart() -> None:
    again = (Timer("quarantine"),)
    fresh = Outcome(State(quarantine=True), again=again)
    RULES["restart"] = (Row("END-8", always, lambda *_: fresh),)


@breaks("receiver aborts", "END-2")
def a_cancel_is_ignored_in_actuating() -> None:
    first("receive Cancel", "END-3", lambda me, st, i: st.phase == "ACTUATING")


@breaks("receiver aborts", "END-8")
def it_is_free_as_soon_as_it_has_broken_off() -> None:
    abort = RULES["command abort"][2].then

    def free(me: Any, st: State, i: Any) -> Outcome:
        left = abort(me, st, i)
        return left._replace(state=left.state._replace(quarantine=False))

    first("command abort", "END-1", lambda me, st, i: st.bound, free)


@breaks("three receivers", "PRE-2")
def only_one_is_released() -> None:
    @answers
    def silent(kit: Kit, command: Json, answer: Json) -> None:
        said = answer.get("messages", [])
        said[:] = [m for m in said if (m["type"], m.get("dst")) != ("Cancel", 4004)]


@breaks("refused twice", "NEG-6")
def an_old_acceptance_counts() -> None:
    rows = RULES["receive Acceptance"]
    old = Row("NEG-6", lambda me, st, i: not st.awaits_answer, rows[5].then)
    RULES["receive Acceptance"] = (*rows[:5], old, *rows[6:])


@breaks("Fin lost", "ACT-4")
def the_commitment_ends_by_fin_only() -> None:
    duration = Station._duration

    def lasts(self: Station, timer: Timer, now: int) -> int:
        endless = timer.name == "lease" and self.state.role == "receiver"
        return 10**8 if endless else duration(self, timer, now)

    Station._duration = lasts  # type: ignore[method-assign]


@breaks("late copies", "ADV-8")
def a_late_copy_opens_the_session_again() -> None:
    rows = RULES["receive Advertisement"]
    RULES["receive Advertisement"] = tuple(row for row in rows if row.rule != "ADV-8")


@cause("ACT-4", "OnExpiry", "(lease), got")
def lease_counted_from_the_prescription() -> None:
    prescribed_ms = [0]

    @answers
    def note(kit: Kit, command: Json, answer: Json) -> None:
        verifies = any(i["name"] == "verify" for i in answer.get("indications", []))
        prescribed_ms[0] = command["now"] if verifies else prescribed_ms[0]

    duration = Station._duration

    def lasts(self: Station, timer: Timer, now: int) -> int:
        gone = now - prescribed_ms[0] if self.state.role == "receiver" else 0
        return duration(self, timer, now) - (gone if timer.name == "lease" else 0)

    Station._duration = lasts  # type: ignore[method-assign]


@cause("END-6", "Ack", "Ack.of.seq: missing")
def an_ack_without_seq() -> None:
    @answers
    def nameless(kit: Kit, command: Json, answer: Json) -> None:
        for message in answer.get("messages", []):
            if message["type"] == "Ack":
                message["of"] = {"type": message["of"]["type"]}


@cause("NEG-1", "OnPrescription", "not sent: Ack")
def no_ack_of_a_copy() -> None:
    rows = RULES["receive Prescription"]
    again = Row("NEG-1", lambda me, st, i: i.message.proposal <= st.proposal, ignore)
    RULES["receive Prescription"] = tuple(again if row is rows[4] else row for row in rows)


@cause("ACT-5", "OnCam", "CAM")
def an_old_cam_counts() -> None:
    def counts(me: Any, st: State, i: Any) -> bool:
        m = i.message
        return st.phase == "ACTUATING" and m.src == st.peer and st.session in m.marks

    first("receive CAM", "ACT-5", counts, count_cam)


@cause("NEG-1", "OnPrescription", "the proposal is not newer than the last one seen")
def proposal_off_by_one() -> None:
    rows = RULES["receive Prescription"]
    again = Row("NEG-1", lambda me, st, i: i.message.proposal < st.proposal, rows[4].then)
    newer = Row("NEG-1", lambda me, st, i: st.phase in AGREEING, instructed)
    RULES["receive Prescription"] = (*rows[:4], again, newer, *rows[6:])


@edit
def crashes_on_a_prescription() -> None:
    @answers
    def crash(kit: Kit, command: Json, answer: Json) -> None:
        if command["cmd"] == "receive" and command["message"]["type"] == "Prescription":
            raise SystemExit("no idea what to do")


@edit
def says_more_than_an_indication_has() -> None:
    @answers
    def more(kit: Kit, command: Json, answer: Json) -> None:
        for told in answer.get("indications", []):
            told |= {"detail": None, "gaps": [None, 2**70]}


@edit
def one_does_not_hear_that_it_was_not_chosen(station_id: str) -> None:
    deaf = (int(station_id), "WAITING")
    first("receive Cancel", "END-2", lambda me, st, i: (me.station_id, st.phase) == deaf)


@edit
def sends_again_after_200_ms() -> None:
    @answers
    def slow(kit: Kit, command: Json, answer: Json) -> None:
        if command["cmd"] == "reset":
            kit._station.durations = {"resend": 200}


if __name__ == "__main__":
    rules.require = lambda *arrow: None  # type: ignore[assignment]
    kit.Kit = Broken  # type: ignore[misc]
    EDITS[sys.argv[1]](*sys.argv[2:])
    for answer in kit.serve(sys.stdin.buffer):
        sys.stdout.buffer.write(answer)
        sys.stdout.flush()
