"""The messages in UPER, the unaligned packed encoding rules of ASN.1 (docs/messages.md).

``AutoMCM.asn`` beside this module is the schema.  The encoding is canonical: ``decode`` refuses any
other encoding than that of ``encode``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args

import asn1tools  # type: ignore[import-untyped]
from pydantic import TypeAdapter, ValidationError
from pydantic_core import to_json

from automcm.encoding.codec import bounded
from automcm_spec.vocabulary.messages import (
    BROADCAST,
    Acceptance,
    Ack,
    Advertisement,
    Cam,
    Cancel,
    CancelReason,
    Details,
    Intention,
    Message,
    MessageError,
    MessageType,
    Prescription,
    RefusalReason,
    Session,
    Trajectory,
    from_dict,
    refusal,
    short,
)

SCHEMA = Path(__file__).with_name("AutoMCM.asn")
MAX_POINTS = 16_384

_BODIES = {type_.lower(): type_ for type_ in (*get_args(MessageType), "CAM")}
_REASONS = {
    reason.replace("_", "-"): reason
    for reason in (*get_args(RefusalReason), *get_args(CancelReason))
}
_ENUMERATED = {text: name for name, text in (_BODIES | _REASONS).items()}
_EXTRAS = ("length_mm", "width_mm", "station_type", "sigma_mm")
_DETAILS: TypeAdapter[dict[str, Any]] = TypeAdapter(Details)


@cache
def _types() -> Any:
    return asn1tools.compile_files(str(SCHEMA), "uper").types


@dataclass(frozen=True, slots=True)
class _Uper:
    name: str = "uper"

    def encode(self, message: Message | Cam) -> bytes:
        body = (_ENUMERATED[message.type], _body(message))
        packet = bytes(_types()["Packet"].encode({"v": message.v, "body": body}))
        return bounded(packet + _extras(message))

    def decode(self, data: bytes) -> Message | Cam:
        fields = _fields(_decoded("Packet", bounded(data)))
        message = from_dict(fields)
        encoded = self.encode(message)
        if len(encoded) < len(data) and data.startswith(encoded):
            extras = _decoded("Extras", data[len(encoded) :]).items()
            fields |= {name.replace("-", "_"): value[1] for name, value in extras}
            message = from_dict(fields)
            encoded = self.encode(message)
        if encoded != data:
            raise MessageError("message: not the canonical encoding of its content")
        return message


UPER = _Uper()


def _decoded(type_: str, data: bytes) -> dict[str, Any]:
    """The values of the type at the beginning of ``data``.  Raises MessageError."""
    try:
        values: dict[str, Any] = _types()[type_].decode(data)
    except asn1tools.DecodeError as error:
        raise _malformed(error) from None
    except UnicodeDecodeError:
        raise MessageError("Advertisement: scenario or details is not UTF-8") from None
    return values


def _malformed(error: Any) -> MessageError:
    names = [part.name.replace("-", "_") for part in reversed(error.location) if part.name]
    names = [_BODIES.get(name, name) for name in names if name not in ("Packet", "body", "header")]
    return MessageError(short(".".join(names) or "message", error.message))


def _extras(message: Message | Cam) -> bytes:
    values = {name: getattr(message, name, None) for name in _EXTRAS}
    given = {n.replace("_", "-"): _natural(v) for n, v in values.items() if v is not None}
    return bytes(_types()["Extras"].encode(given)) if given else b""


def _body(message: Message | Cam) -> dict[str, Any]:
    if isinstance(message, Cam):
        return {
            "src": message.src,
            "generation-ms": _natural(message.generation_ms),
            "x-mm": _whole(message.x_mm),
            "y-mm": _whole(message.y_mm),
            "heading-mrad": _whole(message.heading_mrad),
            "speed-mm-s": _whole(message.speed_mm_s),
            "marks": [_session(mark) for mark in message.marks],
        }
    header: dict[str, Any] = {"src": message.src, "session": _session(message.session)}
    if message.dst != BROADCAST:
        header["dst"] = message.dst
    if isinstance(message, Ack):
        of = {"type": _ENUMERATED[message.of.type], "seq": _natural(message.of.seq)}
        return {"header": header, "of": of}
    body: dict[str, Any] = {"header": header, "seq": _natural(message.seq)}
    match message:
        case Advertisement():
            body["scenario"] = message.scenario
            body["details"] = to_json(message.details).decode()
            if message.planned is not None:
                body["planned"] = _trajectory(message.planned, "Advertisement.planned")
        case Intention():
            body["planned"] = _trajectory(message.planned, "Intention.planned")
        case Prescription():
            body["proposal"] = _natural(message.proposal)
            body["prescribed"] = _trajectory(message.prescribed, "Prescription.prescribed")
            body["hold-ms"] = _natural(message.hold_ms)
            body["lease-ms"] = _natural(message.lease_ms)
        case Acceptance():
            body["proposal"] = _natural(message.proposal)
            if message.selected is not None:
                selected = _trajectory(message.selected, "Acceptance.selected")
                body["answer"] = ("selected", selected)
            else:
                body["answer"] = ("reason", _ENUMERATED[str(message.reason)])
        case Cancel():
            body["reason"] = _ENUMERATED[message.reason]
    return body


def _session(session: Session) -> dict[str, Any]:
    return {"prescriber": session[0], "number": _natural(session[1])}


def _natural(n: int) -> tuple[str, int]:
    bits = n.bit_length()
    return ("n8" if bits <= 8 else "n16" if bits <= 16 else "n32" if bits <= 32 else "n53"), n


def _whole(n: int) -> tuple[str, int]:
    bits = (n if n >= 0 else ~n).bit_length() + 1
    return ("w8" if bits <= 8 else "w16" if bits <= 16 else "w32" if bits <= 32 else "w54"), n


def _point(point: tuple[int, int, int]) -> dict[str, Any]:
    return {"dt": _whole(point[0]), "x": _whole(point[1]), "y": _whole(point[2])}


def _trajectory(trajectory: Trajectory, place: str) -> dict[str, Any]:
    points = trajectory.points
    if len(points) > MAX_POINTS:
        raise MessageError(f"{place}.points: {len(points)} points, more than {MAX_POINTS}")
    rest: list[tuple[str, Any]] = []
    t, x, y = points[0]
    for point in points[1:]:
        dt, dx, dy = point[0] - t, point[1] - x, point[2] - y
        if 0 <= dt < 2048 and -8192 <= dx < 8192 and -8192 <= dy < 8192:
            rest.append(("step", {"dt": dt, "dx": dx, "dy": dy}))
        else:
            rest.append(("point", _point(point)))
        t, x, y = point
    return {"t0": _whole(trajectory.t0), "first": _point(points[0]), "rest": rest}


def _fields(packet: dict[str, Any]) -> dict[str, Any]:
    """The fields of a decoded packet in the form that the models expect."""
    kind, body = packet["body"]
    fields: dict[str, Any] = {"v": packet["v"], "type": _BODIES[kind]}
    for name, value in body.items():
        field = name.replace("-", "_")
        match name:
            case "header":
                fields |= value
                fields["session"] = _read_session(value["session"])
            case "scenario" | "src":
                fields[field] = value
            case "details":
                fields[field] = _read_details(value)
            case "planned" | "prescribed":
                fields[field] = _read_trajectory(value)
            case "answer":
                chosen, content = value
                fields["accepted"] = chosen == "selected"
                is_yes = fields["accepted"]
                fields[chosen] = _read_trajectory(content) if is_yes else _REASONS[content]
            case "reason":
                fields[field] = _REASONS[value]
            case "of":
                fields["seq"] = 0
                fields[field] = {"type": _BODIES[value["type"]], "seq": value["seq"][1]}
            case "marks":
                fields[field] = tuple(_read_session(mark) for mark in value)
            case _:
                fields[field] = value[1]
    return fields


def _read_session(value: dict[str, Any]) -> tuple[int, int]:
    return value["prescriber"], value["number"][1]


def _read_details(text: str) -> dict[str, Any]:
    try:
        return _DETAILS.validate_json(text)
    except ValidationError as error:
        raise refusal(error, "Advertisement.details") from None


def _read_trajectory(value: dict[str, Any]) -> dict[str, Any]:
    first = value["first"]
    point = (first["dt"][1], first["x"][1], first["y"][1])
    points = [point]
    for kind, step in value["rest"]:
        if kind == "step":
            point = (point[0] + step["dt"], point[1] + step["dx"], point[2] + step["dy"])
        else:
            point = (step["dt"][1], step["x"][1], step["y"][1])
        points.append(point)
    return {"t0": value["t0"][1], "points": tuple(points)}
