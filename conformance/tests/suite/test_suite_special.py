"""Cases that no graph carries: each can fail."""

from __future__ import annotations

import pytest
from suite_stage import Suite, of
from suite_stage import conform as conform
from wrong_station import station

from automcm_conformance.exchange import records
from automcm_conformance.suite import graph_cases, purposes

# -- cases that no graph carries: each can fail

LASTS = """
from automcm.core import station as station_
lasts = station_.Station._duration
def other(self, t, now):
    ms = lasts(self, t, now)
    return {ms} if t.name == {name!r} else ms
station_.Station._duration = other
"""
OTHER_CAM = """
def answer(c):
    m = c.get("message", {})
    if received(c, "CAM") and state().heard_ms not in (None, m["generation_ms"]):
        m["generation_ms"] = max(m["generation_ms"], state().heard_ms + 1)
    return right(c)
"""
LEAD = """
from automcm.core import actuating
lead = actuating.cam_lead
actuating.cam_lead = lambda *of: lead(*of) + {}
"""
CAME = """
step = station_.Station._step
station_.Station.came = 0
def noted(self, i, now):
    if type(getattr(i, "message", None)).__name__ == "Prescription":
        if self.state.phase in ("INTENDING", "WAITING"):
            self.came = now
    return step(self, i, now)
station_.Station._step = noted
"""
WRONG: dict[str, tuple[str, str, str, str]] = {
    "timer": ("AMCM/RCV/ADV/TI-03", LASTS.format(name="hold", ms="ms + 1"), "", "deadline"),
    "timer, early": (
        "AMCM/PRE/NEG/TI-02",
        LASTS.format(name="answer", ms="ms - 1"),
        "",
        "deadline",
    ),
    "timer, early, and hides it": (
        "AMCM/RCV/ADV/TI-03",
        "",
        "def answer(c):\n"
        "    if c['cmd'] == 'advance' and station._station.next_deadline() == c['now'] + 1:\n"
        "        c['now'] += 1\n"
        "    return right(c)",
        "fallback",
    ),
    "sendings": (
        "AMCM/STA/REL/TI-06",
        LASTS.format(name="giveup", ms="ms + self.parameters.t_resend"),
        "",
        "deadline",
    ),
    "two withdrawn": (
        "AMCM/PRE/END/BV-13",
        "",
        "def answer(c):\n"
        "    if received(c, 'Intention') and len(state().withdrawn) > 1:\n"
        "        station._station.state = state()._replace(withdrawn=frozenset({10203}))\n"
        "    return right(c)",
        "Cancel",
    ),
    "echoes": (
        "AMCM/STA/MSG/BI-05",
        "",
        "def answer(c):\n"
        "    out = right(c)\n"
        "    if c['cmd'] == 'receive' and c['message'].get('src') == 4711:\n"
        "        out['indications'] = [{'name': 'discarded'}]\n"
        "    return out",
        "discarded",
    ),
    "sendings, none": (
        "AMCM/STA/REL/TI-05",
        LASTS.format(name="giveup", ms="max(ms, 2 * self.parameters.t_resend)"),
        "",
        "",
    ),
    "same instant": (
        "AMCM/STA/ACT/TI-01",
        """
from automcm.core import station as station_
def receive(self, message, now):
    if isinstance(message, bytes):
        message = self._decode(message)
    cam = isinstance(message, station_.Cam)
    i = station_.ReceivedCam(message, now) if cam else self._received(message)
    return [self._step(i, now), *self.advance(now)]
station_.Station.receive = receive
""",
        "",
        "",
    ),
    "malformed": (
        "AMCM/STA/END/BI-19",
        "",
        "def answer(c):\n    c.get('message', {}).pop('unknown', None)\n    return right(c)",
        "discarded",
    ),
    "malformed, noticed too late": (
        "AMCM/STA/END/BI-24",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('v') in (0, 2): m['v'] = 1\n    return right(c)",
        "discarded",
    ),
    "malformed, a bad second point": (
        "AMCM/STA/END/BI-19",
        "",
        "def answer(c):\n    p = c.get('message', {}).get('planned')\n"
        "    if isinstance(p, dict) and isinstance(p.get('points'), list): p['points'][1:] = []\n"
        "    return right(c)",
        "planned {'t0': 0, 'points': [[0, 0, 0], [0, 0]",
    ),
    "malformed, a busy refusal with a seq": (
        "AMCM/STA/END/BI-21",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('reason') == 'busy': m['seq'] = 0\n    return right(c)",
        "accepted False, selected left out, reason 'busy': ",
    ),
    "bounds, a text in bytes": (
        "AMCM/STA/END/BV-06",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if len(str(m.get('scenario')).encode()) > 65507: m['v'] = 0\n    return right(c)",
        "scenario",
    ),
    "bounds, 32 bits": (
        "AMCM/STA/END/BV-10",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if type(m.get('seq')) is int: m['seq'] %= 2**32\n    return right(c)",
        "seq 9007199254740991: Ack.of",
    ),
    "bounds, a lease of a second at least": (
        "AMCM/STA/END/BV-08",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if 'lease_ms' in m: m['lease_ms'] = max(1000, m['lease_ms'])\n    return right(c)",
        "lease_ms 1: ",
    ),
    "bounds, an Ack of an Ack": (
        "AMCM/STA/END/BV-12",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('of', {}).get('type') == 'Ack': m['v'] = 0\n    return right(c)",
        "discarded",
    ),
    "bounds, 64 marks": (
        "AMCM/STA/END/BV-13",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('type') == 'CAM': m['marks'] = m['marks'][:64]\n    return right(c)",
        "marks",
    ),
    "reasons": (
        "AMCM/RCV/END/BV-08",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('reason') == 'not_needed': m['reason'] = 'abort'\n    return right(c)",
        'fallback.reason: expected "not_needed"',
    ),
    "reasons of a refusal": (
        "AMCM/PRE/NEG/BV-08",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('reason') == 'undecided': m['reason'] = 'unsafe'\n    return right(c)",
        'propose.reason: expected "undecided"',
    ),
    "cam older": ("AMCM/RCV/ACT/BI-03", "", OTHER_CAM, "deadline"),
    "cam older, prescriber": ("AMCM/PRE/ACT/BI-03", "", OTHER_CAM, "deadline"),
    "cam ahead, no bound": ("AMCM/RCV/ACT/BI-04", LEAD.format("2**53"), "", "deadline"),
    "cam ahead, too generous": ("AMCM/PRE/ACT/BI-04", LEAD.format("1"), "", "deadline"),
    "cam ahead, too strict": ("AMCM/RCV/ACT/BI-04", LEAD.format("-1"), "", "deadline"),
    "cam ahead, from the last one that counted": (
        "AMCM/PRE/ACT/BI-04",
        """
from automcm.core import rules
row, *others = rules.RULES["receive CAM"]
def count(me, st, i):
    return row.then(me, st._replace(first_cam_ms=None), i)
rules.RULES["receive CAM"] = (row._replace(then=count), *others)
""",
        "",
        "deadline",
    ),
    "restart at a deadline": (
        "AMCM/STA/END/TI-06",
        "",
        "def answer(c):\n    if c['cmd'] != 'restart': return right(c)\n"
        "    before, after = right(c | {'cmd': 'advance'}), right(c)\n"
        "    return after | {n: before[n] + after[n] for n in ('messages', 'indications')}",
        "no rule requires",
    ),
    "a lease from when the proposal came": (
        "AMCM/RCV/ACT/TI-04",
        LASTS.format(name="lease", ms="ms - (now - self.came if self.came else 0)") + CAME,
        "",
        "deadline",
    ),
    "a prescriber's lease that runs the full time": (
        "AMCM/PRE/ACT/TI-05",
        LASTS.format(name="lease", ms="self.state.lease_ms"),
        "",
        "deadline",
    ),
    "a prescriber's lease without the millisecond for rounding": (
        "AMCM/PRE/ACT/TI-05",
        LASTS.format(name="lease", ms="ms + (ms < self.state.lease_ms)"),
        "",
        "deadline",
    ),
    "a receiver's lease that is shorter as well": (
        "AMCM/RCV/ACT/TI-04",
        LASTS.format(
            name="lease",
            ms="station_.lease_lasts(self.parameters.clock_drift, 'prescriber', ms)",
        ),
        "",
        "deadline",
    ),
    "a session after another, what was heard in quarantine": (
        "AMCM/STA/END/BV-16",
        "",
        "early = set()\n"
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if c['cmd'] == 'reset': early.clear()\n"
        "    if received(c, 'Advertisement') and 'planned' in c:\n"
        "        if state().quarantine: early.add(str(m['session']))\n"
        "        if str(m['session']) in early: del c['planned']\n"
        "    return right(c)",
        "not sent: Intention",
    ),
    "a session after another, who has withdrawn": (
        "AMCM/PRE/END/BV-12",
        "",
        "gone = set()\n"
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if c['cmd'] == 'reset': gone.clear()\n"
        "    if received(c, 'Cancel') and state().phase == 'ADVERTISING': gone.add(m['src'])\n"
        "    if received(c, 'Intention') and m['src'] in gone - state().withdrawn and "
        "tuple(m['session']) == state().session:\n"
        "        return right({'cmd': 'advance', 'now': c['now']})\n"
        "    return right(c)",
        "not sent: Ack",
    ),
    "a session after another, the first lease": (
        "AMCM/RCV/END/BV-09",
        "",
        "lease = []\n"
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if c['cmd'] == 'reset': lease.clear()\n"
        "    if received(c, 'Prescription') and m['seq']:\n"
        "        if state().session == tuple(m['session']): lease.append(m['lease_ms'])\n"
        "        if lease: m['lease_ms'] = lease[0]\n"
        "    return right(c)",
        "deadline",
    ),
    "two receivers, one Ack for both": (
        "AMCM/PRE/PRE/BV-08",
        "",
        "def answer(c):\n    out = right(c)\n    m = c.get('message', {})\n"
        "    if received(c, 'Ack') and m['of']['type'] == 'Cancel':\n"
        "        for e in state().outbox:\n"
        "            if e.type == 'Cancel':\n"
        "                m |= {'src': e.dst, 'of': {'type': 'Cancel', 'seq': e.seq}}\n"
        "                right(c | {'message': m})\n"
        "        out['deadline'] = station._station.next_deadline()\n"
        "    return out",
        "deadline",
    ),
    "room": (
        "AMCM/STA/MEM/BI-04",
        "",
        "def answer(c):\n"
        "    if c['cmd'] == 'reset': c['parameters']['max_participants'] = 1\n"
        "    return right(c)",
        "Advertisement",
    ),
    "content, another order": (
        "AMCM/PRE/ADV/BV-02",
        "",
        "def answer(c):\n    d = c.get('command', {}).get('details', {}).get('deep')\n"
        "    if d: d['list'] = d['list'][::-1]\n    return right(c)",
        "details",
    ),
    "content, cut": (
        "AMCM/PRE/PRE/BV-07",
        "",
        "def answer(c):\n    p = c.get('command', {}).get('prescribed')\n"
        "    if p: p['points'] = p['points'][:50]\n    return right(c)",
        "prescribed",
    ),
    "content of copies": (
        "AMCM/PRE/ADV/BV-02",
        "",
        "def answer(c):\n    out = right(c)\n"
        "    if c['cmd'] == 'advance':\n"
        "        for m in out['messages']: m.get('details', {}).pop('text', None)\n    return out",
        "details",
    ),
    "cam rate": (
        "AMCM/STA/ACT/TI-02",
        "",
        "def answer(c):\n    out = right(c)\n"
        "    if c['cmd'] == 'reset': station._t_cam *= 2\n    return out",
        "a CAM every 100 ms",
    ),
    "cam rate, in fits and starts": (
        "AMCM/STA/ACT/TI-02",
        "",
        "def answer(c):\n    out = right(c)\n    for m in out.get('cams', []):\n"
        "        m['generation_ms'] += m['generation_ms'] // 100 % 2 * 60\n    return out",
        "a CAM every 100 ms",
    ),
    "cam rate, none": (
        "AMCM/STA/ACT/TI-02",
        "",
        "def answer(c):\n    return {k: v for k, v in right(c).items() if k != 'cams'}",
        "a CAM every 100 ms",
    ),
    "cam marks": (
        "AMCM/STA/ACT/BV-01",
        """
from automcm.core.state import State
State.marks = property(lambda st: () if st.session is None else (st.session,))
""",
        "",
        "marks",
    ),
    "back-off": ("AMCM/STA/END/TI-05", LASTS.format(name="backoff", ms=100), "", "500 to 2000"),
    "back-off, one for all seeds": (
        "AMCM/STA/END/TI-05",
        LASTS.format(name="backoff", ms=700),
        "",
        "for every seed",
    ),
    "back-off, whatever the seed": (
        "AMCM/STA/END/TI-05",
        LASTS.format(name="backoff", ms="__import__('random').randint(500, 2000)"),
        "",
        "seed 1: back-offs of",
    ),
    "back-off, none": (
        "AMCM/STA/END/TI-05",
        """
from automcm.core import station as station_
armed = station_.armed
station_.armed = lambda me, st: [t for t in armed(me, st) if t.name != "backoff"]
""",
        "",
        "got none",
    ),
}


@pytest.mark.sweep(4)
@pytest.mark.parametrize("how", WRONG)
def test_each_case_without_a_graph_can_fail(conform: Suite, how: str) -> None:
    name, first, code, says = WRONG[how]
    found = conform(station(code, first), name)
    (case,) = found.cases
    assert case.verdict == "FAIL" and says in case.reason, (case.verdict, case.reason)
    (failure,) = case.failures
    assert failure.rule == "END-7" or not how.startswith("back-off")
    about, steps = records.read_replay(conform.folder / "report" / failure.replay)
    assert about["case"] == name and steps
    assert found.exit_code == 1


def test_every_timer_is_tried(conform: Suite) -> None:
    """None is left out because the kit does not know how long it lasts."""
    timers = [p.id for p in purposes.load() if (p.case or "").startswith("timer ")]
    assert len(timers) > 10
    found = conform(station(), *timers)
    assert {case.id: case.verdict for case in found.cases} == dict.fromkeys(timers, "PASS")


def test_the_order_of_names_is_free(conform: Suite) -> None:
    code = """
def turned(x):
    if isinstance(x, dict): return {k: turned(x[k]) for k in reversed(x)}
    return [turned(y) for y in x] if isinstance(x, list) else x
def answer(c): return turned(right(c))
"""
    names = ("AMCM/PRE/ADV/BV-02", "AMCM/PRE/PRE/BV-07", "AMCM/STA/ACT/BV-01")
    assert conform(station(code), *names).counts["PASS"] == 3


@pytest.mark.slow
def test_wrong_marks_in_a_tour_are_blamed_on_the_marks(conform: Suite) -> None:
    marks, others = "AMCM/STA/ACT/BV-01", ("AMCM/STA/REL/TI-01", "AMCM/STA/END/BV-01")
    found = conform(station(first=WRONG["cam marks"][1]), *others, marks, states=700)
    case = of(found, marks)
    assert case.verdict == "FAIL" and len(case.failures) > 1, "not only in the case itself"
    assert all("CAM.marks" in failure.what for failure in case.failures)
    assert len(case.failures) <= graph_cases.ENOUGH + 1
    assert {of(found, name).verdict for name in others} <= {"PASS", "INCONC"}
