"""The courses of ``comfort``: faults of four vehicles in a maneuver, with and without the rule
against each.

A rule is disabled outside of the protocol core: by a parameter that disables its timer, or by an
application that omits a command.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

from automcm.applications.lane_change import PaperLaneChange, Plan
from automcm.applications.vehicle import STEP_S, Driving, Vehicle
from automcm.kernels.prescribe import prescribe
from automcm.kernels.thin import thin
from automcm.kernels.trajectory import to_message
from automcm.service.application import AgreedManeuver, Choice, Proposal
from automcm_evaluation.comfort.comfort_measures import Tracks, tracks
from automcm_simulation.road import drive as driving
from automcm_simulation.road.drive import STEP_MS, FourVehicles
from automcm_simulation.road.simulation import Simulation
from automcm_spec.vocabulary.application import Abort, Command, Prescribe
from automcm_spec.vocabulary.parameters import Parameters

PRESCRIBER, A, B, C = 1, 2, 3, 4
NEVER_MS = 10**9
"""The duration of a timer that does not expire in any drive here."""
STAGES = ("negotiation", "hold", "slow-down", "lane change")


def stage(name: str, plan: Plan) -> tuple[float, float]:
    """Begin and end of a stage of an undisturbed maneuver, s since the signal (delays of messages
    left out)."""
    window_s, slow_s = Parameters().t_advertise / 1000, plan.gain_m / plan.delta_v
    lengths = (window_s, plan.hold_s, slow_s, Driving().lane_change_s)
    limits = pairwise(accumulate(lengths, initial=0.0))
    return dict(zip(STAGES, limits, strict=True))[name]


class Changer(PaperLaneChange):
    """The lane change of an application that can give up without a command.

    ``open_m``: it prescribes slower driving until this much is gained, which is more than it needs,
    so that its Fin ends the slowing.  ``leased``: False disables ACT-4.
    """

    def __init__(self, vehicle: Vehicle, plan: Plan, *, open_m: float = 0.0, leased: bool = True):
        super().__init__(vehicle, plan)
        self.executing = self.absent = False
        self._open_m, self._leased = open_m, leased

    def let_go(self) -> None:
        """Drive alone from now on without answering."""
        self.absent = True
        self._alone()

    def hang(self) -> None:
        """Give no answer and no command from now on."""
        self.absent = True
        self._begins_ms = self._drive = None

    def _chosen(self, choice: Choice) -> Command:
        command = super()._chosen(choice)
        if not isinstance(command, Prescribe):
            return command
        changed: dict[str, object] = {}
        if self._open_m:
            now = self.service.now() / 1000
            slow = prescribe(
                self._others[command.target].since(now),
                now,
                hold=self.plan.hold_s,
                delta_v=self.plan.delta_v,
                gain=self._open_m,
                v_min=self.plan.v_min,
            )
            changed["prescribed"] = to_message(thin(slow))
        if not self._leased:
            changed["lease_ms"] = NEVER_MS
        return command.model_copy(update=changed)

    def choose(self, choice: Choice) -> None:
        """As ``PaperLaneChange``, unless the application is absent."""
        if not self.absent:
            super().choose(choice)

    def verify(self, proposal: Proposal) -> None:
        """As ``PaperLaneChange``, unless the application is absent."""
        if not self.absent:
            super().verify(proposal)

    def load(self, maneuver: AgreedManeuver) -> None:
        """As ``PaperLaneChange``, unless the application is absent."""
        if not self.absent:
            self.executing = maneuver.role == "receiver"
            super().load(maneuver)

    def _alone(self) -> None:
        self.executing = False
        super()._alone()


@dataclass(frozen=True, kw_only=True)
class ComfortSetting:
    """A drive of the four vehicles with its assumptions, which ``comfort.Settings`` explains."""

    four: FourVehicles
    t_cam_loss_ms: int
    stands_s: float
    sees_s: float
    open_m: float

    def drawn(self, seed: int, spread_m: float) -> ComfortSetting:
        """The setting of this seed: phases of CAMs, delays, and positions within ``spread_m``."""
        dice = random.Random(seed)
        four = replace(
            self.four,
            seed=seed,
            gap_m=self.four.gap_m + dice.uniform(-spread_m, spread_m),
            beside_m=self.four.beside_m + dice.uniform(-spread_m, spread_m),
        )
        return replace(self, four=four)


@dataclass(frozen=True, kw_only=True)
class FaultyCourse:
    """A fault and the rule against it."""

    text: str = ""
    rule: str = ""
    """The rule that is disabled."""
    taken: str = ""
    """How the rule is disabled."""
    befalls: Callable[[ComfortRun], None] = lambda run: None
    cams: bool = True
    """Whether ACT-2 remains without the rule; ``leased``: ACT-4."""
    leased: bool = True
    open_ended: bool = False
    else_befalls: Callable[[ComfortRun], None] | None = None
    """The events on the same road without a lane change."""


NO_FAULT = FaultyCourse()


class ComfortRun:
    """One drive, on which the courses act and which the measures evaluate."""

    def __init__(
        self, setting: ComfortSetting, course: FaultyCourse = NO_FAULT, *, with_rules: bool = True
    ) -> None:
        self.setting, self.with_rules = setting, with_rules
        self.changers: dict[int, Changer] = {}
        open_m = setting.open_m if course.open_ended else 0.0
        leased, cams = with_rules or course.leased, with_rules or course.cams

        def make(vehicle: Vehicle, plan: Plan) -> Changer:
            changer = Changer(vehicle, plan, open_m=open_m, leased=leased)
            return self.changers.setdefault(vehicle.station_id, changer)

        self.drive: driving.SimulatedDrive = setting.four.on(
            Simulation(seed=setting.four.seed),
            Parameters(t_cam_loss=setting.t_cam_loss_ms if cams else NEVER_MS, clock_drift=0),
            make,
        )
        self._dead: set[int] = set()
        self._noticed = False
        self.drive.simulation.clock.at(STEP_MS, self._step)

    def at(self, after_signal_s: float, do: Callable[[], None]) -> None:
        """Call ``do`` at this time since the signal."""
        when = self.setting.four.signal_s + after_signal_s
        self.drive.simulation.clock.at(round(when * 1000), do)

    def go(self) -> Tracks:
        """Drive to the end."""
        if not self.setting.four.coordinated:
            self._silence()
        self.drive.run(self.setting.four.until_s)
        return tracks(self.drive.road.samples)

    def _step(self) -> None:
        clock = self.drive.simulation.clock
        clock.at(clock.now() + STEP_MS, self._step)
        if self.changers[PRESCRIBER].vehicle.changing and not self._noticed:
            self._noticed = True
            if not self.changers[B].executing:
                # Nobody told it that a vehicle would come (section VI-B).
                self.changers[B].vehicle.late = self.setting.four.late
        after = clock.now() > self.setting.four.signal_s * 1000
        if after and self.changers[PRESCRIBER].wanted is None and not self._bound():
            self._silence()

    def _bound(self) -> bool:
        services = self.drive.simulation.services
        return any(s.state.bound for n, s in services.items() if n not in self._dead)

    def _silence(self) -> None:
        """Stop the CAMs: the drive no longer depends on messages, and they would only cost time."""
        for station_id, service in self.drive.simulation.services.items():
            self._dead.add(station_id)
            service.close()

    # -- what may befall it

    def cut(self, *ways: tuple[int, int]) -> None:
        """Lose all messages from the first station of each pair to the second."""
        for src, dst in ways:
            self.drive.simulation.radio.cut(src, dst)

    def dies(self, station_id: int) -> None:
        """Silence a station for good; its vehicle drives alone."""
        self._dead.add(station_id)
        self.drive.simulation.services[station_id].close()
        self.changers[station_id].let_go()

    def gives_up(self, station_id: int) -> None:
        """The application drives alone, with an abort (END-1) unless the rule is disabled."""
        service = self.drive.simulation.services[station_id]
        session = service.state.session
        self.changers[station_id].let_go()
        if self.with_rules and session is not None:
            service.command(Abort(session=session))

    def leader_stops(self) -> None:
        """A brakes to a stop, waits, and drives on."""
        vehicle, clock = self.changers[A].vehicle, self.drive.simulation.clock
        desired, vehicle.desired = vehicle.desired, 0.0

        def on() -> None:
            vehicle.desired = desired

        clock.at(clock.now() + round(self.setting.stands_s * 1000), on)

    def leader_stops_and_is_seen(self) -> None:
        """The prescriber's application notices it and gives up; without the rule it continues."""
        self.leader_stops()
        if self.with_rules:
            clock = self.drive.simulation.clock
            seen = clock.now() + round(self.setting.sees_s * 1000)
            clock.at(seen, lambda: self.gives_up(PRESCRIBER))


def _without_act_2(text: str, befalls: Callable[[ComfortRun], None]) -> FaultyCourse:
    taken = "t_cam_loss is so long that it never expires, in both stations"
    return FaultyCourse(text=text, rule="ACT-2", taken=taken, befalls=befalls, cams=False)


def _without_a_word(text: str, station_id: int) -> FaultyCourse:
    taken = "the application that gives up drives alone and gives its service no command"
    befalls = lambda run: run.gives_up(station_id)  # noqa: E731
    return FaultyCourse(text=text, rule="END-1, END-2", taken=taken, befalls=befalls)


COURSES = {
    "cut": _without_act_2(
        "from then on no message passes between the prescriber and B",
        lambda run: run.cut((PRESCRIBER, B), (B, PRESCRIBER)),
    ),
    "cut_to_b": _without_act_2(
        "from then on B hears nothing of the prescriber, which still hears B",
        lambda run: run.cut((PRESCRIBER, B)),
    ),
    "cut_to_prescriber": _without_act_2(
        "from then on the prescriber hears nothing of B, which still hears it",
        lambda run: run.cut((B, PRESCRIBER)),
    ),
    "prescriber_dies": _without_act_2(
        "the prescriber's station falls silent; its vehicle drives on alone",
        lambda run: run.dies(PRESCRIBER),
    ),
    "b_dies": _without_act_2(
        "B's station falls silent; its vehicle drives on alone", lambda run: run.dies(B)
    ),
    "prescriber_aborts": _without_a_word(
        "the prescriber's own lane is free again: its application gives the change up", PRESCRIBER
    ),
    "b_aborts": _without_a_word(
        "B's application can drive the trajectory no longer and gives up", B
    ),
    "leader_stops": FaultyCourse(
        text="A brakes to a stop; the prescriber's application sees it and gives the change up",
        rule="END-1, END-2",
        taken="the prescriber's application does not look: it goes on as if A did",
        befalls=ComfortRun.leader_stops_and_is_seen,
        else_befalls=ComfortRun.leader_stops,
    ),
    "prescriber_hangs": FaultyCourse(
        text="the prescriber's application hangs while its station works; what it prescribed was "
        "open-ended, to be ended by its Fin",
        rule="ACT-4",
        taken="the lease is so long that it never expires",
        befalls=lambda run: run.changers[PRESCRIBER].hang(),
        leased=False,
        open_ended=True,
    ),
}


def disturbed(
    course: FaultyCourse, setting: ComfortSetting, at_s: float, *, with_rules: bool
) -> Tracks:
    """The maneuver with the fault ``at_s`` seconds after the signal."""
    run = ComfortRun(setting, course, with_rules=with_rules)
    run.at(at_s, lambda: course.befalls(run))
    return run.go()


def undisturbed(setting: ComfortSetting, *, open_ended: bool = False) -> Tracks:
    """The undisturbed maneuver."""
    return ComfortRun(setting, FaultyCourse(open_ended=open_ended)).go()


def uncoordinated(setting: ComfortSetting) -> Tracks:
    """The prescriber changes lanes at once, and vehicles in the way notice late (section VI-B)."""
    return ComfortRun(replace(setting, four=replace(setting.four, coordinated=False))).go()


def nobody(setting: ComfortSetting, course: FaultyCourse = NO_FAULT, at_s: float = 0.0) -> Tracks:
    """The same road without a lane change."""
    four = setting.four
    never = replace(four, coordinated=False, signal_s=four.until_s + STEP_S)
    run = ComfortRun(replace(setting, four=never))
    if (befalls := course.else_befalls) is not None:
        when = round((four.signal_s + at_s) * 1000)
        run.drive.simulation.clock.at(when, lambda: befalls(run))
    return run.go()
