"""Stations of the reference under hypothesis: whatever the radio and the drivers do, S-1 … S-7 and
T-1 … T-3 hold, and every station does what the graph of one station says.

``World`` (stateful_world.py) is a few stations, the copies of messages in flight between them, one
clock, and all the checks.  ``Coordination`` is its state machine: a rule for each thing that can
happen.  What a station does is written as its log (automcm.logging) and followed by the engine of
``automcm trace explain`` (stateful_oracle.py), so every effect of every input is held against the
oracle.

    python reference/tests/stateful.py --steps 1000000 --seed 1

runs the deep profile: many machines, in two processes.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import sys
import time
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, ClassVar

import hypothesis
from hypothesis import HealthCheck, Phase, settings, target
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)
from stateful_oracle import (
    ALL,
    LEASES,
    SETUPS,
    Broken,
    Coverage,
)
from stateful_world import (
    Copy,
    Rules,
    World,
    odd_messages,
    trajectory,
)

from automcm.interface import (
    Abort,
    Accept,
    Command,
    Complete,
    Prescribe,
    Proceed,
    Refuse,
    Request,
)
from automcm.messages import (
    encode,
)
from automcm.rules import RULES
from automcm_traces.track import CannotTell

# -- the machine


def step(**strategies: Any) -> Callable[[Any], Any]:
    """A rule; what is called is kept, so that a run can be told and repeated."""

    def wrap(function: Any) -> Any:
        @wraps(function)
        def called(self: Coordination, **drawn: Any) -> None:
            self.begin(function.__name__, drawn)
            function(self, **drawn)

        return rule(**strategies)(called)

    return wrap


Call = tuple[str, dict[str, Any]]
"""A rule and what was drawn for it."""

SOME = st.integers(0, 11)
STATION = st.integers(0, 3)
FEW = st.integers(1, 4)
LATE = st.booleans()
UPTO = ("CHOOSING", "PRESCRIBING", "NEGOTIATING", "ACTUATING", "DECIDING")
"""DECIDING: about the next proposal, or ACTUATING if there is none."""
LOST = st.sampled_from(("", "Ack", "Cancel", "Acceptance", "Intention", "Prescription"))
"""Messages of this type are lost."""
NAMES = ("prescribe", "proceed", "accept", "refuse", "complete", "abort")


class Coordination(RuleBasedStateMachine):
    """Each rule is one thing that can happen, or a few that often happen together.

    A number chooses among what there is, modulo how much there is, so that it stays meaningful
    while hypothesis shrinks.
    """

    rules_: ClassVar[Rules] = RULES
    checks: ClassVar[frozenset[str]] = ALL
    coverage: ClassVar[Coverage] = Coverage()
    last: ClassVar[list[Call]] = []
    """What the machine that ran last did."""
    setups: ClassVar[tuple[int, ...]] = (0, 1, 2)

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[Call] = []
        type(self).last = self.calls
        self.world = self._world(0)

    def _world(self, setup: int) -> World:
        return World(SETUPS[setup], rules=self.rules_, checks=self.checks, coverage=self.coverage)

    def begin(self, name: str, drawn: dict[str, Any]) -> None:
        self.calls.append((name, drawn))
        self.coverage.steps += 1

    @initialize(setup=st.integers(0, 2))
    def set_up(self, setup: int) -> None:
        setup = self.setups[setup % len(self.setups)]
        self.calls.append(("set_up", {"setup": setup}))
        if setup:
            self.world = self._world(setup)

    # -- the radio

    def _pick(self, n: int) -> Copy:
        flight = self.world.flight
        return flight[n % len(flight)]

    def in_flight(self) -> bool:
        return bool(self.world.flight)

    @precondition(in_flight)
    @step(n=SOME, indifferent=st.booleans())
    def deliver(self, n: int, indifferent: bool) -> None:
        """A copy arrives; whom an Advertisement does not concern is indifferent."""
        copy = self.world.flight.pop(n % len(self.world.flight))
        self.world.concerned = not indifferent
        self.world.deliver(copy)
        self.world.concerned = True

    @precondition(in_flight)
    @step(n=SOME)
    def duplicate(self, n: int) -> None:
        """A copy arrives, and will again."""
        self.world.deliver(self._pick(n))

    def has_past(self) -> bool:
        return bool(self.world.past)

    @precondition(has_past)
    @step(n=SOME)
    def again(self, n: int) -> None:
        """What has arrived arrives once more."""
        past = self.world.past
        self.world.deliver(past.pop(-1 - n % len(past)))

    @precondition(in_flight)
    @step(n=SOME)
    def lose(self, n: int) -> None:
        self.world.flight.pop(n % len(self.world.flight))

    @precondition(in_flight)
    @step(n=SOME, s=STATION)
    def overhear(self, n: int, s: int) -> None:
        """A copy also reaches a station it is not for, or its sender as an echo."""
        ids = self.world.ids
        self.world.hear(ids[s % len(ids)], self._pick(n).data)

    @step(lost=LOST, backwards=st.booleans())
    def exchange(self, lost: str, backwards: bool) -> None:
        """Everything arrives, and so do the answers."""
        self.world.lost = lost
        self.world.exchange(backwards)
        self.world.lost = ""

    @step(s=STATION, t=STATION, what=st.integers(0, 8) | st.integers(0, 60), bound=st.booleans())
    def odd(self, s: int, t: int, what: int, bound: bool) -> None:
        """A station (one in a session, if possible) hears what must do nothing."""
        stations = (self.bound() if bound else []) or self.world.ids
        s = stations[s % len(stations)]
        others = [q for q in self.world.ids if q != s]
        messages = odd_messages(self.world, s, others[t % len(others)])
        self.world.hear(s, messages[-1 - what % len(messages)])

    # -- CAMs

    @step(s=STATION)
    def cam(self, s: int) -> None:
        up = self.world.up()
        if up:
            self.world.fly_cam(up[s % len(up)])

    def _drive(self, rounds: int, deaf: int) -> None:
        world = self.world
        for _ in range(rounds):
            for s in world.up():
                data = encode(world.send_cam(s))
                for n, t in enumerate(world.ids):
                    if t != s and n != deaf:
                        world.hear(t, data)
            world.pass_time(world.now + 400, late=False)

    @step(rounds=FEW, deaf=st.integers(-1, 3))
    def drive(self, rounds: int, deaf: int) -> None:
        """For a while CAMs arrive, but not at the deaf one, and messages nowhere."""
        self._drive(rounds, deaf)

    def acting(self) -> list[int]:
        return self.world.at("prescriber", "ACTUATING")

    @precondition(acting)
    @step(rounds=st.integers(1, 6))
    def drive_on(self, rounds: int) -> None:
        """The same while somebody acts, and nobody is deaf."""
        self._drive(rounds, -1)

    # -- time

    @step(deadlines=FEW, late=LATE)
    def advance(self, deadlines: int, late: bool) -> None:
        """To the next deadline, or a few of them."""
        for _ in range(deadlines):
            deadline = self.world.next_deadline()
            if deadline is not None:
                self.world.pass_time(deadline, late)

    @precondition(in_flight)
    @step(ms=st.sampled_from((1, 10, 25, 49)), late=LATE)
    def delay(self, ms: int, late: bool) -> None:
        self.world.pass_time(self.world.now + ms, late)

    @step(ms=st.sampled_from((200, 600, 1200, 6000)))
    def silence(self, ms: int) -> None:
        """Nothing arrives for a while."""
        self.world.pass_time(self.world.now + ms, late=False)

    # -- the applications

    @step(s=STATION)
    def request(self, s: int) -> None:
        up = self.world.up()
        if up:
            self.world.command(up[s % len(up)], Request(scenario="lane_change"))

    def choosing(self) -> list[int]:
        world = self.world
        deciding = [s for s in world.at("prescriber", "NEGOTIATING") if world.state(s).deciding]
        return world.at("prescriber", "CHOOSING") + deciding

    def verifying(self) -> list[int]:
        return self.world.at("receiver", "NEGOTIATING")

    def bound(self) -> list[int]:
        return [s for s in self.world.up() if self.world.state(s).bound]

    def _prescribe(self, s: int, to: int, lease: int) -> None:
        x = self.world.state(s)
        assert x.session is not None
        targets = sorted(x.recorded) or [x.target]
        command = Prescribe(
            session=x.session,
            proposal=x.proposal + 1,
            target=targets[to % len(targets)],
            prescribed=trajectory(x.session[1] * 10 + x.proposal),
            hold_ms=50,
            lease_ms=lease,
        )
        self.world.command(s, command)

    @precondition(choosing)
    @step(s=STATION, to=STATION, lease=st.sampled_from(LEASES))
    def prescribe(self, s: int, to: int, lease: int) -> None:
        stations = self.choosing()
        self._prescribe(stations[s % len(stations)], to, lease)

    @precondition(choosing)
    @step(s=STATION)
    def proceed(self, s: int) -> None:
        stations = self.choosing()
        s = stations[s % len(stations)]
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Proceed(session=session))

    def _verdict(self, s: int, refused: bool) -> None:
        m = self.world.asked[s]
        which: Any = {"session": m.session, "proposal": m.proposal}
        command = Refuse(**which) if refused else Accept(**which, selected=m.prescribed)
        self.world.command(s, command)

    @precondition(verifying)
    @step(s=STATION, refused=st.booleans())
    def verdict(self, s: int, refused: bool) -> None:
        stations = self.verifying()
        self._verdict(stations[s % len(stations)], refused)

    @precondition(acting)
    @step(s=STATION)
    def complete(self, s: int) -> None:
        stations = self.acting()
        s = stations[s % len(stations)]
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Complete(session=session))

    @precondition(bound)
    @step(s=STATION)
    def abort(self, s: int) -> None:
        stations = self.bound()
        s = stations[s % len(stations)]
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Abort(session=session))

    @step(s=STATION, name=st.sampled_from(NAMES), what=st.integers(0, 3))
    def untimely(self, s: int, name: str, what: int) -> None:
        """A command, whatever the phase."""
        up = self.world.up()
        if up:
            self._mistake(up[s % len(up)], name, what)

    def asked(self) -> list[tuple[str, int]]:
        """Whose command would fit its phase."""
        found = [("prescribe", s) for s in self.choosing()]
        found += [("proceed", s) for s in self.world.at("prescriber", "CHOOSING")]
        found += [(name, s) for s in self.verifying() for name in ("accept", "refuse")]
        return found + [("complete", s) for s in self.acting()]

    @precondition(asked)
    @step(n=SOME, what=st.integers(0, 3))
    def mistaken(self, n: int, what: int) -> None:
        """A command that fits the phase, but perhaps not the session, proposal or target."""
        commands = self.asked()
        name, s = commands[n % len(commands)]
        self._mistake(s, name, what)

    def _mistake(self, s: int, name: str, what: int) -> None:
        x = self.world.state(s)
        session = x.session or (s, 1)
        if what == 1:
            session = session[0], session[1] + 1
        wrong = what == 2
        prescribed = trajectory(1)
        which: Any = {"session": session, "proposal": max(1, x.proposal + wrong)}
        command: Command
        match name:
            case "prescribe":
                targets = [q for q in self.world.ids if q not in (x.target, *x.recorded)]
                targets = sorted(targets, key=lambda q: q != s)  # itself first
                others = [q for q in self.world.ids if q != s]
                command = Prescribe(
                    session=session,
                    proposal=x.proposal + 1 + wrong,
                    target=targets[0] if what == 3 and targets else (x.target or others[0]),
                    prescribed=prescribed,
                    hold_ms=0,
                    lease_ms=LEASES[0],
                )
            case "proceed":
                command = Proceed(session=session)
            case "accept":
                m = self.world.asked.get(s)
                command = Accept(**which, selected=m.prescribed if m else prescribed)
            case "refuse":
                command = Refuse(**which)
            case "complete":
                command = Complete(session=session)
            case _:
                command = Abort(session=session)
        self.world.command(s, command)

    def _arrive(self, lost: str, slow: bool) -> None:
        """What arrives, arrives, but for messages of one type; if there is nothing, time passes.
        It also does if messages are slow."""
        world = self.world
        world.lost = lost
        deadline = world.next_deadline()
        moved = not slow and world.exchange() > 0
        if deadline is not None and not (moved or self.choosing() or self.verifying()):
            world.pass_time(deadline, late=slow)
        world.lost = ""

    def _answer(self, lease: int, refusals: int) -> None:
        """Who is asked agrees, after some refusals."""
        for s in self.choosing():
            self._prescribe(s, 0, lease)
        for s in self.verifying():
            self._verdict(s, refused=self.world.asked[s].proposal <= refusals)

    @step(rounds=st.integers(1, 8), refusals=st.integers(0, 2), lost=LOST, slow=st.booleans())
    def go_on(self, rounds: int, refusals: int, lost: str, slow: bool) -> None:
        """A while in which all goes well, but that messages of one type are lost."""
        for _ in range(rounds):
            self._arrive(lost, slow)
            self._answer(LEASES[0], refusals)

    def at_rest(self) -> list[int]:
        states = ((s, self.world.state(s)) for s in self.world.up())
        return [s for s, x in states if not x.bound and not x.backoff]

    @precondition(at_rest)
    @step(
        s=STATION,
        upto=st.sampled_from(UPTO),
        lease=st.sampled_from(LEASES),
        refusals=st.integers(0, 2),
        lost=LOST,
        slow=st.booleans(),
    )
    def session(self, s: int, upto: str, lease: int, refusals: int, lost: str, slow: bool) -> None:
        """A station opens a session, and it goes on up to a phase of its."""
        stations = self.at_rest()
        s = stations[s % len(stations)]
        self.world.command(s, Request(scenario="lane_change"))
        for _ in range(16):
            for go_on in (
                lambda: self._arrive(lost, slow),
                lambda: self._answer(lease, refusals),
            ):
                go_on()
                x = self.world.state(s)
                if x.phase in (upto, "STANDALONE"):
                    return
                if upto == "DECIDING" and (x.deciding or x.phase == "ACTUATING"):
                    return

    @precondition(at_rest)
    @step(s=STATION, times=st.integers(1, 3))
    def change_of_mind(self, s: int, times: int) -> None:
        """A station opens a session and soon aborts it; nobody hears of that."""
        stations = self.at_rest()
        s = stations[s % len(stations)]
        for _ in range(times):
            self.world.command(s, Request(scenario="lane_change"))
            self.world.exchange()
            session = self.world.state(s).session
            if session is not None:
                self.world.command(s, Abort(session=session))

    def promised(self) -> list[int]:
        return self.world.at("receiver", "INTENDING", "WAITING", "NEGOTIATING", "ACTUATING")

    @precondition(promised)
    @step(s=STATION, heard=st.booleans())
    def defect(self, s: int, heard: bool) -> None:
        """A receiver breaks off.  That arrives before anything else; or nobody hears of it, and
        it opens a session of its own."""
        stations = self.promised()
        s = stations[s % len(stations)]
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Abort(session=session))
        if heard:
            self.world.exchange(backwards=True)
        else:
            self.world.flight = [c for c in self.world.flight if c.what != "Cancel"]
            self.world.command(s, Request(scenario="lane_change"))

    def committed(self) -> list[int]:
        return self.world.at("receiver", "ACTUATING")

    @precondition(committed)
    @step(s=STATION, restart=st.booleans())
    def let_go(self, s: int, restart: bool) -> None:
        """A committed receiver aborts, or restarts, and nobody hears of it."""
        stations = self.committed()
        s = stations[s % len(stations)]
        if restart:
            self.world.restart(s)
            return
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Abort(session=session))
        self.world.flight = [c for c in self.world.flight if c.what != "Cancel"]

    session_again = session
    go_on_again = go_on
    mistaken_again = mistaken
    odd_again = odd
    drive_on_again = drive_on

    # -- crashes

    @step(s=STATION, what=st.sampled_from(("restart", "crash")), bound=st.booleans())
    def trouble(self, s: int, what: str, bound: bool) -> None:
        """A station falls silent; or it comes back, from a crash before or now."""
        world = self.world
        stations = (self.bound() if bound else []) or world.ids
        s = stations[s % len(stations)]
        if what == "restart":
            world.restart(s)
        elif len(world.up()) > 1 and s not in world.down:
            world.crash(s)

    def teardown(self) -> None:
        if hypothesis.currently_in_test_context():
            world = self.world
            target(len(world.rules), label="rules by role and phase")
            target(len(world.accepted), label="acceptances")
            target(max((k for _, k in world.prescribed), default=0), label="proposals")
            target(world.longest_hazard, label="hazard, ms")


def profile(examples: int, steps: int, *, steered: bool = False) -> settings:
    """``steered``: half of the machines climb towards what ``teardown`` names as targets.

    Nothing depends on the wall clock: no deadline, and ``too_slow`` is suppressed because it
    would fail on a busy computer.  Shrinking is left to ``shortened``.
    """
    phases = [Phase.generate, Phase.target] if steered else [Phase.generate]
    return settings(
        max_examples=examples,
        stateful_step_count=steps,
        phases=phases,
        deadline=None,
        database=None,
        report_multiple_bugs=False,
        suppress_health_check=[HealthCheck.too_slow],
    )


def run(machine: type[Coordination], profile: settings, seed: int) -> Coverage:
    """Run machines and return what they met.  Raises Broken; ``machine.last`` has the exchange."""
    machine.coverage = Coverage()
    hypothesis.seed(seed)(machine)
    run_state_machine_as_test(machine, settings=profile)
    return machine.coverage


def repeated(machine: type[Coordination], calls: Sequence[Call]) -> str:
    """Do the same again, without hypothesis.  Returns what broke, "" for nothing, and "?" if a
    step cannot be taken."""
    again = machine()
    try:
        for name, drawn in calls:
            getattr(again, name)(**drawn)
    except Broken as error:
        return error.what
    except (ZeroDivisionError, CannotTell, KeyError):
        return "?"
    return ""


def shortened(machine: type[Coordination], calls: Sequence[Call], what: str) -> list[Call]:
    """The exchange without the steps that are not needed for ``what`` to break.

    Hypothesis leaves some: what is drawn for one step decides how the next is read.
    """
    kept = list(calls)

    def fails(candidate: list[Call]) -> bool:
        nonlocal kept
        if candidate == kept or repeated(machine, candidate) != what:
            return False
        kept = candidate
        return True

    before: list[Call] = []
    while kept != before:
        before = kept
        for size in (8, 4, 2, 1):
            at = len(kept) - size
            while at > 0:  # the first call sets up
                fails(kept[:at] + kept[at + size :])
                at = min(at, len(kept)) - size
        for at, (name, drawn) in enumerate(kept):
            for argument, value in drawn.items():
                for simpler in SIMPLER.get(argument, (type(value)(),)):
                    now = kept[at][1]
                    if now[argument] == simpler:
                        break
                    if fails([*kept[:at], (name, {**now, argument: simpler}), *kept[at + 1 :]]):
                        break
    return kept


SIMPLER: dict[str, tuple[Any, ...]] = {
    "lease": LEASES,
    "upto": UPTO,
    "name": NAMES,
    "ms": (1, 200),
    "deadlines": (1, 2, 3),
    "rounds": tuple(range(1, 9)),
    "times": (1, 2),
    "what": tuple(range(9)),
}
"""Values to try, simplest first; elsewhere 0, False or nothing."""


def told(calls: Sequence[Call]) -> str:
    """An exchange, as a program."""
    lines = [f"m.{name}({', '.join(f'{k}={v!r}' for k, v in d.items())})" for name, d in calls]
    return "\n".join(["m = Coordination()", *lines])


# -- the deep profile


def batch(seed: int) -> tuple[int, Coverage, str]:
    """Some thousand steps.  Returns what they met, and what broke."""
    try:
        run(Coordination, profile(100, 50 + 50 * (seed % 2), steered=seed % 4 == 3), seed)
    except Broken as error:
        calls = shortened(Coordination, Coordination.last, error.what)
        return seed, Coordination.coverage, f"seed {seed}: {error}\n{told(calls)}"
    except Exception as error:
        text = f"seed {seed}: {type(error).__name__}: {error}\n{told(Coordination.last)}"
        return seed, Coordination.coverage, text
    return seed, Coordination.coverage, ""


def main() -> int:
    parser = argparse.ArgumentParser(description="The deep profile of the stateful tests.")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1, help="the first; each batch has its own")
    parser.add_argument("--processes", type=int, default=2)
    wanted = parser.parse_args()
    total, failures, seed, began = Coverage(), 0, wanted.seed, time.monotonic()
    with multiprocessing.get_context("spawn").Pool(wanted.processes) as pool:
        for seed, coverage, broke in pool.imap(batch, itertools.count(wanted.seed)):
            total.add(coverage)
            if broke:
                failures += 1
                print(broke, flush=True)
            if sys.stderr.isatty():
                print(f"\r{total.steps} steps, seed {seed}", end="", file=sys.stderr, flush=True)
            if total.steps >= wanted.steps or failures >= 5:
                break
        pool.terminate()
    seconds = time.monotonic() - began
    print(f"seeds {wanted.seed} to {seed}, {seconds:.0f} s, {total.steps / seconds:.0f} steps/s")
    print(total.report())
    print(f"{failures} batches failed")
    return 1 if failures or total.missing() or total.cannot_tell else 0


if __name__ == "__main__":
    sys.exit(main())
