"""What a log that leaves events out allows: timers, restarts and Cancels that nobody saw."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from edits import end
from log_slices import PARTS, Records, judged, place
from merged_runs import records, simulated

from automcm_traces.explain.explain import text


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Records, Records]:
    """The prescriber and the receiver of the example in docs/trace-format.md."""
    folder = tmp_path_factory.mktemp("pair")
    first, second = map(records, simulated(folder, 1001, 2002, loss=0.2, until=10_000))
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
        (_intentions, "ADV-6"),
        (_advertisements, "PRE-1"),
        (_accepts, "NEG-3"),
        (_fin, "ACT-4"),
        (_abort, "ACT-2"),
        (_cancels, "REL-1"),
        (_a_minute, "NEG-3"),
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
    logs = simulated(folder, 1001, 2002, 3003, 4004, seed=5, target=3003, until=4_000)
    return records(logs[0])


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
