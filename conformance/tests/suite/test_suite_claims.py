"""The suite against stations that answer otherwise, or do not claim everything."""

from __future__ import annotations

import pytest
from suite_stage import ACCEPTS, BUSY, FOREIGN, LATER, Suite, of
from suite_stage import conform as conform
from wrong_station import station

# -- other answers to the same lines

OTHERWISE = {
    "the number of a session is drawn": """
import random
def answer(command):
    out = right(command)
    if command["cmd"] == "reset":
        station._station.state = state()._replace(number=random.randrange(1, 1 << 40))
    return out
""",
    "the number of a session grows from reset to reset": """
last = 0
def answer(command):
    global last
    last = max(last, station._station.state.number) if station._station else 0
    out = right(command)
    if command["cmd"] == "reset":
        station._station.state = state()._replace(number=last)
    return out
""",
}


@pytest.mark.sweep(1)
@pytest.mark.parametrize("how", OTHERWISE)
def test_right_but_not_the_same_again(conform: Suite, how: str) -> None:
    found = conform(station(OTHERWISE[how]), "AMCM/STA/ADV/BV-01", ACCEPTS, states=60)
    case = of(found, "AMCM/STA/ADV/BV-01")
    assert case.verdict == "ERROR" and case.reason.startswith("nondeterministic")
    assert of(found, ACCEPTS).verdict == "PASS"


@pytest.mark.slow
def test_wrong_but_not_again(conform: Suite) -> None:
    once = f"""
seen = []
def bad(c, out):
    "Wrong once, also if the process is started again."
    seen.append(1)
    if len(seen) != 20 or os.path.exists({str(conform.folder / "once")!r}):
        return out
    open({str(conform.folder / "once")!r}, "w").close()
    return out | {{"deadline": 10**9}}
"""
    found = conform(station(once + FOREIGN), BUSY, ACCEPTS, states=60)
    case = of(found, BUSY)
    assert case.verdict == "ERROR" and case.reason.startswith("nondeterministic")
    assert "1000000000" in case.reason and case.reached == case.total
    assert of(found, ACCEPTS).verdict == "PASS"


# -- what an implementation does not claim

CLAIMS = {
    "prescriber": "c['cmd'] == 'command' and c['command']['name'] in ("
    "'request', 'close', 'prescribe', 'proceed', 'complete')",
    "receiver": "'planned' in c or c['cmd'] == 'command' and c['command']['name'] in ("
    "'accept', 'refuse')",
    "restart": "c['cmd'] == 'restart'",
    "durations": "c['cmd'] == 'durations'",
    "cam": "False",
    "clock_drift": "'clock_drift' in c.get('parameters', {})",
}
"""Lines that only occur with the feature."""
WITHOUT = """
def answer(c):
    if {claim}:
        return {{"error": "not without {feature}"}}
    out = right(c)
    if c["cmd"] == "hello":
        out = out | {{"features": [f for f in out["features"] if f != {feature!r}]}}
    if {feature!r} == "cam":
        out = {{name: value for name, value in out.items() if name != "cams"}}
    return out
"""
SOME = (
    *(BUSY, ACCEPTS, LATER, "NEG-5", "END-8", "AMCM/PRE/ADV", "AMCM/RCV/END/BV-01", "MEM-1"),
    *("AMCM/STA/ACT/TI-02", "AMCM/STA/ACT/BV-01", "AMCM/RCV/NEG/BI-05", "AMCM/PRE/ACT/TI-05"),
)


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "feature",
    [pytest.param(f, marks=[pytest.mark.deep] * (f in ("durations", "cam"))) for f in CLAIMS],
)
def test_what_is_not_claimed_is_skipped(conform: Suite, feature: str) -> None:
    code = WITHOUT.format(feature=feature, claim=CLAIMS[feature])
    found = conform(station(code), *SOME, states=100)
    counts = found.counts
    assert counts["FAIL"] == counts["ERROR"] == counts["INCONC"] == 0, [
        (case.id, case.reason) for case in found.cases if case.failures or case.verdict == "INCONC"
    ]
    assert found.exit_code == 0 and counts["PASS"] > 5
    skipped = [case for case in found.cases if case.verdict == "SKIP" and case.total]
    wanted = {
        "prescriber": ["AMCM/PRE/ADV/BV-01", LATER],
        "receiver": [ACCEPTS, BUSY],
        "restart": ["AMCM/STA/END/BV-03"],
        "durations": [],
        "cam": ["AMCM/STA/ACT/TI-02", "AMCM/STA/ACT/BV-01"],
        "clock_drift": [],
    }[feature]
    for name in wanted:
        assert of(found, name) in skipped
        assert feature in of(found, name).reason or "a feature that" in of(found, name).reason
    reached, total = found.coverage["transitions"]
    if feature in ("cam", "clock_drift"):
        assert reached == total
    else:
        assert 0 < reached < total
        left_out = [case for case in found.cases if 0 < case.reached < case.total]
        assert left_out and all("left out of" in case.reason for case in left_out)
    if feature == "durations":
        assert any("forbidden by time" in case.reason for case in found.cases)


FIXED = """
def answer(c):
    if c["cmd"] == "hello":
        return right(c) | {{"fixed": {{{name!r}: {value}}}}}
    if c["cmd"] == "reset":
        if c["parameters"][{name!r}] != {value}:
            return {{"error": "{name} is fixed"}}
    return right(c)
"""


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("name", "value", "skipped"),
    [
        ("t_resend", 50, {}),
        ("t_timeout", 500, {}),
        (
            "max_rounds",
            2,
            dict.fromkeys([BUSY, ACCEPTS, "AMCM/STA/MEM/BI-02"], "max_rounds is fixed"),
        ),
        ("outbox_limit", 64, {"AMCM/STA/MEM/BI-02": "outbox_limit is fixed"}),
    ],
)
def test_a_fixed_parameter(conform: Suite, name: str, value: int, skipped: dict[str, str]) -> None:
    found = conform(
        station(FIXED.format(name=name, value=value)),
        *(BUSY, ACCEPTS, LATER, "AMCM/STA/MEM/BI-02", "AMCM/STA/REL/TI-05", "AMCM/RCV/ADV/TI-03"),
        states=60,
    )
    assert found.exit_code == 0 and found.implementation.fixed == {name: value}
    for case in found.cases:
        wanted = "SKIP" if case.id in skipped else "PASS"
        assert case.verdict == wanted, (case.id, case.verdict, case.reason)
        assert skipped.get(case.id, "") in case.reason
    assert of(found, LATER).verdict == "PASS"


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "fixed",
    [
        {"t_resend": 5000},
        {"t_timeout": 0},
        {"t_decide": 20},
        {"t_cam": 1000},
        {"backoff_min": 600},
        {"backoff_min": 1000},
        {"backoff_max": 3000},
        {"max_rounds": 1},
        {"max_rounds": 10},
        {"max_participants": 32},
        {"memory_limit": 1},
    ],
    ids=str,
)
def test_no_fixed_parameter_makes_a_right_station_fail(
    conform: Suite, fixed: dict[str, int]
) -> None:
    code = f"""
def answer(c):
    return right(c) | ({{"fixed": {fixed}}} if c["cmd"] == "hello" else {{}})
"""
    found = conform(
        station(code),
        *("AMCM/STA/ACT/TI-01", "AMCM/STA/ACT/TI-02", "AMCM/STA/ACT/BV-01", "AMCM/STA/END/TI-05"),
        *("AMCM/PRE/PRE/BV-07", "AMCM/PRE/PRE/TI-08", "AMCM/RCV/ADV/TI-03", "AMCM/STA/END/TI-04"),
    )
    for case in found.cases:
        assert case.verdict in ("PASS", "SKIP"), (case.id, case.reason)
    assert found.counts["PASS"] >= 2


def test_what_fixed_times_forbid_is_counted(conform: Suite) -> None:
    code = """
def answer(c):
    return right(c) | ({"fixed": {"t_timeout": 0}} if c["cmd"] == "hello" else {})
"""
    found = conform(station(code), "AMCM/PRE/NEG/TI-02", "AMCM/STA/ACT/TI-01")
    case = of(found, "AMCM/STA/ACT/TI-01")
    assert case.verdict == "PASS" and "are forbidden by time" in case.reason
    assert case.reached < case.total
