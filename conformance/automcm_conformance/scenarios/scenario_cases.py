"""The scenarios: several stations of one implementation on a scripted radio.

A scenario is data: the actions of the applications, the rules of the radio, and the indications
that the applications must have received at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from automcm_conformance.adapter.process import AdapterError, Process
from automcm_conformance.adapter.protocol import (
    MESSAGE_TYPES,
    SAY_HELLO,
    HelloAnswer,
    ProtocolError,
    read_hello,
)
from automcm_conformance.scenarios.scenario_runner import (
    LEASE_MS,
    Play,
    PlayRun,
    ScenarioOutcome,
    ScriptedDriver,
    When,
)
from automcm_conformance.scenarios.scripted_radio import Rule
from automcm_spec.support import files

P, Q, R = 1001, 1002, 2002

REQUEST = When("start", 500, "request")
COMPLETE = When("ACTUATING", 1_000, "complete")
PRESCRIBER = ScriptedDriver((REQUEST, COMPLETE))
RECEIVER = ScriptedDriver(joins=True)
BOTH = {P: PRESCRIBER, R: RECEIVER}
DONE = {P: ("choose", "accepted"), R: ("verify", "finished")}
CAM = ("CAM",)


def _both(*rules: Rule) -> Play:
    return Play(BOTH, rules, DONE)


def _cut(*rules: Rule) -> Play:
    """No station completes the session, and both detect the loss of CAMs."""
    expected = {P: ("choose", "accepted", "fallback cam_loss"), R: ("verify", "fallback cam_loss")}
    return Play({P: ScriptedDriver((REQUEST,)), R: RECEIVER}, rules, expected)


def _fin_lost(lease_ms: int, reason: str) -> Play:
    prescriber = ScriptedDriver((REQUEST, COMPLETE), lease_ms=lease_ms)
    expected = {P: DONE[P], R: ("verify", f"fallback {reason}")}
    return Play({P: prescriber, R: RECEIVER}, (Rule("lose", ("Fin",)),), expected)


LOSSY = Play(BOTH, (Rule("lose", chance=0.2),), seeds=6)
REORDERED = Play(
    {P: PRESCRIBER, R: ScriptedDriver(joins=True, refuses=1, thinks_ms=1)},
    (Rule("again", by_ms=10), Rule("jitter")),
    {P: ("choose", "propose", "accepted"), R: ("verify", "verify", "finished")},
    seeds=4,
)
# The Intention is given up before the choice, and the Acceptance while both stations act.
NO_ACKS = Play(
    {
        P: ScriptedDriver((REQUEST, When("ACTUATING", 3_000, "complete")), thinks_ms=250),
        R: RECEIVER,
    },
    (Rule("lose", ("Ack",)),),
    DONE,
)
BOTH_PRESCRIBE = Play(
    {
        P: PRESCRIBER,
        Q: ScriptedDriver((REQUEST, COMPLETE, When("no_participants", 2_500, "request"))),
    }
    | {R: RECEIVER},
    expected={
        P: DONE[P],
        Q: ("no_participants", "choose", "accepted"),
        R: ("verify", "finished", "verify", "finished"),
    },
)
# The receiver leaves the first prescriber for the second, and the first does not learn of it.
RECEIVER_LEAVES = Play(
    {
        P: ScriptedDriver((REQUEST, COMPLETE), thinks_ms=200),
        Q: ScriptedDriver((When("start", 550, "request"), COMPLETE)),
        R: ScriptedDriver((When("WAITING", 100, "abort", times=1),), joins=True),
    },
    (Rule("lose", ("Cancel",), src=R, dst=P),),
    {P: ("choose", "fallback no_agreement"), Q: DONE[P], R: DONE[R]},
)
# The first request after the restart comes during the quarantine, the second after it.
RESTARTS = Play(
    {
        P: ScriptedDriver(
            (
                REQUEST,
                When("ACTUATING", 500, "restart", times=1),
                When("restart", 10, "request"),
                When("restart", 9_000, "request"),
                COMPLETE,
            )
        ),
        R: RECEIVER,
    },
    expected={
        P: ("choose", "accepted", "refused", "choose", "accepted"),
        R: ("verify", "fallback cam_loss", "verify", "finished"),
    },
)
ABORTS = Play(
    {
        P: ScriptedDriver((REQUEST,)),
        R: ScriptedDriver((When("ACTUATING", 500, "abort"),), joins=True),
    },
    expected={P: ("choose", "accepted", "fallback abort"), R: ("verify",)},
)
# The receiver's Cancel is lost, and another prescriber advertises while the first still relies on
# the receiver's commitment (ACT-6).
ABORT_LOST = Play(
    {
        P: ScriptedDriver((REQUEST,)),
        Q: ScriptedDriver((When("start", 1_500, "request"),)),
        R: ScriptedDriver(
            (When("ACTUATING", 300, "abort"), When("ACTUATING", 400, "request")), joins=True
        ),
    },
    (Rule("lose", ("Cancel",)),),
    {
        P: ("choose", "accepted", "fallback cam_loss"),
        Q: ("no_participants",),
        R: ("verify", "refused"),
    },
)
THREE = Play(
    {P: ScriptedDriver((REQUEST, COMPLETE), target=3003)}
    | dict.fromkeys((R, 3003, 4004), RECEIVER),
    expected={
        P: DONE[P],
        R: ("fallback not_selected",),
        3003: DONE[R],
        4004: ("fallback not_selected",),
    },
)
# The Cancels to the receivers that were not chosen are lost, and the hold timer ends their wait.
CANCELS_LOST = Play(
    THREE.stations,
    (Rule("lose", ("Cancel",)),),
    {P: DONE[P], R: ("fallback timeout",), 3003: DONE[R], 4004: ("fallback timeout",)},
)
# A copy of each Acceptance arrives after the next proposal has been sent.
TWICE_REFUSED = Play(
    {P: PRESCRIBER, R: ScriptedDriver(joins=True, refuses=2)},
    (Rule("again", ("Acceptance",), by_ms=60),),
    {
        P: ("choose", "propose", "propose", "accepted"),
        R: ("verify", "verify", "verify", "finished"),
    },
)

NAMES: dict[str, tuple[Play, ...]] = {
    "scenario all arrives": (_both(),),
    "scenario one in five lost": (LOSSY,),
    "scenario each lost once": (_both(Rule("lose", MESSAGE_TYPES, first=True)),),
    "scenario each twice": (_both(Rule("again", by_ms=30)),),
    "scenario reordered": (REORDERED,),
    "scenario all Acks lost": (NO_ACKS,),
    "scenario CAMs cut": (
        _cut(Rule("lose", CAM, acting_ms=500)),
        _cut(Rule("lose", acting_ms=500)),
    ),
    "scenario CAMs cut one way": (
        _cut(Rule("lose", CAM, src=P, acting_ms=500)),
        _cut(Rule("lose", CAM, src=R, acting_ms=500)),
    ),
    "scenario two prescribers": (BOTH_PRESCRIBE, RECEIVER_LEAVES),
    "scenario prescriber restarts": (RESTARTS,),
    "scenario receiver aborts": (ABORTS, ABORT_LOST),
    "scenario three receivers": (THREE, CANCELS_LOST),
    "scenario refused twice": (TWICE_REFUSED,),
    "scenario Fin lost": (_fin_lost(LEASE_MS, "cam_loss"), _fin_lost(3_000, "lease_expired")),
    "scenario late copies": (_both(Rule("late", MESSAGE_TYPES)),),
}
"""The plays of each scenario, by the name of its case (suite/purposes.toml)."""


def needs(plays: Sequence[Play]) -> list[str]:
    """The features that an implementation needs for these plays."""
    actions = [when for play in plays for a in play.stations.values() for when in a.actions]
    restarts = any(when.action == "restart" for when in actions)
    return ["prescriber", "receiver", "cam", *(["restart"] if restarts else [])]


def run(
    name: str,
    command: Sequence[str],
    hello: HelloAnswer,
    folder: Path,
    *,
    limit_s: float,
    seed: int,
) -> ScenarioOutcome:
    """Run all plays of the scenario ``name`` with stations of the adapter ``command``.

    ``hello`` is its answer to hello; ``limit_s`` is the real time in seconds that an answer may
    take.  Logs are written to the folder ``scenarios`` in ``folder``.  The same ``seed`` gives the
    same bytes.  Raises KeyError for an unknown name, and OSError if a log cannot be written.
    """
    plays = NAMES[name]
    missing = [need for need in needs(plays) if need not in hello.features]
    if missing:
        return ScenarioOutcome("SKIP", f"needs {', '.join(missing)}")
    stations = sorted({station for play in plays for station in play.stations})
    place = folder / "scenarios" / name.removeprefix("scenario ").replace(" ", "-")
    outcomes = []
    with ExitStack() as stack:
        try:
            processes = {
                station: stack.enter_context(Process(command, limit_s=limit_s))
                for station in stations
            }
            for process in processes.values():
                read_hello(process.exchange([SAY_HELLO])[0])
        except (AdapterError, ProtocolError) as error:
            return ScenarioOutcome("ERROR", str(error), came=list(getattr(error, "stderr", ())))
        for number, play in enumerate(plays, 1):
            for k in range(play.seeds):
                at = place / f"{number}-{seed + k}"
                for each in (place.parent, place, at):
                    files.folder(each)
                running = PlayRun(play, processes, hello, at, seed + k)
                outcomes.append(running.outcome(folder))
                if outcomes[-1].verdict in ("FAIL", "ERROR"):
                    return outcomes[-1]
    logs = [log for outcome in outcomes for log in outcome.log]
    bad = [outcome for outcome in outcomes if outcome.verdict != "PASS"]
    unclear = next((outcome for outcome in bad if outcome.verdict == "INCONC"), None)
    if unclear or len(bad) == len(outcomes):
        return unclear or bad[0]
    skipped = f"skipped {len(bad)} of {len(outcomes)} plays: {bad[0].reason}" if bad else ""
    return ScenarioOutcome("PASS", skipped, log=logs)
