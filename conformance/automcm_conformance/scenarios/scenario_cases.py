"""The scenarios: several stations of one implementation on a scripted radio.

A scenario is data: what the applications do, what the radio does, and what the applications must
have been told in the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from automcm_conformance.adapter.connect import connect
from automcm_conformance.adapter.connect import hello as say_hello
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import MESSAGE_TYPES, HelloAnswer, ProtocolError
from automcm_conformance.scenarios.scenario_runner import (
    LEASE_MS,
    Application,
    Outcome,
    Play,
    Stage,
    When,
)
from automcm_conformance.scenarios.scripted_radio import Rule

P, Q, R = 1001, 1002, 2002

REQUEST = When("start", 500, "request")
COMPLETE = When("ACTUATING", 1_000, "complete")
PRESCRIBER = Application((REQUEST, COMPLETE))
RECEIVER = Application(joins=True)
BOTH = {P: PRESCRIBER, R: RECEIVER}
DONE = {P: ("choose", "accepted"), R: ("verify", "finished")}
CAM = ("CAM",)


def _both(*rules: Rule) -> Play:
    return Play(BOTH, rules, DONE)


def _cut(*rules: Rule) -> Play:
    """Nobody completes, and in the end both know that CAMs were lost."""
    story = {P: ("choose", "accepted", "fallback cam_loss"), R: ("verify", "fallback cam_loss")}
    return Play({P: Application((REQUEST,)), R: RECEIVER}, rules, story)


def _fin_lost(lease_ms: int, reason: str) -> Play:
    prescriber = Application((REQUEST, COMPLETE), lease_ms=lease_ms)
    story = {P: DONE[P], R: ("verify", f"fallback {reason}")}
    return Play({P: prescriber, R: RECEIVER}, (Rule("lose", ("Fin",)),), story)


LOSSY = Play(BOTH, (Rule("lose", chance=0.2),), seeds=6)
REORDERED = Play(
    {P: PRESCRIBER, R: Application(joins=True, refuses=1, thinks_ms=1)},
    (Rule("again", by_ms=10), Rule("jitter")),
    {P: ("choose", "propose", "accepted"), R: ("verify", "verify", "finished")},
    seeds=4,
)
# The Intention is given up before the choice, and the Acceptance while both act.
NO_ACKS = Play(
    {P: Application((REQUEST, When("ACTUATING", 3_000, "complete")), thinks_ms=250), R: RECEIVER},
    (Rule("lose", ("Ack",)),),
    DONE,
)
IN_STEP = Play(
    {P: PRESCRIBER, Q: Application((REQUEST, COMPLETE, When("no_participants", 2_500, "request")))}
    | {R: RECEIVER},
    story={
        P: DONE[P],
        Q: ("no_participants", "choose", "accepted"),
        R: ("verify", "finished", "verify", "finished"),
    },
)
# It joins both, one after the other, and the first never learns that it has left.
CHANGES_ITS_MIND = Play(
    {
        P: Application((REQUEST, COMPLETE), thinks_ms=200),
        Q: Application((When("start", 550, "request"), COMPLETE)),
        R: Application((When("WAITING", 100, "abort", times=1),), joins=True),
    },
    (Rule("lose", ("Cancel",), src=R, dst=P),),
    {P: ("choose", "fallback no_agreement"), Q: DONE[P], R: DONE[R]},
)
# Both wait until neither is in quarantine any more, and the first request comes too early.
RESTARTS = Play(
    {
        P: Application(
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
    story={
        P: ("choose", "accepted", "refused", "choose", "accepted"),
        R: ("verify", "fallback cam_loss", "verify", "finished"),
    },
)
ABORTS = Play(
    {
        P: Application((REQUEST,)),
        R: Application((When("ACTUATING", 500, "abort"),), joins=True),
    },
    story={P: ("choose", "accepted", "fallback abort"), R: ("verify",)},
)
# It breaks off unheard, and is asked by another one while the first still acts on its word (ACT-6).
LETS_DOWN = Play(
    {
        P: Application((REQUEST,)),
        Q: Application((When("start", 1_500, "request"),)),
        R: Application(
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
    {P: Application((REQUEST, COMPLETE), target=3003)} | dict.fromkeys((R, 3003, 4004), RECEIVER),
    story={
        P: DONE[P],
        R: ("fallback not_selected",),
        3003: DONE[R],
        4004: ("fallback not_selected",),
    },
)
# The Cancels of those that were not chosen are sent till they are given up, and hold ends the wait.
UNHEARD = Play(
    THREE.stations,
    (Rule("lose", ("Cancel",)),),
    {P: DONE[P], R: ("fallback timeout",), 3003: DONE[R], 4004: ("fallback timeout",)},
)
# A copy of each Acceptance comes when the next proposal is on its way.
TWICE_REFUSED = Play(
    {P: PRESCRIBER, R: Application(joins=True, refuses=2)},
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
    "scenario two prescribers": (IN_STEP, CHANGES_ITS_MIND),
    "scenario prescriber restarts": (RESTARTS,),
    "scenario receiver aborts": (ABORTS, LETS_DOWN),
    "scenario three receivers": (THREE, UNHEARD),
    "scenario refused twice": (TWICE_REFUSED,),
    "scenario Fin lost": (_fin_lost(LEASE_MS, "cam_loss"), _fin_lost(3_000, "lease_expired")),
    "scenario late copies": (_both(Rule("late", MESSAGE_TYPES)),),
}
"""The plays of each scenario, by the case that it is bound to (suite/purposes.toml)."""


def needs(plays: Sequence[Play]) -> list[str]:
    """The features that an implementation must have."""
    whens = [when for play in plays for a in play.stations.values() for when in a.whens]
    restarts = any(when.action == "restart" for when in whens)
    return ["prescriber", "receiver", "cam", *(["restart"] if restarts else [])]


def run(
    name: str,
    command: Sequence[str],
    hello: HelloAnswer,
    folder: Path,
    *,
    limit_s: float,
    seed: int,
) -> Outcome:
    """Play the scenario ``name`` with stations of the adapter ``command``, whose hello is known.

    ``limit_s`` is the real time that an answer may take.  Logs are written into ``folder``, under
    ``scenarios``.  The same ``seed`` gives the same bytes.  Raises KeyError for an unknown name,
    and OSError if a log cannot be written.
    """
    plays = NAMES[name]
    missing = [need for need in needs(plays) if need not in hello.features]
    if missing:
        return Outcome("SKIP", f"needs {', '.join(missing)}")
    stations = sorted({station for play in plays for station in play.stations})
    place = folder / "scenarios" / name.removeprefix("scenario ").replace(" ", "-")
    outcomes = []
    with ExitStack() as stack:
        try:
            processes = {
                station: stack.enter_context(connect(command, limit_s)) for station in stations
            }
            for process in processes.values():
                say_hello(process)
        except (AdapterError, ProtocolError) as error:
            return Outcome("ERROR", str(error), came=list(getattr(error, "stderr", ())))
        for number, play in enumerate(plays, 1):
            for k in range(play.seeds):
                at = place / f"{number}-{seed + k}"
                at.mkdir(parents=True, exist_ok=True)
                stage = Stage(play, processes, hello, at, seed + k)
                outcomes.append(stage.outcome(folder))
                if outcomes[-1].verdict in ("FAIL", "ERROR"):
                    return outcomes[-1]
    logs = [log for outcome in outcomes for log in outcome.log]
    bad = [outcome for outcome in outcomes if outcome.verdict != "PASS"]
    unclear = next((outcome for outcome in bad if outcome.verdict == "INCONC"), None)
    if unclear or len(bad) == len(outcomes):
        return unclear or bad[0]
    left_out = f"left out, {len(bad)} of {len(outcomes)} plays: {bad[0].reason}" if bad else ""
    return Outcome("PASS", left_out, log=logs)
