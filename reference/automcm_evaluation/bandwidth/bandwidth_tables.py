"""The summary of the cells of the bandwidth experiment."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean as mean

from automcm.applications.lane_change import Plan
from automcm.applications.vehicle import ROAD_M
from automcm.links.simulated_radio import Channel
from automcm_evaluation.bandwidth.bandwidth_air import (
    BIN_MS,
    CODECS,
    FORMS,
    GAP_M,
    POINTS,
    RATE_HZ,
    SPEED_KMH,
)
from automcm_evaluation.framework.experiment import Cell, Values, captions, chosen
from automcm_evaluation.framework.intervals import wilson
from automcm_simulation.radio.propagation import HEADER_BYTES, HEADERS
from automcm_spec.vocabulary.parameters import Parameters

COLOURS = captions("bandwidth", "colours")
"""In the order in which they are stacked."""
ALWAYS = "always-on"
CASES = captions("bandwidth", "cases")


KINDS = ("Prescription", "Acceptance", "Fin", "Intention")
SAME = 0.05
"""Amounts that differ by less than this share count as equal."""
CARRYING = ("Advertisement", "Intention", "Prescription", "Acceptance")
"""The messages with a trajectory."""
MARKED = "CAM in a session"
"""Inside of a session, this CAM names it (ACT-5); the paper's CAM does not."""
ETSI_CAM = 41
"""Bytes of an ETSI CAM in UPER, with the basic and the high-frequency container alone: encoded by
pycrate, an independent encoder (reference/tests/foreign_cam.py)."""
DIGEST, CERTIFICATE = 93, 235
"""Bytes that a signature adds to a message of less than 128 bytes (two more above), with the digest
of its sender's certificate and with the certificate: IEEE 1609.2 as profiled by ETSI TS 103 097,
ECDSA on NIST P-256, an explicit certificate with two application permissions; encoded by pycrate
(reference/tests/foreign_signature.py)."""
RARE_HZ = 1
"""A lower rate of always-on trajectories."""
RIVALS = {
    "factor": f"{RATE_HZ} Hz",
    "rare": f"{RARE_HZ} Hz",
    "signed": f"{RATE_HZ} Hz, signed",
    "rare_signed": f"{RARE_HZ} Hz, signed",
}
"""The forms of the always-on alternative: at two rates, and with all messages of both sides
signed."""
CHANNEL_BIT_S = 6_000_000
SPARSE_CAM_MS = 500
"""Between CAMs in drives with many vehicles, to save time; their bytes are counted at RATE_HZ."""


def summary(cells: Sequence[Cell]) -> Values:
    """The data of tables, figures and claims; amounts in bytes, times in s."""
    (sized,) = (cell.result for cell in chosen(cells, part="sizes"))
    drives = chosen(cells, part="drive")
    pairs = dict.fromkeys((cell.values["vehicles"], cell.values["loss"]) for cell in drives)
    planned = next(cell.result["planned"] for cell in drives if "planned" in cell.result)
    return {
        "sizes": sized,
        "ratios": {
            name: {kind: round(sized[kind][name] / sized["CAM"][name], 2) for kind in CARRYING}
            for name in CODECS
        },
        "etsi": {
            "cam": ETSI_CAM,
            "ratio": round(sized["Intention"]["uper"] / ETSI_CAM, 2),
            "needed_per_point": round(10 * ETSI_CAM / POINTS, 2),
            "here_per_point": round(sized["Intention"]["uper"] / POINTS, 2),
        },
        "headers": HEADERS,
        "signature": {"digest": DIGEST, "certificate": CERTIFICATE},
        "channel_bit_s": CHANNEL_BIT_S,
        "points": {"paper": POINTS} | planned,
        "model": _model(),
        "drives": [
            _drives(vehicles, loss, chosen(drives, vehicles=vehicles, loss=loss))
            for vehicles, loss in pairs
        ],
        "time": {
            str(cell.values["vehicles"]): cell.result["time"]
            for cell in drives
            if "time" in cell.result
        },
        "bin_ms": BIN_MS,
        "many": [_many(cell) for cell in chosen(cells, part="many")],
        "series": [
            _event(each)
            | {
                "finished": each["finished"],
                "vehicles": cell.result["vehicles"],
                "intentions": each["count"].get("Intention", 0),
                "always": each["always"]["sent"],
            }
            for cell in chosen(cells, part="series")
            for each in cell.result["sessions"]
        ],
    }


def _model() -> Values:
    """The parameters of the drives."""
    parameters, plan, (low, high) = Parameters(), Plan(), Channel().delay_ms
    return {
        "speed_kmh": SPEED_KMH,
        "gap_m": GAP_M,
        "rate_hz": RATE_HZ,
        "sparse_hz": 1000 / SPARSE_CAM_MS,
        "t_resend_s": parameters.t_resend / 1000,
        "t_timeout_s": parameters.t_timeout / 1000,
        "delay_ms": [low, high],
        "delta_v_kmh": round(plan.delta_v * 3.6, 3),
        "gain_m": plan.gain_m,
        "ahead_m": ROAD_M,
    }


def drive(summary: Values, vehicles: int, lossy: bool = False) -> Values:
    """The drives with this number of vehicles, with or without loss."""
    (found,) = (
        d for d in summary["drives"] if d["vehicles"] == vehicles and (d["loss"] > 0) == lossy
    )
    return dict(found)


def _event(session: Values, form: str = "sent") -> Values:
    """Bytes of all messages of a session in each codec."""
    return {name: sum(session["bytes"][form][name].values()) for name in CODECS}


def _drives(vehicles: int, loss: float, cells: Sequence[Cell]) -> Values:
    """The means of all drives of one kind, and the saving by event-driven messages."""
    sessions = [session for cell in cells for session in cell.result["sessions"]]
    finished = sum(session["finished"] for session in sessions)
    kinds = sorted({kind for session in sessions for kind in session["count"]})
    seconds = _mean([session["ms"] / 1000 for session in sessions])
    event = {form: _means([_event(session, form) for session in sessions]) for form in FORMS}
    always = {form: _means([s["always"][form] for s in sessions]) for form in FORMS[:2]}
    always[FORMS[2]] = always[FORMS[1]]
    cams = _means([session["cams"] for session in sessions])
    signatures = _mean([_signatures(session) for session in sessions])
    sent = [_event(session) for session in sessions]
    return {
        "vehicles": vehicles,
        "loss": loss,
        "trials": len(sessions),
        "finished": finished,
        "interval": [round(bound, 4) for bound in wilson(finished, len(sessions))],
        "s": seconds,
        "cancelled": sorted({n for session in sessions for n in session["cancelled"]}),
        "count": {
            kind: _mean([session["count"].get(kind, 0) for session in sessions]) for kind in kinds
        },
        "bytes": {
            name: {
                kind: _mean([s["bytes"]["sent"][name].get(kind, 0) for s in sessions])
                for kind in kinds
            }
            for name in CODECS
        },
        "by_station": {
            str(n): _means(
                [s["by_station"].get(str(n), dict.fromkeys(CODECS, 0)) for s in sessions]
            )
            for n in range(1, vehicles + 1)
        },
        "cam_size": {
            name: _mean([s["cams"][name] / s["cams"]["count"] for s in sessions]) for name in CODECS
        },
        "always_size": {
            name: round(always["sent"][name] / (RATE_HZ * seconds * vehicles), 3) for name in CODECS
        },
        "event": event,
        "range": {name: [f(each[name] for each in sent) for f in (min, max)] for name in CODECS},
        "always": always,
        "cams": cams,
        "signatures": signatures,
        "saving": {
            form: {
                name: _times(event[form][name], signatures, always[form][name], seconds * vehicles)
                | {
                    "with_cams": round(
                        (always[form][name] + cams[name]) / (event[form][name] + cams[name]), 2
                    ),
                    "break_even_per_min": round(
                        60 / seconds * always[form][name] / event[form][name], 1
                    ),
                }
                for name in CODECS
            }
            for form in FORMS
        },
    }


def _signatures(session: Values) -> int:
    """Bytes of the signatures of a session's messages."""
    messages, certificates = sum(session["count"].values()), session["certificates"]
    return int(DIGEST * (messages - certificates) + CERTIFICATE * certificates)


def _times(event: float, signatures: float, always: float, vehicle_s: float) -> Values:
    """RIVALS: bytes of the always-on alternative, by those of event-driven messages.

    ``always`` is at RATE_HZ without signatures; ``vehicle_s``: seconds times vehicles.  Each
    vehicle sends its certificate once a second (CERTIFICATE_MS).
    """
    found = {}
    for rate, names in ((RATE_HZ, ("factor", "signed")), (RARE_HZ, ("rare", "rare_signed"))):
        plain = always * rate / RATE_HZ
        signed = plain + vehicle_s * (CERTIFICATE + DIGEST * (rate - 1))
        for name, ratio in zip(names, (plain / event, signed / (event + signatures)), strict=True):
            found[name] = round(ratio, 2)
    return found


def _many(cell: Cell) -> Values:
    """Bytes per second and the share of the channel, always including CAMs at RATE_HZ."""
    session, vehicles = cell.result["session"], cell.values["vehicles"]
    seconds, busiest, cams = session["ms"] / 1000, session["busiest"], session["cams"]
    per_s, periodic = 1000 / BIN_MS, vehicles * RATE_HZ
    messages, event = sum(session["count"].values()), _event(session)
    frames = {
        "cams": periodic,
        "minute": periodic + messages / 60,
        "maneuver": periodic + messages / seconds,
        "busiest": periodic + busiest["count"] * per_s,
        "always": 2 * periodic,
    }
    rates = {}
    for name in CODECS:
        basic = periodic * cams[name] / cams["count"]
        rates[name] = {
            "cams": basic,
            "minute": basic + event[name] / 60,
            "maneuver": basic + event[name] / seconds,
            "busiest": basic + busiest[name] * per_s,
            "always": basic + session["always"]["sent"][name] / seconds,
        }
    return {
        "vehicles": vehicles,
        "participants": cell.values["participants"],
        "intentions": session["count"].get("Intention", 0),
        "event": event,
        "factor": {
            name: round(session["always"]["sent"][name] / event[name], 1) for name in CODECS
        },
        "channel": {
            name: {
                case: round((rate + HEADER_BYTES * frames[case]) * 8 / CHANNEL_BIT_S, 5)
                for case, rate in rates[name].items()
            }
            for name in CODECS
        },
    }


def _mean(values: Sequence[float]) -> float:
    return round(mean(values), 3)


def _means(values: Sequence[Values]) -> Values:
    return {name: _mean([each[name] for each in values]) for name in CODECS}


# -- what the page and the claims use


def names(report: Values) -> Values:
    """The drives with ``two`` and ``four`` vehicles; ``ratios``: four to two by kind of message;
    ``savings``: over two and four vehicles and both codecs, by form; ``crowded``: with the usual
    number of participants and with more, where there are more receivers than that."""
    s = report["summary"]
    two, four = drive(s, 2), drive(s, 4)
    many = {(each["vehicles"], each["participants"]): each for each in s["many"]}
    usual = min(participants for _, participants in many)
    savings = {
        form: [of["saving"][form][name] for of in (two, four) for name in CODECS]
        for form in FORMS[:2]
    }
    takes = [
        of["bytes"][name]["Advertisement"] / of["event"]["sent"][name]
        for of in (two, four)
        for name in CODECS
    ]
    sent: dict[str, dict[str, float]] = {}
    for name in CODECS:
        sizes = {k: four["bytes"][name].get(k, 0) / n for k, n in four["count"].items() if n}
        sent[name] = dict.fromkeys(COLOURS, 0.0) | sizes | {"CAM": four["cam_size"][name]}
    factors = [of[rival] for each in savings.values() for of in each for rival in RIVALS]
    carried = [ratio for of in s["ratios"].values() for ratio in of.values()]
    return {
        "headers": sum(s["headers"].values()),
        "two": two,
        "four": four,
        "lossy": drive(s, 4, lossy=True),
        "both_lossy": [(of, drive(s, of["vehicles"], lossy=True)) for of in (two, four)],
        "sent": sent,
        "least": min(s["etsi"]["ratio"], *carried),
        "counts": {kind: _ratio(two["count"], four["count"], kind) for kind in KINDS},
        "amounts": {
            kind: [_ratio(two["bytes"][n], four["bytes"][n], kind) for n in CODECS]
            for kind in KINDS
        },
        "savings": savings,
        "factors": factors,
        "takes": max(takes),
        "largest": many[max(n for n, participants in many if participants == usual), usual],
        "usual": usual,
        "crowded": [(many[n, usual], many[n, p]) for n, p in sorted(many) if p > usual],
    }


def _ratio(two: Values, four: Values, kind: str) -> float:
    """The ratio of amounts of one kind; 0 if there is none with two vehicles."""
    return float(four.get(kind, 0) / two[kind]) if two.get(kind) else 0.0
