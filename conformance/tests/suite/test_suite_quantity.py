"""The cases ``quantity …``, and what only many or large values show: each fault is found."""

from __future__ import annotations

import pytest
from suite_stage import Suite, graph, of
from suite_stage import conform as conform
from wrong_station import station

from automcm_conformance.suite.graph_cases import LIMITS as CONSTANTS
from automcm_spec.graph.growing_graph import GrowingGraph
from automcm_spec.graph.oracle_generation import TIGHT
from automcm_spec.vocabulary.station import Expire

RESET = "def answer(c):\n    p = c.get('parameters', {{}})\n    {}\n    return right(c)"
GIVEN = "def answer(c):\n    m = c.get('command', {{}})\n    {}\n    return right(c)"
HEARD = "def answer(c):\n    m = c.get('message', {{}})\n    {}\n    return right(c)"
SENT = (
    "def answer(c):\n    out = right(c)\n"
    "    for m in out.get('messages', []):\n        {}\n    return out"
)
TOLD = (
    "def answer(c):\n    out = right(c)\n"
    "    for i in out.get('indications', []):\n        {}\n    return out"
)
LASTS = """
from automcm.core import station as station_
lasts = station_.Station._duration
def other(self, t, now):
    ms = lasts(self, t, now)
    return {ms} if t.name == {name!r} else ms
station_.Station._duration = other
"""
NFC = "__import__('unicodedata').normalize('NFC', m['scenario'])"
FEW_CANCELS = """
def answer(c):
    out = right(c)
    if 'messages' in out:
        cancels = [m for m in out['messages'] if m['type'] == 'Cancel']
        out['messages'] = [m for m in out['messages'] if m not in cancels[5:]]
    return out
"""
COUNTED = """
heard = 0
def answer(c):
    global heard
    if c['cmd'] == 'reset':
        heard = 0
    heard += c['cmd'] == 'receive'
    if heard > 1000 and received(c, 'CAM'):
        c = {'cmd': 'advance', 'now': c['now']}
    return right(c)
"""
REMEMBERS_20 = """
def answer(c):
    out = right(c)
    if station._station and len(state().joined) > 20:
        oldest, *others = state().joined
        joined = {p: state().joined[p] for p in others}
        station._station.state = state()._replace(joined=joined)
        for timer in [t for t in station._station.timers if t.station == oldest]:
            del station._station.timers[timer]
        out["deadline"] = station._station.next_deadline()
    return out
"""
OWN_NUMBERS = """
def answer(c):
    out = right(c)
    if station._station and state().number == 255:
        station._station.state = state()._replace(number=0)
    return out
"""
NORMALISED = """
import unicodedata
def plain(value):
    if type(value) is dict:
        return {plain(k): plain(v) for k, v in value.items()}
    if type(value) is list:
        return [plain(v) for v in value]
    return unicodedata.normalize('NFC', value) if type(value) is str else value
"""
ROUNDS = RESET.format("if p and p['outbox_limit'] > 3: p['max_rounds'] = 3")
PRESCRIBER_NUMBERS, RECEIVER_NUMBERS = "AMCM/PRE/ADV/BV-04", "AMCM/RCV/ADV/BV-03"
MANY, ORDERS = "AMCM/PRE/MEM/BV-01", "AMCM/PRE/PRE/BV-09"
TEXTS = "AMCM/PRE/ADV/BV-05"
WRONG: dict[str, tuple[str, str, str]] = {
    "8 participants": (
        MANY,
        "",
        RESET.format("if p: p['max_participants'] = min(8, p['max_participants'])"),
    ),
    "own session number modulo 255": (PRESCRIBER_NUMBERS, "", OWN_NUMBERS),
    "session number of others modulo 255": (
        RECEIVER_NUMBERS,
        """
from automcm.core import rules
def low(me, st, i):
    p, n = i.message.session
    return n % 255 <= st.joined.get(p, 0) % 255
name = "receive Advertisement"
rows = rules.RULES[name]
rules.RULES[name] = tuple(r._replace(when=low) if r.rule == "ADV-8" else r for r in rows)
""",
        "",
    ),
    "20 prescribers remembered": (RECEIVER_NUMBERS, "", REMEMBERS_20),
    "selected of 100 points": (
        "AMCM/RCV/NEG/BV-07",
        "",
        GIVEN.format("if 'selected' in m: m['selected']['points'] = m['selected']['points'][:100]"),
    ),
    "prescribed of 100 points": (
        "AMCM/PRE/PRE/BV-07",
        "",
        GIVEN.format("if 'prescribed' in m: m['prescribed']['points'][100:] = []"),
    ),
    "planned of 100 points": (
        "AMCM/PRE/ADV/BV-02",
        "",
        GIVEN.format("if 'planned' in m: m['planned']['points'][100:] = []"),
    ),
    "CAMs of 1,000 receptions": ("AMCM/RCV/ACT/BV-04", "", COUNTED),
    "CAMs of 1,000 receptions, prescriber": ("AMCM/PRE/ACT/BV-04", "", COUNTED),
    "5 Cancels": (MANY, "", FEW_CANCELS),
    "3 rounds": ("AMCM/PRE/NEG/BV-09", "", ROUNDS),
    "3 rounds, receiver": ("AMCM/RCV/NEG/BV-08", "", ROUNDS),
    "lease of 31 bits": (
        "AMCM/RCV/ACT/TI-05",
        LASTS.format(name="lease", ms="min(ms, 2**31)"),
        "",
    ),
    "lease of 31 bits, prescriber": (
        "AMCM/PRE/ACT/TI-06",
        LASTS.format(name="lease", ms="min(ms, 2**31)"),
        "",
    ),
    "lease in single precision": (
        "AMCM/RCV/ACT/TI-05",
        "import struct"
        + LASTS.format(name="lease", ms="int(struct.unpack('f', struct.pack('f', ms))[0])"),
        "",
    ),
    "lease_left_ms of 31 bits": (
        "AMCM/PRE/ACT/TI-06",
        "",
        TOLD.format("if 'lease_left_ms' in i: i['lease_left_ms'] &= 2**31 - 1"),
    ),
    "lease_left_ms without bit 24": (
        "AMCM/PRE/ACT/TI-06",
        "",
        TOLD.format("if 'lease_left_ms' in i: i['lease_left_ms'] &= ~2**24"),
    ),
    "lease_left_ms in single precision": (
        "AMCM/PRE/ACT/TI-06",
        "import struct",
        TOLD.format(
            "if 'lease_left_ms' in i: "
            "i['lease_left_ms'] = int(struct.unpack('f', struct.pack('f', i['lease_left_ms']))[0])"
        ),
    ),
    "scenario normalised": (TEXTS, "", SENT.format(f"if 'scenario' in m: m['scenario'] = {NFC}")),
    "details normalised": (
        TEXTS,
        NORMALISED,
        SENT.format("if 'details' in m: m['details'] = plain(m['details'])"),
    ),
    "__proto__ lost": (
        TEXTS,
        "",
        GIVEN.format("m.get('details', {}).pop('__proto__', None)"),
    ),
    "the first of three is the target": (
        ORDERS,
        "",
        """
joined = []
def answer(c):
    if c['cmd'] == 'reset': joined.clear()
    out = right(c)
    if received(c, 'Intention') and c['message']['src'] not in joined:
        joined.append(c['message']['src'])
    for m in out.get('messages', []):
        if m['type'] == 'Cancel' and len(joined) == 3 and m['dst'] == joined[2]:
            m['dst'] = joined[1]
    return out
""",
    ),
    "deadlines of 52 bits": (
        "AMCM/RCV/REL/TI-05",
        "",
        "def answer(c):\n    out = right(c)\n"
        "    if out.get('deadline'): out['deadline'] &= 2**52 - 1\n"
        "    return out",
    ),
    "times of 31 bits": (
        "AMCM/PRE/REL/TI-05",
        "",
        "def answer(c):\n    out = right(c)\n"
        "    if out.get('deadline') and out['deadline'] < 2**32: out['deadline'] &= 2**31 - 1\n"
        "    return out",
    ),
}
"""The case that must fail, the station's first lines, and its ``answer`` (wrong_station.py)."""
QUICK = ("8 participants", "3 rounds", "__proto__ lost")
"""The faults that are tried in the quick set."""


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in WRONG if name not in QUICK]


@pytest.mark.sweep(1)
@pytest.mark.parametrize("fault", [*QUICK, *SLOW])
def test_each_fault_of_quantity_is_found(conform: Suite, fault: str) -> None:
    case, first, code = WRONG[fault]
    found = conform(station(code, first), case)
    assert of(found, case).verdict == "FAIL", of(found, case).reason


def test_a_growing_graph_answers_as_the_stored_one() -> None:
    stored = graph(TIGHT.path)
    grown = GrowingGraph(stored.spec_hash)
    grown.limited({name: stored.constants[constant] for name, constant in CONSTANTS.items()})
    refused = 0
    for n, state in enumerate(stored.states[::40]):
        there = stored.state_index[state]
        assert grown.marks[grown.state_index[state]] == stored.marks[there]
        for value in stored.inputs:
            here = grown.answer(grown.state_index[state], grown.input_index[value])
            answer = stored.answer(there, stored.input_index[value])
            if answer is None:
                refused += 1
                assert here is None or not isinstance(value, Expire) or value.timer[0] == "forget"
                continue
            assert here is not None, (n, value)
            assert (here.effect, here.changes) == (answer.effect, answer.changes)
            assert grown.states[here.next] == stored.states[answer.next]
    assert refused


def test_a_station_may_refuse_a_scenario_that_it_does_not_know(conform: Suite) -> None:
    code = """
def answer(c):
    if c.get('command', {}).get('scenario', 'lane_change') != 'lane_change':
        return right(c | {'command': {'name': 'complete', 'session': [4711, 99]}})
    return right(c)
"""
    assert of(conform(station(code), TEXTS), TEXTS).verdict == "PASS"


@pytest.mark.slow
def test_a_word_selects_the_cases_of_its_name(conform: Suite) -> None:
    found = conform(station(), "quantity")
    assert len(found.cases) == 13
    assert {case.verdict for case in found.cases} == {"PASS"}
