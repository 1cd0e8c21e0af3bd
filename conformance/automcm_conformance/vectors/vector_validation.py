"""The form of a file of test vectors, for each kernel (docs/vectors.md)."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

Inputs = TypeVar("Inputs")
Outputs = TypeVar("Outputs")


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


Number = Annotated[float, Field(allow_inf_nan=False)]
Place = Annotated[list[Number], Field(min_length=2, max_length=2)]
Text = Annotated[str, Field(min_length=1)]
Slug = Annotated[str, Field(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")]
Station = Annotated[int, Field(ge=1, le=2**32 - 1)]


class Drive(_Strict):
    """A trajectory: straight and even between its samples; ``stopped``: stays where it ends."""

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
    """Bytes of a message with n points: ``overhead + n * per_point``."""

    overhead: Annotated[int, Field(ge=0)]
    per_point: Annotated[int, Field(ge=1)]


class ThinInputs(Drive):
    budget: int
    every: int
    size: Size


class Kept(_Strict):
    """The indices of the points that stay: the rule says which."""

    kept: list[int]


class Fits(_Strict):
    """The budget binds: at most so many points, these among them; the others are free."""

    includes: list[int]
    at_most: int


class CollideInputs(_Strict):
    a: Drive
    b: Drive
    threshold: Number
    clock_error: Number


class Approach(_Strict):
    time: Number
    distance: Number
    place_a: Place
    place_b: Place


class Since(_Strict):
    """When the distance first falls below the threshold, and where both are then."""

    time: Number
    place_a: Place
    place_b: Place


class Collide(_Strict):
    """``approach`` is null if the two have no time in common."""

    approach: Approach | None
    collision: Since | None


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
    planned: Drive
    start: Number
    hold: Number
    delta_v: Number
    gain: Number
    v_min: Number


class Motion(_Strict):
    """Places over time; where the samples are is free, and so is what comes before and after."""

    t: list[Number]
    xy: list[Place]


class Limits(_Strict):
    """``acceleration`` and ``deceleration`` bound the mean change of speed over any time of
    ``reaction``: what is prescribed changes its speed in steps."""

    v_max: Number
    v_min: Number
    acceleration: Number
    deceleration: Number
    reaction: Number
    leader_gap: Number
    follower_gap: Number
    path: Number
    start: Number
    age: Number


class VerifyInputs(_Strict):
    prescribed: Drive
    planned: Drive
    now: Number
    limits: Limits
    leader: Drive | None
    follower: Drive | None


class Reasons(_Strict):
    """All of them, sorted; none: it is safe."""

    reasons: list[
        Literal["acceleration", "expired", "follower_gap", "leader_gap", "path", "speed", "start"]
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


class Wrong(_Strict):
    """Which input is wrong, and the first index that is; ``why`` is for the reader."""

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
    """All vectors of a kernel.  ``tolerance`` is absolute, for each field of ``expected``; where
    there is none the values must be equal."""

    schema_: Literal["automcm.vectors/1"] = Field(alias="schema")
    units: dict[Text, Text]
    tolerance: dict[Text, Annotated[float, Field(ge=0, allow_inf_nan=False)]]
    bugs: dict[Slug, Text]
    vectors: list[Vector[Inputs, Outputs]]


class ConvertFile(File[ConvertInputs, Drive]):
    kernel: Literal["convert"]
    rule: Literal["KIN-1"]


class ThinFile(File[ThinInputs, Kept | Fits]):
    kernel: Literal["thin"]
    rule: Literal["KIN-2"]


class CollideFile(File[CollideInputs, Collide]):
    kernel: Literal["collide"]
    rule: Literal["KIN-3"]


class DiscoverFile(File[DiscoverInputs, Target]):
    kernel: Literal["discover"]
    rule: Literal["KIN-4"]


class PrescribeFile(File[PrescribeInputs, Motion]):
    kernel: Literal["prescribe"]
    rule: Literal["KIN-5"]


class VerifyFile(File[VerifyInputs, Reasons]):
    kernel: Literal["verify"]
    rule: Literal["KIN-6"]


class SuccessFile(File[SuccessInputs, Success]):
    kernel: Literal["success"]
    rule: Literal["KIN-7"]


FILE: TypeAdapter[Any] = TypeAdapter(
    Annotated[
        ConvertFile
        | ThinFile
        | CollideFile
        | DiscoverFile
        | PrescribeFile
        | VerifyFile
        | SuccessFile,
        Field(discriminator="kernel"),
    ]
)
