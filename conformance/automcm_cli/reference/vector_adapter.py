"""The kernels of the reference, and its security, behind the test vectors (docs/vectors.md)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from automcm.kernels.collide import Approach, Collision, closest_approach, collision
from automcm.kernels.convert import convert
from automcm.kernels.discover import Candidate, discover
from automcm.kernels.extents import Extent, clearance, discs
from automcm.kernels.prescribe import prescribe
from automcm.kernels.thin import thin
from automcm.kernels.trajectory import Trajectory, TrajectoryError
from automcm.kernels.verify import Limits, verify
from automcm.service.clock_offsets import bounds, in_step
from automcm_cli.reference.keys_commands import claims
from automcm_simulation.radio import success
from automcm_spec.support.extras import MissingExtra
from automcm_spec.vocabulary.parameters import Parameters

Json = Any


def call(kernel: str, inputs: Json) -> Json:
    """The outputs of the kernel; ``{"error": {"name", "index"}}`` if it refuses the inputs.

    Raises NotImplementedError for signed messages without the extra ``automcm[secure]``.
    """
    try:
        return KERNELS[kernel](inputs)
    except TrajectoryError as error:
        index = {"index": int(error.index[0])} if error.index else {}
        return {"error": {"name": error.name, **index, "why": str(error)}}
    except MissingExtra as error:
        raise NotImplementedError(str(error)) from None


def _trajectory(given: Json) -> Trajectory:
    return Trajectory(given["t"], given["xy"], given.get("stopped", False))


def _json(trajectory: Trajectory) -> Json:
    return {
        "t": trajectory.t.tolist(),
        "xy": trajectory.xy.tolist(),
        "stopped": trajectory.stopped,
    }


def _convert(given: Json) -> Json:
    path = given["xy"], given["speed"], given["position"], given["t0"]
    return _json(convert(*path, v_eps=given["v_eps"]))


def _thin(given: Json) -> Json:
    overhead, per_point = given["size"]["overhead"], given["size"]["per_point"]
    whole = _trajectory(given)
    thinned = thin(
        whole,
        given["budget"],
        lambda trajectory: int(overhead + per_point * len(trajectory)),
        given["position"],
        given["speed"],
    )
    return {"kept": [n for n, t in enumerate(whole.t) if t in thinned.t]}


def _collide(given: Json) -> Json:
    a, b = _trajectory(given["a"]), _trajectory(given["b"])
    closest = closest_approach(a, b)
    found = collision(a, b, given["threshold"], clock_error=given["clock_error"])
    return {
        "approach": closest and {"distance": closest.distance, **_places(closest)},
        "collision": found and _places(found),
    }


def _extents(given: Json) -> Json:
    a, b = _trajectory(given["a"]), _trajectory(given["b"])
    one, other = Extent(**given["extent_a"]), Extent(**given["extent_b"])
    found = clearance(a, b, one, other, given["margin"])
    return {
        "error_a": discs(a, one).error,
        "error_b": discs(b, other).error,
        "clearance": found and {"time": found.time, "distance": found.distance},
        "since": found and found.since,
    }


def _places(found: Approach | Collision) -> Json:
    return {
        "time": found.time,
        "place_a": list(found.place_a),
        "place_b": list(found.place_b),
    }


def _discover(given: Json) -> Json:
    return {"target": discover([Candidate(**each) for each in given["candidates"]], given["zone"])}


def _prescribe(given: Json) -> Json:
    others = {name: given[name] for name in ("hold", "delta_v", "gain", "v_min")}
    return _json(prescribe(_trajectory(given["planned"]), given["start"], **others))


def _verify(given: Json) -> Json:
    trajectories = _trajectory(given["prescribed"]), _trajectory(given["planned"])
    others = (given[name] and _trajectory(given[name]) for name in ("leader", "follower"))
    reasons = verify(*trajectories, given["now"], Limits(**given["limits"]), *others)
    return {"reasons": sorted(map(str, reasons))}


def _success(given: Json) -> Json:
    n, loss = success.sendings(given["t_timeout"], given["t_resend"]), given["loss"]
    return {
        "sendings": n,
        "message": float(success.message(loss, n)),
        "exchange": float(success.exchange(loss, n)),
        "session": float(success.session(loss, n)),
    }


def _clock(given: Json) -> Json:
    try:
        found = bounds(given["cams"], given["now"], given["delay"], given["drift"])
    except ValueError as error:
        raise TrajectoryError("cams", str(error)) from None
    return {"least": found[0], "greatest": found[1], "in_step": in_step(found)}


def _certificate(given: Json) -> Json:
    """The claims of a certificate; an error if it is malformed."""
    from automcm.security import certificates
    from automcm.security.cose import Malformed

    try:
        read = certificates.read(bytes.fromhex(given["certificate"]))
        read.key()
    except Malformed as error:
        return {"error": {"name": "certificate", "why": str(error)}}
    return claims(read)


def _envelope(given: Json) -> Json:
    """The verdict on each datagram and on each list of revoked certificates."""
    from automcm.encoding.codec import JSON
    from automcm.security import cose
    from automcm.security.verifier import Verified, Verifier

    authorities = [cose.public_key(bytes.fromhex(point)) for point in given["authorities"]]
    verifier = Verifier(authorities, JSON, Parameters())
    own = bytes.fromhex(given["own"] or "")
    verdicts: list[str] = []
    accepted: dict[int, Verified] = {}
    for n, event in enumerate(given["events"]):
        if "revocations" in event:
            taken = verifier.revoke(bytes.fromhex(event["revocations"]))
            verdicts.append("list_taken" if taken else "list_ignored")
            continue
        verdicts.append("waiting")
        data = bytes.fromhex(event["envelope"])
        for verdict in verifier.receive(data, event["now"], str(n), own):
            of = int(verdict.datagram.tx or "")
            if isinstance(verdict, Verified):
                verdicts[of], accepted[of] = "accepted", verdict
            else:
                verdicts[of] = str(verdict.reason)
    answers = [accepted.get(n) for n in range(len(verdicts))]
    return {
        "verdicts": verdicts,
        "messages": [each and each.message.decode() for each in answers],
        "wanted": [each and each.wanted and each.wanted.hex() for each in answers],
    }


_KERNELS: tuple[Callable[[Json], Json], ...] = (
    *(_convert, _thin, _collide, _extents, _discover, _prescribe, _verify),
    *(_success, _clock, _certificate, _envelope),
)
KERNELS = {kernel.__name__[1:]: kernel for kernel in _KERNELS}
