"""The table of parameters and timers: what is derived, what is refused, and that the page and the
models with time say the same."""

from __future__ import annotations

import re
from collections.abc import Iterator
from math import ceil
from pathlib import Path
from typing import Any

import pytest

from automcm_spec.model_checking import models
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary import parameters
from automcm_spec.vocabulary.rules import cited
from automcm_spec.vocabulary.station import Entry, Expire, Station, Timer

PAGE = Path(__file__).parents[3] / "docs" / "protocol.md"


@pytest.mark.parametrize("unknown", parameters.Parameters().known)
def test_what_a_header_does_not_tell_is_not_known(unknown: str) -> None:
    """A timer whose row in the page names it lasts unknown."""
    lasts = {name.split("(")[0]: lasts for name, _, lasts, _ in rows("timer")}
    lacking = {name for name in lasts if f"`{unknown}`" in lasts[name]}
    known = {name: ms for name, ms in parameters.Parameters().known.items() if name != unknown}
    never = {"lease", "forget", "backoff"}
    assert {
        name for name, ms in parameters.durations(known).items() if ms is None
    } == lacking | never


OWN_LEASES = [
    *((1, 20_000, 19_799), (1, 100, 98), (1, 101, 98), (7, 900, 836), (0, 20_000, 20_000)),
    *((1, 1, 1), (99, 10, 1)),  # too short to act on, but no timer lasts less than 1 ms
]


@pytest.mark.parametrize(("drift", "lease_ms", "own_ms"), OWN_LEASES)
def test_act_4_the_prescribers_lease_is_shorter_by_the_drift_and_1_ms(
    drift: int, lease_ms: int, own_ms: int
) -> None:
    assert parameters.lease_lasts(drift, "prescriber", lease_ms) == own_ms
    assert parameters.lease_lasts(drift, "receiver", lease_ms) == lease_ms


@pytest.mark.parametrize("drift", [1, 3, 10, 50])
def test_act_4_a_clock_slow_by_the_drift_still_ends_first(drift: int) -> None:
    for lease_ms in range(200, 30_000, 7):
        own_ms = parameters.lease_lasts(drift, "prescriber", lease_ms)
        assert own_ms * (100 + drift) <= (lease_ms - 1) * 100


@pytest.mark.parametrize("name", parameters.DEFAULTS)
@pytest.mark.parametrize("value", [-1, 1500.0, "1500", True, None])
def test_a_parameter_is_an_integer_and_not_negative(name: str, value: Any) -> None:
    with pytest.raises(parameters.ParameterError, match=f"^{name}: "):
        parameters.Parameters(**{name: value})


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("t_resend", {"t_resend": 0}),
        ("t_cam", {"t_cam": 0}),
        ("t_cam", {"t_cam": 1001}),
        ("t_cam_loss", {"t_cam_loss": 1000}),
        ("max_rounds", {"max_rounds": 0}),
        ("max_participants", {"max_participants": 0}),
        ("memory_limit", {"memory_limit": 0}),
        ("outbox_limit", {"outbox_limit": 32}),
        ("outbox_limit", {"max_participants": 64}),
        ("backoff_max", {"backoff_min": 2001}),
        ("clock_drift", {"clock_drift": 100}),
    ],
)
def test_a_parameter_that_cannot_work_is_refused_by_name(name: str, given: dict[str, int]) -> None:
    with pytest.raises(parameters.ParameterError, match=f"^{name}: "):
        parameters.Parameters(**given)


def test_a_refusal_says_the_bound_and_what_the_parameter_is() -> None:
    with pytest.raises(parameters.ParameterError) as caught:
        parameters.Parameters(t_cam=2000)
    assert str(caught.value) == "t_cam: must be at most 1000, not 2000 (ms: the CAM interval)"


@pytest.mark.parametrize(
    "given",
    [
        {"t_timeout": 0, "t_decide": 0},
        {"t_cam_loss": 1001, "t_cam": 1000},
        {"max_participants": 1, "outbox_limit": 2, "memory_limit": 1, "max_rounds": 1},
        {"backoff_min": 0, "backoff_max": 0},
        {"clock_drift": 0},
        {"clock_drift": 99},
    ],
)
def test_the_bounds_themselves_are_allowed(given: dict[str, int]) -> None:
    assert parameters.Parameters(**given).known.items() >= given.items()


# -- the page

SETS = (
    parameters.Parameters(),
    parameters.Parameters(t_timeout=0, t_resend=60, t_decide=40, t_cam_loss=1010),
    parameters.Parameters(t_timeout=250, t_resend=70, t_decide=900),
)
"""With the second the quarantine lasts as long as a prescriber may act (ACT-6)."""


def rows(first: str) -> Iterator[list[str]]:
    """The rows of the table of section 3 whose first column has this name."""
    section = PAGE.read_text(encoding="utf-8").split("\n## 3. ")[1].split("\n## ")[0]
    for row in section.split(f"\n| {first} |")[1].split("\n\n")[0].splitlines()[2:]:
        yield [cell.strip() for cell in row.strip("|").split("|")]


def evaluated(text: str, known: dict[str, int]) -> int:
    """A formula of the page, up to where its sentence goes on."""
    text = re.split(r"[,;:.]|and |after ", text.replace("`", "").replace("·", "*"))[0]
    found: int = eval(text.replace("/", "//"), {}, known)
    return found


def test_the_page_has_the_defaults_and_the_formulas_of_derived_times() -> None:
    page = {name.strip("`"): text for name, text, _ in rows("name")}
    back_off, cam = page.pop("back-off"), page.pop("f_cam")
    page |= {"t_cam": cam.split("`t_cam` = ")[1]}
    page |= dict(
        zip(("backoff_min", "backoff_max"), re.findall(r"\d+ ?\w*", back_off), strict=True)
    )
    assert page.pop("Δt1").startswith("`t_timeout`")
    assert page.keys() == parameters.Parameters().known.keys()
    assert {
        name: int(page[name].split()[0].strip(",;")) for name in parameters.DEFAULTS
    } == parameters.DEFAULTS
    sendings = re.search(r"N = (1) \+ floor\((.*?)\)", page["t_giveup"])
    assert sendings is not None and page["t_giveup"].startswith("N · ")
    for known in (p.known for p in SETS):
        n = int(sendings[1]) + evaluated(sendings[2], known)
        for name in parameters.DERIVED:
            assert evaluated(page[name], known | {"N": n}) == known[name], name


def expiring(name: str) -> set[str]:
    """The rules by which a timer of the page expires, in any state."""
    station = Station(3, 4, 8, 4)
    about: dict[str, list[Timer]] = {
        "forget(p)": [("forget", 2)],
        "resend(Advertisement)": [("resend", Entry("Advertisement", 0, (1, 1), 1, False))],
    }
    for timer in ("giveup", "resend"):
        types = ("Intention", "Prescription", "Acceptance", "Fin", "Cancel")
        about[f"{timer}(m)"] = [(timer, Entry(m, 2, (1, 1), 1, False)) for m in types]
    return {
        station.step(1, state, Expire("expire", timer)).rule
        for timer in about.get(name, [(name,)])
        for role in ("prescriber", "receiver")
        for state in [station.initial._replace(role=role, session=(1, 1), phase="ACTUATING")]
    }


def test_the_page_has_the_timers_in_their_order_with_durations_and_rules() -> None:
    page = list(rows("timer"))
    ranks = [parameters.rank(name.split("(")[0], "(Advertisement)" in name) for name, *_ in page]
    assert ranks == list(range(1, len(parameters.TIMERS) + 2))
    for name, _, lasts, rules in page:
        timer = name.split("(")[0]
        assert cited(rules) == expiring(name), name
        for known in (p.known for p in SETS):
            ms = parameters.durations(known)[timer]
            if ms is not None and "longer of" in lasts:
                either = lasts.split("the longer of ")[1].split(" and ")
                assert max(evaluated(text, known) for text in either) == ms
            elif ms is not None:
                assert evaluated(lasts, known) == ms, name
            elif timer == "forget":
                joined, left = lasts.removeprefix("until ").split(" after joining and ")
                for now in (0, 1, known["t_advertise"], 99_999):
                    either = (evaluated(joined, known), now + evaluated(left, known))
                    assert parameters.forgotten_at(known, 0, now) == max(either)


# -- the models with time

FORMULAS = dict(
    re.findall(
        r"^(\w+) *== *\n? *([\w +*(),-]+)$",
        (TLA / "TimedSystem.tla").read_text() + (TLA / "Environments.tla").read_text(),
        re.MULTILINE,
    )
)
"""The definitions of TimedSystem.tla and Environments.tla that fit in a line."""
TIMES = {
    "t_giveup": "GiveUpTime",
    "t_advertise": "AdvertiseTime",
    "t_hold": "HoldTime",
    "t_life": "LifeTime",
}
TIMED = {model.cfg: model.config for model in models.load() if "ResendTime" in model.config}


class Model(dict[str, Any]):
    """The constants of a model, and its definitions as far as they are asked for."""

    def __init__(self, cfg: str, **more: int) -> None:
        super().__init__({"Max": max, "Min": min}, **more)
        constants = re.findall(r"^ *(\w+) = (\d+)$", cfg, re.MULTILINE)
        self |= {name: int(value) for name, value in constants}
        self.replaced = dict(re.findall(r"(\w+) <- (\w+)", cfg))

    def __missing__(self, name: str) -> int:
        operator = self.replaced.get(name, name)
        if operator in self:
            return int(self[operator])
        found: int = eval(FORMULAS[operator], {}, self)
        return found

    def known(self) -> dict[str, int]:
        """Its constants as parameters, in ticks, and what follows from them by the table."""
        known = {"t_resend": self["ResendTime"], "t_decide": self["Deciding"]}
        known |= {"t_timeout": (self["Sendings"] - 1) * self["ResendTime"]}
        known |= {"t_cam_loss": self["CamLoss"], "max_rounds": self["MaxRounds"]}
        for name, formula in parameters.DERIVED.items():
            known[name] = self[TIMES[name]] if TIMES[name] in self.replaced else formula(known)
        return known


def cases(operator: str) -> str:
    """The text of an operator of TimedSystem.tla that is a CASE."""
    text = (TLA / "TimedSystem.tla").read_text()
    return text.split(f"\n{operator} ==\n")[1].split("\n\n")[0]


LASTS = dict(re.findall(r't\[1\] = "(\w+)"\s+->\s+([\w ()+,-]+)', cases("DurationOf(s, t)")))
SYSTEMS = [Model(text) for text in TIMED.values()] + [
    Model("", ResendTime=r, Sendings=n, Deciding=d, CamLoss=c, MaxRounds=k, Delay=r // 2, Lease=9)
    for r, n, d, c, k in ((1, 1, 1, 5, 1), (4, 1, 3, 20, 2), (7, 3, 2, 70, 3), (3, 2, 9, 4, 4))
]
"""Every timed model, and constants that tell every formula from its neighbours."""


def test_models_that_hold_replace_no_duration_but_the_window_and_the_margin() -> None:
    """The window where its length does not matter, the margin where clocks do not run alike."""
    asked = {"AnswerTime", "ActsOnTime", "QuarantineTime", "LeaseMargin", "Duration", "Order"}
    replaced = {
        operator
        for m in models.load()
        if m.expect == "holds" and m.cfg in TIMED
        for operator in Model(m.config).replaced.keys() & {*TIMES.values(), *asked, "DurationOf"}
    }
    assert replaced == {"AdvertiseTime", "LeaseMargin"}


@pytest.mark.parametrize("model", SYSTEMS)
def test_the_durations_of_timed_models_are_those_of_the_table(model: Model) -> None:
    known = model.known()
    assert {name: model[operator] for name, operator in TIMES.items()} == {
        name: known[name] for name in TIMES
    }
    assert model["Delay"] == parameters.longest_delay(known)
    lasts = parameters.durations(known)
    for timer, ticks in lasts.items():
        if ticks is not None and timer != "decide":
            less = model.replaced.get("QuarantineTime") == "TooShort" and timer == "quarantine"
            assert model[LASTS[timer]] == ticks - less, timer
    assert 't[1] \\in {"decide", "backoff"}  -> Deciding' in cases("DurationOf(s, t)")
    assert lasts["decide"] == model["Deciding"]
    for role, operator in (("prescriber", "PrescriberTime"), ("receiver", "ReceiverTime")):
        assert parameters.longest_session(known, role, model["Lease"]) == model[operator]
    forgets = re.search(r"(Max\(LifeTime.*)\[s\]\)$", cases("DurationOf(s, t)"))
    assert forgets is not None
    for model["age"] in (0, 1, known["t_advertise"], 99):
        ticks = eval(f"{forgets[1]})", {}, model)
        assert parameters.forgotten_at(known, 0, model["age"]) - model["age"] == ticks


def test_timed_models_fire_timers_in_the_order_of_the_table() -> None:
    order = cases("Order(t)")
    first, last = re.findall(
        r'"resend" +-> IF t\[2\].type = "Advertisement" THEN (\d+) ELSE (\d+)', order
    )[0]
    ranks = {name: int(n) for name, n in re.findall(r't\[1\] = "(\w+)" +-> (\d+)', order)}
    assert ranks | {"resend": int(last)} == {
        name: row.rank for name, row in parameters.TIMERS.items()
    }
    assert int(first) == parameters.ADVERTISED_RANK


def test_act_4_the_margin_of_models_with_drift_is_that_of_the_table() -> None:
    """A tick is 100 ms here, so that the millisecond for rounding is less than one."""
    margins = {}
    for name, model in zip(TIMED, SYSTEMS, strict=False):
        drift = 100 * model.get("SlowTicks", 0) // model["Lease"]
        lease_ms = 100 * model["Lease"]
        margin = ceil((lease_ms - parameters.lease_lasts(drift, "prescriber", lease_ms)) / 100)
        if margin != model["LeaseMargin"]:
            margins[name] = margin, model["LeaseMargin"]
    assert margins == dict.fromkeys(("drift_bound_less_one", "drift_no_margin"), (1, 0))


def test_t_8_cam_loss_is_longer_than_interval_and_delay_but_where_that_must_fail() -> None:
    models = zip(TIMED, SYSTEMS, strict=False)
    short = {n for n, m in models if m["CamLoss"] <= m["CamInterval"] + m["Delay"]}
    assert short == {"cam_loss_too_short"}
    p = parameters.Parameters()
    assert p.t_cam_loss > 1000 + parameters.longest_delay(p.known)


def test_the_limits_are_the_constants_of_the_station_in_its_order() -> None:
    names = re.search(r"^CONSTANTS(.*?)\n\n", (TLA / "Station.tla").read_text(), re.S | re.M)
    assert names is not None
    found = re.findall(r"\b(Max\w+|\w+Limit)\b", names[1])
    assert [re.sub(r"(?<=.)([A-Z])", r"_\1", name).lower() for name in found] == list(
        parameters.LIMITS
    )
