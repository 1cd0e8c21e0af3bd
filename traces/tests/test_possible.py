"""Logs that do not hold everything: what cannot have happened unseen is still found."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from agreement import of_the_reference
from edits import HEADER, end

from automcm.links.simulated import Channel
from automcm.simulation import Simulation
from automcm.straight import Straight
from automcm_spec.parameters import Parameters
from automcm_traces.engine import Deadline
from automcm_traces.explain import Verdict, explain_file, text
from automcm_traces.finding import Supposition
from automcm_traces.log import RECORD, PlainTimer
from automcm_traces.possible import _covers, _merge, _Supposing

PARTS = (
    ("send",),
    ("receive", "send"),
    ("send", "timer"),
    ("receive", "send", "timer"),
    ("command", "receive", "send"),
    ("command", "indication", "send"),
    ("indication", "receive", "restart", "send"),
    ("command", "indication", "receive", "send", "timer"),
)
ALL = ("command", "indication", "receive", "restart", "send", "timer")
Records = list[dict[str, Any]]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Records]:
    """A lane change of three stations; the target refuses once, and a receiver restarts."""
    folder = tmp_path_factory.mktemp("logs")
    simulation = Simulation(seed=5, channel=Channel(loss=0.2, duplicate=0.2), logs=folder)
    for vehicle in (1001, 2002, 3003):
        driver = Straight(target=3003, refuse_first=1, maneuver_ms=2000)
        simulation.add(vehicle, driver, Parameters(t_cam=500))
    simulation.request(1001, at=500)
    simulation.restart(2002, at=4000)
    simulation.run(until=9_000)
    return [
        [json.loads(line) for line in path.read_text().splitlines()]
        for path in sorted(folder.iterdir())
    ]


def judged(records: Records, kinds: tuple[str, ...], folder: Path) -> Verdict:
    """The log with only these kinds of event, and the promise to hold all of them."""
    kept = [r for r in records if r["rec"] != "event" or r["ev"] in kinds]
    lines = []
    for seq, record in enumerate(kept):
        change: dict[str, Any] = {"seq": seq} if record["rec"] == "event" else {}
        change |= {"complete": list(kinds)} if record["rec"] == "header" else {}
        change |= {"seq": seq - 1} if record["rec"] == "end" else {}
        lines.append(json.dumps(record | change))
    path = folder / "log.ndjson"
    path.write_text("\n".join(lines) + "\n")
    return explain_file(path)


def place(records: Records, ev: str, type_: str, number: int = 0) -> int:
    """Where the log has the nth event of a kind with a message of a type."""
    found = [
        n
        for n, r in enumerate(records)
        if r.get("ev") == ev and r.get("message", {}).get("type") == type_
    ]
    return found[number]


@pytest.mark.parametrize("kinds", PARTS, ids="+".join)
def test_what_is_left_of_an_allowed_log_is_allowed(
    kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    for records in logs:
        verdict = judged(records, kinds, tmp_path)
        assert verdict.verdict == "allowed", (verdict.finding.at.line, verdict.finding.observed)
        assert verdict.possible_states >= 1
        assert set(verdict.unobserved).isdisjoint(kinds)


def generated(folder: Path) -> list[Records]:
    """Good logs: with loss, restarts and aborts, and of a receiver that is asked more often than
    its own max_rounds."""
    found = [[json.loads(line) for line in lines] for lines in of_the_reference(8, 32)]
    simulation = Simulation(seed=1, channel=Channel(loss=0.3), logs=folder)
    simulation.add(1001, Straight())
    simulation.add(2002, Straight(refuse_first=2), Parameters(max_rounds=1))
    simulation.request(1001, at=500)
    simulation.run(until=5_000)
    lines = (folder / "2002.ndjson").read_text().splitlines()
    return [*found, [json.loads(line) for line in lines]]


def test_every_slice_of_a_good_log_is_allowed_and_supposes_what_happened(tmp_path: Path) -> None:
    """What must have happened unseen is in the log that the slice was taken from."""
    others = [kind for kind in ALL if kind != "send"]
    slices = [{"send", *kinds} for n in range(5) for kinds in combinations(others, n)]
    supposed = 0
    for records in generated(tmp_path):
        for some in slices:
            kinds = tuple(kind for kind in ALL if kind in some)
            places = [n for n, r in enumerate(records) if r["rec"] != "event" or r["ev"] in kinds]
            if len(places) == 2:
                continue  # no event
            verdict = judged(records, kinds, tmp_path)
            assert verdict.verdict == "allowed", (kinds, verdict)
            for what, after, before in verdict.only_if:
                between = records[places[after - 1] + 1 : places[before - 1]]
                assert any(_happens(record, what) for record in between), (kinds, what)
                supposed += 1
    assert supposed


def _happens(record: dict[str, Any], what: str) -> bool:
    """Whether it is the restart or the expiry that a supposition names."""
    if what == "restart":
        return record.get("ev") == "restart"
    name = what.split("(")[0]
    return record.get("op") == "expire" and record["timer"]["name"] == name


@pytest.mark.parametrize("kinds", [(), ("receive", "timer"), ("command", "indication")])
def test_without_what_is_sent_nothing_can_be_told(
    kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    verdict = judged(logs[0], kinds, tmp_path)
    assert verdict.verdict == "cannot_tell" and "sends" in verdict.finding.observed


def _proposal(m: dict[str, Any]) -> None:
    m["proposal"] += 1


def _seq(m: dict[str, Any]) -> None:
    m["seq"] += 7


def _session(m: dict[str, Any]) -> None:
    m["session"] = [m["session"][0], 9]


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (_proposal, "proposal: 2 is expected, not 3"),
        (_seq, "seq: new content takes the next seq"),
        (_session, "session: [1001, 1] is expected, not [1001, 9]"),
    ],
)
def test_of_a_message_in_another_form_the_field_is_named(
    wrong: Callable[[dict[str, Any]], None], why: str, logs: list[Records], tmp_path: Path
) -> None:
    """The command that the Acceptance follows is not in the log; the answer is still its form."""
    records = json.loads(json.dumps(logs[2]))
    first = next(r for r in records if r.get("message", {}).get("accepted") and r["ev"] == "send")
    wrong(first["message"])
    verdict = judged(records, ("receive", "send"), tmp_path)
    assert verdict.verdict == "diverges" and why in verdict.finding.observed, (
        verdict.finding.observed
    )
    assert verdict.finding.rule == "NEG-2"
    assert "proposal=2, accepted" in verdict.finding.expected[0], verdict.finding.expected


def test_what_is_still_missing_is_told_before_what_could_be_unseen(
    logs: list[Records], tmp_path: Path
) -> None:
    records = json.loads(json.dumps(logs[2]))
    ack = next(
        n
        for n, r in enumerate(records)
        if r.get("ev") == "send" and r["message"].get("of", {}).get("type") == "Prescription"
    )
    del records[ack]
    verdict = judged(records, ("receive", "send"), tmp_path)
    assert verdict.finding.rule == "NEG-1" and verdict.finding.expected[0].startswith("send Ack")


def _no_ack(records: Records) -> None:
    """NEG-1: a Prescription is not acked."""
    del records[place(records, "send", "Ack")]


def _wrong_mark(records: Records) -> None:
    """ACT-5: the CAM names no session while it acts."""
    acts = place(records, "send", "Acceptance", -1)
    cam = next(r for r in records[acts:] if r.get("ev") == "send" and r["message"]["type"] == "CAM")
    cam["message"]["marks"] = []


def _too_often(records: Records) -> None:
    """REL-1: a copy that no timer called for."""
    at = place(records, "send", "Acceptance", -1)
    copy = json.loads(json.dumps(records[at]))
    copy["tx"] = "3003:999999"
    records.insert(at + 1, copy)


def _other_content(records: Records) -> None:
    """end(0)-6: an answer has seq 0."""
    records[place(records, "send", "Ack")]["message"]["seq"] = 7


def _phase(records: Records) -> None:
    records[place(records, "receive", "CAM")]["phase"] = "ACTUATING"


@pytest.mark.parametrize(
    ("wrong", "kinds"),
    [
        (_no_ack, ("receive", "send")),
        (_wrong_mark, ("send",)),
        (_wrong_mark, ("receive", "send")),
        (_too_often, ("send",)),
        (_too_often, ("receive", "send")),
        (_other_content, ("send",)),
        (_phase, ("receive", "send")),
        (_phase, ("command", "indication", "receive", "restart", "send", "timer")),
    ],
    ids=lambda x: x.__name__[1:] if callable(x) else "+".join(x),
)
def test_what_nothing_unseen_explains_diverges(
    wrong: Callable[[Records], None], kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    records: Records = json.loads(json.dumps(logs[2]))
    wrong(records)
    assert judged(records, kinds, tmp_path).verdict == "diverges"


def test_what_something_unseen_explains_is_allowed(logs: list[Records], tmp_path: Path) -> None:
    """A copy that was not acked is a divergence only where the log shows that it arrived."""
    records: Records = json.loads(json.dumps(logs[2]))
    acks = [r["message"]["of"] for r in records if r.get("ev") == "send" and "of" in r["message"]]
    again = next(n for n, of in enumerate(acks) if of in acks[:n])
    del records[place(records, "send", "Ack", again)]
    assert judged(records, ("receive", "send"), tmp_path).verdict == "diverges"
    assert judged(records, ("command", "send"), tmp_path).verdict == "allowed"


def test_rel_1_a_retransmission_too_early_is_seen_without_timers(
    logs: list[Records], tmp_path: Path
) -> None:
    """REL-1: the header's t_resend tells when a copy may go."""
    records: Records = json.loads(json.dumps(logs[0]))
    first, second = (place(records, "send", "Advertisement", n) for n in (0, 1))
    early = records.pop(second)
    early["t_ms"] = records[first]["t_ms"] + 40
    later = (n for n, r in enumerate(records) if r.get("t_ms", 0) > early["t_ms"])
    records.insert(next(later), early)
    verdict = judged(records, ("receive", "send"), tmp_path)
    assert verdict.verdict == "diverges" and "Advertisement" in verdict.finding.observed


def test_rel_1_a_retransmission_left_out_is_seen_without_timers(
    logs: list[Records], tmp_path: Path
) -> None:
    records: Records = json.loads(json.dumps(logs[0]))
    del records[place(records, "send", "Advertisement", 3)]
    assert judged(records, ("command", "receive", "send"), tmp_path).verdict == "diverges"


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Records, Records]:
    """The prescriber and the receiver of the example in docs/trace-format.md."""
    folder = tmp_path_factory.mktemp("pair")
    simulation = Simulation(seed=3, channel=Channel(loss=0.2), logs=folder)
    simulation.add(1001, Straight())
    simulation.add(2002, Straight())
    simulation.request(1001, at=500)
    simulation.run(until=10_000)
    first, second = (
        [json.loads(line) for line in path.read_text().splitlines()]
        for path in sorted(folder.iterdir())
    )
    return first, second


def up_to(records: Records, ev: str, type_: str, number: int = 0) -> Records:
    """The log up to the nth event of a kind with a message of a type."""
    return records[: place(records, ev, type_, number) + 1]


def again(record: dict[str, Any], ms: Iterable[int], **fields: Any) -> Records:
    """The event so many ms later each, with these fields of its message and no phase."""
    plain = {name: record[name] for name in record if name not in ("phase", "role")}
    plain["message"] = record["message"] | fields
    return [plain | {"t_ms": record["t_ms"] + n} for n in ms]


def copies(records: Records, number: int) -> Records:
    """A log with so many copies, each t_resend after the other, of what it sends last."""
    return [*records, *again(records[-1], range(100, 100 * (number + 1), 100))]


def _intentions(_: Records, receiver: Records, late: bool) -> Records:
    """t_giveup is 2.1 s (ADV-6)."""
    return copies(up_to(receiver, "send", "Intention"), 49 if late else 20)


def _advertisements(prescriber: Records, _: Records, late: bool) -> Records:
    return copies(up_to(prescriber, "send", "Advertisement"), 30 if late else 20)


def _accepts(_: Records, receiver: Records, late: bool) -> Records:
    """3 s after its Prescription, and t_decide is 0.5 s."""
    accepts = receiver[place(receiver, "send", "Acceptance")]
    asked = up_to(receiver, "send", "Ack")
    assert asked[-1]["message"]["of"]["type"] == "Prescription"
    return [*asked, *again(accepts, [2950 if late else 400])]


def _fin(prescriber: Records, _: Records, late: bool) -> Records:
    """At 60 s; the lease ends after 20 s, and until then CAMs arrive."""
    acts = up_to(prescriber, "send", "Ack", -1)
    cam = prescriber[place(prescriber, "receive", "CAM", -1)] | {"t_ms": acts[-1]["t_ms"]}
    marks = [acts[-1]["message"]["session"]]
    for ms in range(1000, 20_000, 1000):
        acts += again(cam, [ms], generation_ms=cam["t_ms"] + ms, marks=marks)
    fin = prescriber[place(prescriber, "send", "Fin")]
    return [*acts, fin | {"t_ms": 60_000 if late else acts[-1]["t_ms"] + 500}]


def _acting(receiver: Records) -> Records:
    """Up to the Ack of the Acceptance, and a Cancel of then."""
    acting = up_to(receiver, "receive", "Ack", -1)
    sent = {"v": 1, "src": 2002, "dst": 1001, "session": [1001, 1], "seq": 3, "type": "Cancel"}
    sent |= {"reason": "abort"}
    cancel = {"rec": "event", "seq": 0, "ev": "send", "tx": "2002:9999", "message": sent}
    return [*acting, cancel | {"t_ms": acting[-1]["t_ms"]}]


def _abort(_: Records, receiver: Records, late: bool) -> Records:
    """10 s into silence; t_cam_loss is 1.5 s."""
    *acting, cancel = _acting(receiver)
    return [*acting, *again(cancel, [10_000 if late else 1000])]


def _cancels(_: Records, receiver: Records, late: bool) -> Records:
    return copies(_acting(receiver), 20 + 30 * late)


def _a_minute(_: Records, receiver: Records, late: bool) -> Records:
    """The example of the documentation; its Acceptance is 59 s late, and all after it."""
    at = place(receiver, "send", "Acceptance")
    later = [r | {"t_ms": r["t_ms"] + 59_000 * late} for r in receiver[at:-1]]
    return [*receiver[:at], *later]


@pytest.mark.parametrize("late", [True, False], ids=["late", "in time"])
@pytest.mark.parametrize(
    ("build", "rule"),
    [
        (_intentions, "REL-1"),
        (_advertisements, "PRE-1"),
        (_accepts, "PRE-5"),
        (_fin, "ACT-4"),
        (_abort, "ACT-2"),
        (_cancels, "REL-1"),
        (_a_minute, "PRE-5"),
    ],
    ids=lambda x: x.__name__[1:] if callable(x) else x,
)
def test_nothing_unseen_jumps_over_a_timer(
    build: Callable[[Records, Records, bool], Records],
    rule: str,
    late: bool,
    pair: tuple[Records, Records],
    tmp_path: Path,
) -> None:
    """The timers are not logged; the header tells how long they last."""
    verdict = judged([*build(*pair, late), end(0)], ("receive", "send"), tmp_path)
    assert verdict.verdict == ("diverges" if late else "allowed"), verdict
    assert verdict.finding.rule == (rule if late else "")


@pytest.fixture(scope="module")
def chooses(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """A prescriber that records three stations and prescribes to 3003."""
    folder = tmp_path_factory.mktemp("chooses")
    simulation = Simulation(seed=5, logs=folder)
    for station in (1001, 2002, 3003, 4004):
        simulation.add(station, Straight(target=3003))
    simulation.request(1001, at=500)
    simulation.run(until=4_000)
    return [json.loads(line) for line in (folder / "1001.ndjson").read_text().splitlines()]


@pytest.mark.parametrize("kinds", PARTS, ids="+".join)
@pytest.mark.parametrize("lacks", [2002, 4004])
def test_pre_2_the_cancel_that_lacks_is_named(
    lacks: int, kinds: tuple[str, ...], chooses: Records, tmp_path: Path
) -> None:
    """PRE-2: whoever is recorded and not prescribed to gets a Cancel."""

    def about(record: dict[str, Any]) -> bool:
        m = record.get("message", record.get("timer", {}).get("message", {}))
        return m.get("type") == "Cancel" and m.get("dst", m.get("to")) == lacks

    verdict = judged([r for r in chooses if not about(r)], kinds, tmp_path)
    assert (verdict.verdict, verdict.finding.rule) == ("diverges", "PRE-2")
    assert verdict.finding.expected[0] == f"send Cancel to {lacks} session=1001/1 (not_selected)"
    assert not any("Prescription to" in wanted for wanted in verdict.finding.expected)


@pytest.mark.parametrize("kinds", [("send", "timer"), ("receive", "send", "timer")], ids="+".join)
def test_a_log_that_only_an_unseen_restart_explains_says_so(
    kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    records = logs[1]
    kept = [r for r in records if r["rec"] == "header" or r.get("ev") in ("restart", *kinds)]
    before = next(n for n, r in enumerate(kept) if r.get("ev") == "restart")
    (found,) = judged(records, kinds, tmp_path).only_if
    assert found.what == "restart" and found.after <= before < found.before
    assert kept[found.before]["t_ms"] >= kept[before]["t_ms"] >= kept[found.after - 1]["t_ms"]
    assert judged(records, (*kinds, "restart"), tmp_path).only_if == ()


def test_a_log_that_only_an_unseen_expiry_explains_says_so(
    pair: tuple[Records, Records], tmp_path: Path
) -> None:
    """ACT-2: it says that it heard no CAM for long enough."""
    *acting, cancel = _acting(pair[1])
    last = max(r["t_ms"] for r in acting[1:] if r.get("message", {}).get("type") == "CAM")
    lost = again(cancel, [last + 1500 - cancel["t_ms"]], reason="cam_loss")
    verdict = judged([*acting, *lost, end(0)], ("receive", "send"), tmp_path)
    number = sum(r["ev"] in ("receive", "send") for r in acting[1:])
    lines = {"after_line": number + 1, "before_line": number + 2}
    assert verdict.as_dict()["only_if"] == [{"what": "cam", **lines}]
    said = f"allowed only if its cam expired unseen between lines {number + 1} and {number + 2}"
    assert said in text(verdict)


def test_what_is_unseen_may_have_happened_before_a_cam_that_does_not_show_it(
    pair: tuple[Records, Records], tmp_path: Path
) -> None:
    """The restart shows in the CAM sent, not in the one heard before it."""
    acting = up_to(pair[1], "receive", "Ack", -1)
    t_ms = acting[-1]["t_ms"]
    heard, sent = (
        acting[place(acting, ev, "CAM", -1)] | {"t_ms": t_ms} for ev in ("receive", "send")
    )
    records = [*acting, *again(heard, [10], src=9), *again(sent, [20], marks=[]), end(0)]
    number = 1 + sum(r["ev"] in ("receive", "send") for r in acting[1:])
    verdict = judged(records, ("receive", "send"), tmp_path)
    assert verdict.only_if == (("restart", number, number + 2),), verdict


@pytest.mark.parametrize("kinds", PARTS, ids="+".join)
def test_what_is_left_of_a_bad_log_has_a_verdict(kinds: tuple[str, ...], tmp_path: Path) -> None:
    """Also where an unseen Ack, of which nothing is known, stands before the divergence."""
    verdicts = set()
    for path in sorted((Path(__file__).parents[1] / "corpus" / "bad").glob("*.ndjson")):
        try:
            records = [json.loads(line) for line in path.read_text().splitlines()]
            readable = all(r["rec"] != "event" or "ev" in r for r in records)
        except (ValueError, KeyError, TypeError):
            continue  # no log of records
        if readable:
            verdicts.add(judged(records, kinds, tmp_path).verdict)
    assert {"allowed", "diverges"} <= verdicts


HOLD = PlainTimer(name="hold")


def one_station(*supposed: str, last: int = 50) -> _Supposing:
    """One that the log allows: in a session, with a timer that ends by ``last``."""
    engine = _Supposing(RECORD.validate_python(HEADER | {"complete": ["send"]}))
    engine.timers[HOLD] = Deadline(10, last)
    engine.supposed = tuple(Supposition(what, 2, 4) for what in supposed)
    return engine


@pytest.mark.parametrize(
    ("a", "b", "covers"),
    [
        (((), 50), ((), 50), True),
        (((), 60), ((), 50), True),
        (((), 50), ((), 60), False),
        (((), 50), (("restart",), 50), True),
        ((("restart",), 50), ((), 50), False),
    ],
    ids=["the same", "longer", "shorter", "supposes less", "supposes more"],
)
def test_a_station_that_may_do_more_and_supposes_no_more_stands_for_another(
    a: Any, b: Any, covers: bool
) -> None:
    one, other = (one_station(*supposed, last=last) for supposed, last in (a, b))
    assert _covers(one, other) is covers


def test_of_two_stations_that_differ_in_times_one_remains_that_may_be_either() -> None:
    one, other = one_station("hold", "restart"), one_station("restart", last=90)
    one.timers[HOLD] = Deadline(30, 60)
    engines: dict[Any, _Supposing] = {}
    _merge(engines, one)
    _merge(engines, other)
    (left,) = engines.values()
    assert left.timers == {HOLD: Deadline(10, 90)}
    assert [s.what for s in left.supposed] == ["restart"]
