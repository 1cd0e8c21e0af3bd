"""A live station: the cases pass with the reference, and distinguish wrong from late messages.

The reference's service runs on a virtual clock here; one test has a process and sockets.
"""

from __future__ import annotations

import json
import random
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from broken_stations import REFERENCE, broken
from cli_stage import AUTOMCM, automcm, broadcast
from live_stage import BY_NAME, JITTER, STATION, Json, Radio, World, fair, judge, only, session
from live_stage import oracle as oracle

from automcm_cli.conform import conform
from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.adapter.protocol import DEFAULTS
from automcm_conformance.live.live_cases import CASES, LiveCase
from automcm_conformance.suite.scripts import expire
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.graph.oracle import Oracle


def test_every_case_passes_and_leaves_nothing_behind(oracle: Oracle) -> None:
    rng = random.Random(1)
    world = World(lambda m: [(rng.randrange(0, 18), m)])
    live = session(oracle, world)
    assert live.heard(2_000)
    for case in CASES:
        assert (live.judge(case).reason, case.name) == ("", case.name)
        assert world.service.state.phase == "STANDALONE"
        assert not world.service.state.outbox


@pytest.mark.parametrize("parameters", [{"t_timeout": 500}, {"t_resend": 150, "t_decide": 300}])
def test_the_parameters_are_those_of_the_station(oracle: Oracle, parameters: Json) -> None:
    live = session(oracle, World(fair, parameters=parameters))
    live.parameters = DEFAULTS | parameters
    assert [live.judge(case).verdict for case in CASES] == ["PASS"] * len(CASES)


@pytest.mark.parametrize(
    ("name", "said", "radio"),
    [
        ("intention", "Intention.seq", only("Intention", lambda m: [(3, m | {"seq": 2})])),
        ("intention", "Intention.more", only("Intention", lambda m: [(3, m | {"more": 1})])),
        ("agreement", "Ack.of", only("Ack", lambda m: [(3, m | {"of": m["of"] | {"seq": 9}})])),
        ("agreement", "Acceptance.dst", only("Acceptance", lambda m: [(3, m | {"dst": 3})])),
        (
            "busy",
            "Acceptance.reason",
            only("Acceptance", lambda m: [(3, m | {"reason": "unsafe"})]),
        ),
        ("cam loss", "Cancel.reason", only("Cancel", lambda m: [(3, m | {"reason": "abort"})])),
        (
            "intention",
            "no rule requires",
            only("Ack", lambda m: [(3, m), (30, m | {"type": "Fin"})]),
        ),
    ],
)
def test_a_wrong_message_fails_whatever_happens_in_virtual_time(
    oracle: Oracle, name: str, said: str, radio: Radio
) -> None:
    judged = judge(oracle, name, radio, lambda case: "")
    assert judged.verdict == "FAIL"
    assert said in judged.reason
    assert judged.lines[-1].text


def test_a_copy_must_be_the_same(oracle: Oracle) -> None:
    planned = {"t0": 0, "points": [[0, 0, 0]]}
    count = iter(range(100))
    change = only("Intention", lambda m: [(3, m if next(count) < 2 else m | {"planned": planned})])
    judged = judge(oracle, "intention", change)
    assert (judged.verdict, "Intention.planned" in judged.reason) == ("FAIL", True)


@pytest.mark.parametrize(("length_mm", "verdict"), [(4500, "PASS"), (0, "FAIL"), (None, "FAIL")])
def test_an_intention_may_state_an_extent(
    oracle: Oracle, length_mm: int | None, verdict: str
) -> None:
    change = only("Intention", lambda m: [(3, m | {"length_mm": length_mm, "width_mm": 1800})])
    assert judge(oracle, "intention", change).verdict == verdict


def test_what_is_no_trajectory_is_not_free(oracle: Oracle) -> None:
    for planned in ({"t0": 0, "points": []}, {"t0": 0.5, "points": [[0, 0, 0]]}, None):
        change = only("Intention", lambda m, p=planned: [(3, m | {"planned": p})])
        assert "Intention.planned" in judge(oracle, "intention", change).reason


@pytest.mark.parametrize(
    ("name", "said", "radio"),
    [
        ("intention", "was received at", only("Intention", lambda m: [(JITTER + 10, m)])),
        ("intention", "was not received", only("Intention", lambda m: [])),
        ("intention", "another copy", only("Intention", lambda m: [(3, m), (50, m)])),
        ("busy", "another copy", only("Acceptance", lambda m: [(3, m), (40, m)])),
        ("lease", "was not received", only("Cancel", lambda m: [])),
        ("agreement", "; instead ", only("Ack", lambda m: [])),
    ],
)
def test_a_timing_miss_is_judged_in_virtual_time(
    oracle: Oracle, name: str, said: str, radio: Radio
) -> None:
    for virtual, verdict, more in (
        (None, "INCONC", ""),
        (lambda case: "", "INCONC", "the case passes in virtual time"),
        (lambda case: None, "INCONC", "cannot be judged"),
        (
            lambda case: f"{case.name} is wrong",
            "FAIL",
            f"fails in virtual time too: {name} is wrong",
        ),
    ):
        judged = judge(oracle, name, radio, virtual)
        assert judged.verdict == verdict
        assert said in judged.reason
        assert more in judged.reason


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("cam loss", {"t_cam_loss": 1300}),
        ("cam loss", {"t_cam_loss": 1700}),
        ("intention", {"t_resend": 40}),
        ("intention", {"t_resend": 200}),
        ("given up", {"t_timeout": 1500}),
        ("given up", {"t_timeout": 2500}),
    ],
)
def test_a_station_with_other_durations_is_not_in_time(
    oracle: Oracle, name: str, parameters: Json
) -> None:
    judged = session(oracle, World(fair, parameters=parameters)).judge(BY_NAME[name])
    assert judged.verdict == "INCONC", judged.reason


@pytest.mark.parametrize(
    ("application", "said"),
    [
        (Straight(refuse_first=1), "application refused: unsafe"),
        (Straight(think_ms=2_000), "did not decide in time"),
    ],
)
def test_an_application_that_does_not_agree_is_nobodys_fault(
    oracle: Oracle, application: Straight, said: str
) -> None:
    world = World(fair, application)
    judged = session(oracle, world).judge(BY_NAME["agreement"])
    assert (judged.verdict, said in judged.reason) == ("INCONC", True)
    assert world.service.state.phase == "STANDALONE"


def test_parameters_that_do_not_lead_to_the_end(oracle: Oracle) -> None:
    live = session(oracle, World(fair, parameters={"t_timeout": 0}))
    live.parameters = DEFAULTS | {"t_timeout": 0}
    judged = live.judge(BY_NAME["intention"])
    assert (judged.verdict, "does not expire with these parameters" in judged.reason) == (
        "INCONC",
        True,
    )


def test_after_a_case_that_went_wrong_the_next_one_passes(oracle: Oracle) -> None:
    for case in CASES:
        world = World(only("Ack", lambda m: []))
        live = session(oracle, world)
        live.judge(case)
        world.radio = fair
        assert live.judge(BY_NAME["agreement"]).reason == "", case.name


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", range(5))
def test_a_busy_machine_blames_nobody(oracle: Oracle, seed: int) -> None:
    """The kit sleeps, and messages are late or lost, both ways: the station is right all along."""
    rng = random.Random(seed)

    def seldom(most: int) -> int:
        return rng.randrange(most) if rng.random() < 0.03 else 0

    world = World(lambda m: [(2 + seldom(48), m)] if rng.random() < 0.98 else [])
    receive = world.receive

    def send(data: bytes) -> None:
        if rng.random() < 0.98:
            world.clock.at(world.now() + 2 + seldom(48), lambda: world.hears(data, None) and None)

    def sleepy(until: int) -> tuple[int, bytes] | None:
        world.clock.run(world.now() + seldom(300))
        return receive(until)

    world.receive, world.send = sleepy, send  # type: ignore[method-assign]
    live = session(oracle, world)
    found = [live.judge(case) for _ in range(5) for case in CASES]
    assert [case.reason for case in found if case.verdict == "FAIL"] == []
    assert {case.verdict for case in found} == {"PASS", "INCONC"}


def test_bytes_of_others_are_overlooked(oracle: Oracle) -> None:
    world = World(fair)
    for data in (b"\xff", b"7", b"[]", b'{"src":8,"type":"Fin"}', b'{"src":8,"type":"CAM"}'):
        world.arrives(data)
    assert not session(oracle, world).heard(0)
    assert session(oracle, world).judge(BY_NAME["unknown session"]).verdict == "PASS"


@pytest.mark.parametrize(
    "fields",
    [
        {"dst": [], "session": {}, "seq": "x", "of": 7},
        {"type": None, "dst": {"a": []}, "seq": 1.5, "reason": []},
        {"type": "Intention", "planned": {"t0": 1, "points": [[0]]}},
        {"type": "CAM", "marks": [1]},
        {"type": "CAM", "marks": "all"},
    ],
)
def test_whatever_it_sends_the_kit_goes_on(oracle: Oracle, fields: Json) -> None:
    world = World(lambda m: [(3, m | fields)])
    live = session(oracle, world)
    assert live.judge(BY_NAME["agreement"]).verdict in ("FAIL", "INCONC")
    assert live.judge(BY_NAME["busy"]).verdict in ("FAIL", "INCONC")
    world.radio = fair
    assert live.judge(BY_NAME["agreement"]).verdict == "PASS"


def test_a_station_that_does_not_come_to_rest(oracle: Oracle) -> None:
    world = World(lambda m: [(3, m | {"marks": [[9, 1]]} if m["type"] == "CAM" else m)])
    live = session(oracle, world)
    assert live.judge(BY_NAME["busy"]).verdict == "PASS"
    world.radio = lambda m: [(3, m | {"marks": [[9, 1]]})] if m["type"] == "CAM" else []
    for reason in ("was not received", "did not become idle"):
        judged = live.judge(BY_NAME["busy"])
        assert (judged.verdict, reason in judged.reason) == ("INCONC", True)
    world.radio = fair
    assert live.judge(BY_NAME["busy"]).verdict == "PASS"


@contextmanager
def adapter(*command: str) -> Iterator[Adapter]:
    found = Adapter(command, 10)
    try:
        yield found
    finally:
        found.stop()


def test_a_case_can_be_repeated_in_virtual_time(oracle: Oracle) -> None:
    with adapter(*REFERENCE) as reference:
        judged = partial(session(oracle, World(fair)).in_virtual_time, reference)
        assert [judged(case) for case in CASES] == [""] * len(CASES)
        assert judged(LiveCase("too long", (), "", [expire("lease")])) is None


def test_no_peer_has_the_id_of_the_station(oracle: Oracle) -> None:
    live = session(oracle, World(fair))
    live.station = live._exchange().wire.values.ids[2]
    ids = live._exchange().wire.values.ids.values()
    assert len({*ids}) == len(ids)


def test_a_slow_station_fails_in_virtual_time(oracle: Oracle) -> None:
    with adapter(*broken("sends_again_after_200_ms")) as slow:
        world = World(fair, parameters={"t_resend": 200})
        live = session(oracle, world, slow)
        judged = live.judge(BY_NAME["intention"])
        assert judged.verdict == "FAIL"
        assert "fails in virtual time too: deadline: " in judged.reason
        assert live.judge(BY_NAME["unknown session"]).verdict == "PASS"


# -- the command


@contextmanager
def station(*options: str) -> Iterator[str]:
    """``automcm station`` on a port of its own; yields where it broadcasts."""
    command = [*AUTOMCM, "station", "--id", str(STATION), "--first", "--listen", "0"]
    with (
        broadcast() as where,
        subprocess.Popen(
            [*command, "--broadcast", where, *options], stdout=subprocess.DEVNULL
        ) as child,
    ):
        try:
            yield where
        finally:
            child.terminate()


@pytest.mark.slow
def test_a_station_of_the_reference_over_sockets(tmp_path: Path) -> None:
    """How late it is says how busy this machine is: so a timing miss is no failure here."""
    options = ["--set", "t_resend=600", "--set", "t_timeout=600"]
    out = tmp_path / "live.json"
    arguments = ["--jitter", "300", "--json", out, *options, "--", *REFERENCE]
    with station(*options) as where:
        done = automcm(
            "conform", "live", "7", "NEG-4", "unknown session", "--broadcast", where, *arguments
        )
    assert done.exit_code in (0, 4), done.output
    report = json.loads(out.read_text())
    assert (report["format"], report["station"]) == ("automcm.live/1", STATION)
    assert [case["case"] for case in report["cases"]] == ["busy", "unknown session"]
    assert {case["verdict"] for case in report["cases"]} <= {"PASS", "INCONC"}
    assert report["parameters"]["t_resend"] == 600
    assert "unknown session" in done.stdout


def test_a_station_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conform, "FIRST_CAM_MS", 50)
    done = automcm("conform", "live", "7", "--broadcast", "127.255.255.255:47398")
    assert done.exit_code == 3
    assert done.stderr == "live: no CAM of station 7 on 127.255.255.255:47398 within 50 ms\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["no such case"],
        ["--jitter", "51"],
        ["--broadcast", "192.0.2.255:47100"],
        ["--broadcast", "nowhere"],
        ["--set", "t_resend=0"],
    ],
)
def test_usage(arguments: list[str]) -> None:
    assert automcm("conform", "live", "7", *arguments).exit_code == 2


def test_an_adapter_that_does_not_start() -> None:
    done = automcm(
        "conform", "live", "7", "--broadcast", "127.255.255.255:47397", "--", "./nothing"
    )
    assert done.exit_code == 3
    assert "cannot be started" in done.stderr
