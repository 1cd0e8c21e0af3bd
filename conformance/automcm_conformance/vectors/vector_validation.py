"""The form of a file of test vectors, for each kernel and for signed messages (docs/vectors.md)."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, TypeVar, Union

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, create_model

Inputs = TypeVar("Inputs")
Outputs = TypeVar("Outputs")


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


Number = Annotated[float, Field(allow_inf_nan=False)]
Place = Annotated[list[Number], Field(min_length=2, max_length=2)]
Text = Annotated[str, Field(min_length=1)]
Slug = Annotated[str, Field(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")]
Station = Annotated[int, Field(ge=1, le=2**32 - 1)]


class Trajectory(_Strict):
    """A trajectory with constant velocity between samples; ``stopped``: it stays at its end."""

    t: list[Number]
    xy: list[Place]
    stopped: bool = False


class ConvertInputs(_Strict):
    xy: list[Place]
    speed: list[Number]
    position: Place
    t0: Number
    v_eps: Number


class Size(_Strict):
    """The size in bytes of a message with n points is ``overhead + n * per_point``."""

    overhead: Annotated[int, Field(ge=0)]
    per_point: Annotated[int, Field(ge=1)]


class ThinInputs(Trajectory):
    """``position`` and ``speed``: the bounds."""

    budget: int
    position: Number
    speed: Number
    size: Size


class Thinned(_Strict):
    """``kept``: the indices of the fewest points; others are free.  ``at_most``: their number.

    ``position`` and ``speed``: the bounds that they keep; null if the budget may not allow them.
    """

    kept: list[int]
    at_most: int
    position: Number | None
    speed: Number | None


class CollideInputs(_Strict):
    a: Trajectory
    b: Trajectory
    threshold: Number
    clock_error: Number


class Approach(_Strict):
    time: Number
    distance: Number
    place_a: Place
    place_b: Place


class Since(_Strict):
    """The time at which the distance first falls below the threshold, and both places."""

    time: Number
    place_a: Place
    place_b: Place


class Collide(_Strict):
    """``approach`` is null if the two have no time in common."""

    approach: Approach | None
    collision: Since | None


class Extent(_Strict):
    length: Number
    width: Number


class ExtentsInputs(_Strict):
    a: Trajectory
    b: Trajectory
    extent_a: Extent
    extent_b: Extent
    margin: Number


class Clearance(_Strict):
    time: Number
    distance: Number


class Extents(_Strict):
    """``error_a``, ``error_b``: of the covers.  ``clearance`` is null without a common time,
    ``since`` if it never falls below the margin."""

    error_a: Number
    error_b: Number
    clearance: Clearance | None
    since: Number | None


class Candidate(_Strict):
    station_id: Station
    xy: Place
    direction: Place


class DiscoverInputs(_Strict):
    candidates: list[Candidate]
    zone: list[Place]


class Target(_Strict):
    target: Station | None


class PrescribeInputs(_Strict):
    planned: Trajectory
    start: Number
    hold: Number
    delta_v: Number
    gain: Number
    v_min: Number


class Motion(_Strict):
    """Places over time; the sample times are free, and so is the motion before and after."""

    t: list[Number]
    xy: list[Place]


class Limits(_Strict):
    """``acceleration`` and ``deceleration`` limit the mean change of speed over any interval of
    length ``reaction``, because prescribed trajectories change their speed in steps."""

    v_max: Number
    v_min: Number
    acceleration: Number
    deceleration: Number
    reaction: Number
    leader_gap: Number
    follower_gap: Number
    lateral: Number
    path: Number
    position_error: Number
    speed_error: Number
    start: Number
    age: Number


class VerifyInputs(_Strict):
    prescribed: Trajectory
    planned: Trajectory
    now: Number
    limits: Limits
    leader: Trajectory | None
    follower: Trajectory | None


class Reasons(_Strict):
    """All reasons, sorted; empty if the trajectory is safe."""

    reasons: list[
        Literal[
            "acceleration",
            "expired",
            "follower_gap",
            "lateral",
            "leader_gap",
            "path",
            "speed",
            "start",
        ]
    ]


class SuccessInputs(_Strict):
    t_timeout: int
    t_resend: int
    loss: Number


class Success(_Strict):
    sendings: int
    message: Number
    exchange: Number
    session: Number


class ClockInputs(_Strict):
    """``cams``: when each was generated and received, in order of reception."""

    cams: Annotated[
        list[Annotated[list[int], Field(min_length=2, max_length=2)]], Field(min_length=1)
    ]
    now: int
    delay: Annotated[int, Field(ge=0)]
    drift: Annotated[int, Field(ge=0, le=99)]


class Clock(_Strict):
    """The bounds on the offset, and whether it may be in step."""

    least: int
    greatest: int
    in_step: bool


Hex = Annotated[str, Field(pattern=r"^([0-9a-f]{2})*$")]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]


class CertificateInputs(_Strict):
    certificate: Hex


class Certificate(_Strict):
    """The claims of a certificate.  ``scenarios`` is null if it may advertise all."""

    ids: list[Station]
    not_before: int
    not_after: int
    roles: list[Literal["cam", "prescriber", "receiver"]]
    scenarios: list[str] | None
    station_type: int
    authority: Digest
    digest: Digest


class Received(_Strict):
    """A datagram, and the time in ms since 1970 at which it arrives."""

    now: int
    envelope: Hex


class ReceivedList(_Strict):
    """A list of revoked certificates."""

    revocations: Hex


class EnvelopeInputs(_Strict):
    """``authorities``: their public keys, as compressed points.  ``own``: the digest of the
    receiver's certificate.  ``events``: in the order of arrival."""

    authorities: list[Hex]
    own: Digest | None
    events: Annotated[list[Received | ReceivedList], Field(min_length=1)]


Verdict = Literal[
    "accepted",
    "waiting",
    "malformed",
    "stale",
    "early",
    "replayed",
    "unknown_signer",
    "unknown_authority",
    "certificate_expired",
    "certificate_not_yet",
    "revoked",
    "bad_signature",
    "wrong_source",
    "not_permitted",
    "list_taken",
    "list_ignored",
]


class Envelope(_Strict):
    """For each event the verdict after all events, the message if it is accepted, and the digest of
    the certificate that its sender asks for."""

    verdicts: list[Verdict]
    messages: list[Text | None]
    wanted: list[Digest | None]


class Wrong(_Strict):
    """The name of the invalid input and its first invalid index; ``why`` is not compared."""

    name: Text
    index: Annotated[int, Field(ge=0)] | None = None
    why: Text


class Refusal(_Strict):
    error: Wrong


class Vector(_Strict, Generic[Inputs, Outputs]):
    id: Slug
    purpose: Text
    bug: Slug
    inputs: Inputs
    expected: Outputs | Refusal


class File(_Strict, Generic[Inputs, Outputs]):
    """All vectors of a kernel.  ``tolerance`` is absolute, for each field of ``expected``; fields
    without a tolerance must be equal."""

    schema_: Literal["automcm.vectors/1"] = Field(alias="schema")
    units: dict[Text, Text]
    tolerance: dict[Text, Annotated[float, Field(ge=0, allow_inf_nan=False)]]
    bugs: dict[Slug, Text]
    vectors: list[Vector[Inputs, Outputs]]


def _file(kernel: str, rule: str, inputs: Any, outputs: Any) -> Any:
    """The files of a kernel."""
    literals: Any = {"kernel": (Literal[kernel], ...), "rule": (Literal[rule], ...)}
    base = File[inputs, outputs]
    return create_model(f"{kernel.capitalize()}File", __base__=base, **literals)


_FILES = (
    _file("convert", "KIN-1", ConvertInputs, Trajectory),
    _file("thin", "KIN-2", ThinInputs, Thinned),
    _file("collide", "KIN-3", CollideInputs, Collide),
    _file("extents", "KIN-3", ExtentsInputs, Extents),
    _file("discover", "KIN-4", DiscoverInputs, Target),
    _file("prescribe", "KIN-5", PrescribeInputs, Motion),
    _file("verify", "KIN-6", VerifyInputs, Reasons),
    _file("success", "KIN-7", SuccessInputs, Success),
    _file("clock", "APP-6", ClockInputs, Clock),
    _file("certificate", "secured", CertificateInputs, Certificate),
    _file("envelope", "secured", EnvelopeInputs, Envelope),
)
_ANY: Any = Union[_FILES]  # noqa: UP007
FILE: TypeAdapter[Any] = TypeAdapter(Annotated[_ANY, Field(discriminator="kernel")])
