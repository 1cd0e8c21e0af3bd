"""The protocol of the bridge: rosbridge v2, its topics and its messages (docs/bridge.md)."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args

from pydantic import Field, ValidationError
from pydantic_core import from_json, to_json

from automcm.bridge.autoware import (
    NO_TRAJECTORY,
    AutowareTrajectory,
    Odometry,
    Ros,
    RosHeader,
    Time,
    to_time,
    to_trajectory,
    trajectory,
)
from automcm.bridge.driven_trajectory import timed_trajectory
from automcm.service import application
from automcm.service.service import NEIGHBOURS
from automcm_spec.vocabulary import application as commands
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Phase, Role

PORT = 9090
"""The default port of rosbridge."""
TYPES = "automcm_msgs/msg/"
IN, OUT = "/v2x/mcm/input/", "/v2x/mcm/output/"
MAX_IN = 2**20
"""Maximum bytes of a message to the bridge."""
MAX_MARKS = 40_000
"""Maximum commas and opening brackets in a message to the bridge, to limit the parsing time."""
MAX_OUT = 2**22
"""Maximum bytes of a message from the bridge."""
MAX_PLANNED = 8000
"""Maximum points in all planned trajectories of one choice."""
MAX_DETAILS = 8192
"""Maximum bytes of a request's ``details``, as JSON."""
MAX_SCENARIOS = 16
MAX_NAMED = 8
"""Maximum marks passed on of one station.  More would only repeat that it is bound elsewhere."""

Scenario = Annotated[str, Field(max_length=256)]
Duration = Annotated[int, Field(lt=2**31)]
Note = Annotated[str, Field(max_length=256)]


class Message(Ros):
    """A message with its own topic, which has the name of the message."""

    folder: ClassVar[str] = ""
    topic: ClassVar[str]
    type: ClassVar[str]
    header: RosHeader = RosHeader()

    def __init_subclass__(cls) -> None:
        """Set topic and type."""
        name = cls.__name__.removesuffix("Msg")
        cls.topic, cls.type = cls.folder + name.lower(), TYPES + name


class _Output(Message):
    folder = OUT


class _Input(Message):
    folder = IN


class SessionMsg(Ros):
    """A session; 0 and 0 mean no session."""

    prescriber: Annotated[int, Field(ge=0, le=2**32 - 1)] = 0
    number: messages.Natural = 0

    @property
    def key(self) -> messages.Session | None:
        """The session, or None."""
        return (self.prescriber, self.number) if self.prescriber and self.number else None


def to_session(session: messages.Session | None) -> SessionMsg:
    """A session in the bridge's form; number 0 for None."""
    return SessionMsg(prescriber=session[0], number=session[1]) if session else SessionMsg()


def stamped(ms: int) -> RosHeader:
    """A header with this time."""
    return RosHeader(stamp=to_time(ms))


# -- from the bridge to the driving software


class StateMsg(_Output):
    """The state of the station, also a sign of life of the service."""

    station_id: messages.StationId
    phase: Phase
    role: Role
    session: SessionMsg = SessionMsg()
    driver: bool
    """Whether there is a driver."""
    lost_after_ms: messages.Natural


Length = Annotated[int, Field(ge=-1, le=messages.LIMIT)]
"""A length in mm; -1 if it is unknown."""


class HeardMsg(Ros):
    """The last CAM of another station, as ``application.Heard``."""

    station_id: messages.StationId
    received: Time
    x_mm: messages.Integer
    y_mm: messages.Integer
    heading_mrad: messages.Integer
    speed_mm_s: messages.Integer
    marks: list[SessionMsg] = Field(default=[], max_length=MAX_NAMED, fail_fast=True)
    length_mm: Length = -1
    width_mm: Length = -1
    sigma_mm: Length = -1
    in_step: bool = True

    @classmethod
    def of(cls, heard: application.Heard, session: messages.Session | None) -> HeardMsg:
        """The form of the bridge, with the mark of ``session``, the station's own, first."""
        given = {field.name: getattr(heard, field.name) for field in fields(heard)}
        known = {name: value for name, value in given.items() if value is not None}
        marks = sorted(known.pop("marks"), key=lambda mark: mark != session)[:MAX_NAMED]
        received = to_time(known.pop("received_ms"))
        return cls(received=received, marks=[*map(to_session, marks)], **known)

    def value(self) -> application.Heard:
        """The value in the application's form.  Raises MessageError."""
        given = dict(self) | {name: None for name in _LENGTHS if getattr(self, name) < 0}
        received_ms = given.pop("received").ms
        marks = tuple(mark.key for mark in given.pop("marks"))
        if None in marks:
            raise messages.MessageError("msg.heard.marks: no session may be 0 and 0")
        return application.Heard(received_ms=received_ms, marks=marks, **given)


_LENGTHS = ("length_mm", "width_mm", "sigma_mm")


class SurroundingsMsg(_Output):
    """The stations that the service has heard lately, the last one last (APP-1)."""

    heard: list[HeardMsg] = Field(max_length=NEIGHBOURS, fail_fast=True)


class DriveMsg(_Output):
    """The current mode: ``coordinated`` with ``selected``, or ``alone`` with the last reason."""

    mode: Literal["coordinated", "alone"]
    session: SessionMsg = SessionMsg()
    reason: Note = ""
    role: Role = "none"
    selected: AutowareTrajectory = NO_TRAJECTORY
    start: Time = Time()
    until: Time = Time()

    @classmethod
    def of(cls, maneuver: application.AgreedManeuver, now: int) -> DriveMsg:
        """The message to the driving software; ``now`` in ms."""
        return cls(
            header=stamped(now),
            mode="coordinated",
            session=to_session(maneuver.session),
            role=maneuver.role,
            selected=to_trajectory(maneuver.selected, "selected"),
            start=to_time(maneuver.start_ms),
            until=to_time(maneuver.until_ms),
        )

    def drive(self, session: messages.Session) -> application.AgreedManeuver:
        """The value in the application's form.  Raises ValueError."""
        selected = trajectory(self.selected, "selected")
        return application.AgreedManeuver(
            session, self.role, selected, self.start.ms, self.until.ms
        )


class PlannedMsg(Ros):
    """The planned trajectory of one station."""

    station_id: messages.StationId
    trajectory: AutowareTrajectory


class ChoiceMsg(_Output):
    """The question which target to prescribe which trajectory."""

    session: SessionMsg
    proposal: messages.Positive
    planned: list[PlannedMsg] = Field(default_factory=list)
    target: Annotated[int, Field(ge=0, le=2**32 - 1)] = 0
    reason: Note = ""

    @classmethod
    def of(cls, choice: application.Choice, now: int) -> ChoiceMsg:
        """The message to the driving software; ``now`` in ms."""
        if sum(len(t.points) for t in choice.planned.values()) > MAX_PLANNED:
            raise messages.MessageError(f"planned: more than {MAX_PLANNED} points")
        return cls(
            header=stamped(now),
            session=to_session(choice.session),
            proposal=choice.proposal,
            planned=[
                PlannedMsg(station_id=station, trajectory=to_trajectory(t, f"planned.{station}"))
                for station, t in choice.planned.items()
            ],
            target=choice.target,
            reason=choice.reason,
        )

    def choice(self, session: messages.Session) -> application.Choice:
        """The value in the application's form.  Raises ValueError."""
        planned = {p.station_id: trajectory(p.trajectory, "planned") for p in self.planned}
        return application.Choice(session, self.proposal, planned, self.target, self.reason)


class ProposalMsg(_Output):
    """The question whether a prescribed trajectory is safe."""

    session: SessionMsg
    proposal: messages.Positive
    prescribed: AutowareTrajectory
    hold_ms: Annotated[Duration, Field(ge=0)]
    lease_ms: Annotated[Duration, Field(ge=1)]

    @classmethod
    def of(cls, proposal: application.Proposal, now: int) -> ProposalMsg:
        """The message to the driving software; ``now`` in ms."""
        return cls(
            header=stamped(now),
            session=to_session(proposal.session),
            proposal=proposal.proposal,
            prescribed=to_trajectory(proposal.prescribed, "prescribed"),
            hold_ms=proposal.hold_ms,
            lease_ms=proposal.lease_ms,
        )

    def asked(self, session: messages.Session) -> application.Proposal:
        """The value in the application's form.  Raises ValueError."""
        prescribed = trajectory(self.prescribed, "prescribed")
        return application.Proposal(session, self.proposal, prescribed, self.hold_ms, self.lease_ms)


class AdvertisedMsg(_Output):
    """A maneuver that another station plans."""

    session: SessionMsg
    scenario: str
    details: messages.Details
    planned: AutowareTrajectory = NO_TRAJECTORY
    concerned: bool
    """Whether the station joins because of an existing plan."""

    @classmethod
    def of(cls, advertised: application.Advertised, concerned: bool, now: int) -> AdvertisedMsg:
        """The message to the driving software; ``now`` in ms."""
        planned = advertised.planned
        return cls(
            header=stamped(now),
            session=to_session(advertised.session),
            scenario=advertised.scenario,
            details=dict(advertised.details),
            planned=NO_TRAJECTORY if planned is None else to_trajectory(planned, "planned"),
            concerned=concerned,
        )

    def advertised(self, session: messages.Session) -> application.Advertised:
        """The value in the application's form.  Raises ValueError."""
        planned = trajectory(self.planned, "planned") if self.planned.points else None
        return application.Advertised(session, self.scenario, self.details, planned)


class RefusedMsg(_Output):
    """A command was refused by ``rule``."""

    command: Note
    rule: Note


# -- from the driving software to the bridge


class OdometryIn(Odometry):
    """nav_msgs/Odometry: the vehicle's kinematics."""

    topic: ClassVar[str] = IN + "kinematics"
    type: ClassVar[str] = "nav_msgs/msg/Odometry"


class PlanMsg(_Input):
    """The vehicle's plan for these scenarios; without points they do not concern it."""

    scenarios: list[Scenario] = Field(max_length=MAX_SCENARIOS, fail_fast=True)
    trajectory: AutowareTrajectory


class RequestMsg(_Input):
    """Open a session (ADV-1)."""

    scenario: Scenario
    details: messages.Details = Field(default_factory=dict)
    planned: AutowareTrajectory = NO_TRAJECTORY

    def command(self, planned: messages.Trajectory | None) -> commands.Request:
        """The command for the station, with the converted ``planned``.  Raises ValueError."""
        if len(to_json(self.details)) > MAX_DETAILS:
            raise messages.MessageError(f"msg.details: more than {MAX_DETAILS} bytes")
        return commands.Request(scenario=self.scenario, details=self.details, planned=planned)


class _OfSession(_Input):
    session: SessionMsg

    @property
    def key(self) -> messages.Session:
        """The session.  Raises MessageError without one."""
        if (session := self.session.key) is None:
            raise messages.MessageError("msg.session: a session is required")
        return session

    def command(self) -> commands.Command:
        """The command with the same name; not for ``AcceptMsg``, which has no trajectory.

        Raises ValueError.
        """
        fields = {name: value for name, value in self if name not in ("header", "session")}
        fields |= {"name": self.topic.removeprefix(IN), "session": self.key}
        return commands.COMMAND.validate_python(fields)


class PrescribeMsg(_OfSession):
    """The choice of a target, or the next proposal to it (PRE-2, NEG-7)."""

    proposal: messages.Positive
    target: messages.StationId
    prescribed: AutowareTrajectory
    hold_ms: Annotated[Duration, Field(ge=0)]
    lease_ms: Annotated[Duration, Field(ge=1)]

    def command(self) -> commands.Prescribe:
        """The command for the station.  Raises ValueError."""
        return commands.Prescribe(
            session=self.key,
            proposal=self.proposal,
            target=self.target,
            prescribed=timed_trajectory(self.prescribed, "msg.prescribed"),
            hold_ms=self.hold_ms,
            lease_ms=self.lease_ms,
        )


class CloseMsg(_OfSession):
    """Close the advertising window before its time (ADV-9)."""


class ProceedMsg(_OfSession):
    """No vehicle is in the way (PRE-3)."""


class AcceptMsg(_OfSession):
    """The proposal is safe (NEG-2); the selected trajectory is the prescribed one."""

    proposal: messages.Positive


class RefuseMsg(_OfSession):
    """The proposal is not safe (NEG-3)."""

    proposal: messages.Positive


class CompleteMsg(_OfSession):
    """The prescriber has finished its maneuver (ACT-3)."""


class AbortMsg(_OfSession):
    """Break off (END-1)."""


def of_command(command: commands.Command) -> Input:
    """The message of a command.  Raises MessageError if a trajectory has no Autoware form."""
    match command:
        case commands.Request():
            planned = command.planned
            return RequestMsg(
                scenario=command.scenario,
                details=command.details,
                planned=NO_TRAJECTORY if planned is None else to_trajectory(planned, "planned"),
            )
        case commands.Prescribe():
            return PrescribeMsg(
                session=to_session(command.session),
                proposal=command.proposal,
                target=command.target,
                prescribed=to_trajectory(command.prescribed, "prescribed"),
                hold_ms=command.hold_ms,
                lease_ms=command.lease_ms,
            )
        case _:
            fields: dict[str, Any] = {"session": to_session(command.session)}
            if isinstance(command, commands.Accept | commands.Refuse):
                fields["proposal"] = command.proposal
            return read(INPUTS[IN + command.name], fields)


Input = (
    OdometryIn
    | PlanMsg
    | RequestMsg
    | CloseMsg
    | PrescribeMsg
    | ProceedMsg
    | AcceptMsg
    | RefuseMsg
    | CompleteMsg
    | AbortMsg
)
Output = (
    StateMsg | SurroundingsMsg | DriveMsg | ChoiceMsg | ProposalMsg | AdvertisedMsg | RefusedMsg
)
INPUTS: dict[str, type[Input]] = {c.topic: c for c in get_args(Input)}
OUTPUTS: dict[str, type[Output]] = {c.topic: c for c in get_args(Output)}

# -- the envelope

M = TypeVar("M", bound=Ros)


def publication(message: Input | Output) -> str:
    """The operation that publishes a message."""
    envelope = to_json({"op": "publish", "topic": message.topic, "type": message.type})
    return f'{envelope[:-1].decode()},"msg":{message.model_dump_json()}}}'


def addressed(fields: dict[str, Any], known: dict[str, Any]) -> Any:
    """The message of the topic that an operation names, of those known.  Raises MessageError."""
    topic, type_ = fields.get("topic"), fields.get("type")
    if not isinstance(topic, str) or topic not in known:
        raise messages.MessageError(
            messages.short("topic", f"must be one of {', '.join(known)}, not {topic!r}")
        )
    if type_ is not None and type_ != known[topic].type:
        raise messages.MessageError(
            messages.short("type", f"must be {known[topic].type} for {topic}")
        )
    return known[topic]


def operation(**fields: Any) -> str:
    """Another operation."""
    return to_json(fields).decode()


def opened(data: str | bytes, marks: int = MAX_MARKS) -> dict[str, Any]:
    """Parse a rosbridge operation.  Raises only MessageError."""
    if isinstance(data, bytes):
        raise messages.MessageError("message: must be JSON text, not a binary frame")
    if sum(map(data.count, ",[{")) > marks:
        raise messages.MessageError(f"message: more than {marks} commas and brackets")
    try:
        fields = from_json(data, allow_inf_nan=False, cache_strings=False)
    except ValueError as error:
        raise messages.MessageError(messages.short("message", f"not JSON: {error}")) from None
    if not isinstance(fields, dict):
        raise messages.MessageError("message: must be a JSON object")
    return fields


def read(model: type[M], msg: Any) -> M:
    """``msg`` as a message.  Raises MessageError, which names the first wrong field."""
    try:
        return model.model_validate(msg)
    except ValidationError as error:
        raise messages.refusal(error, "msg") from None
