"""Records the messages of a drive by time, sender and size in both encodings.

It also records the always-on alternative: each vehicle sends its planned trajectory at 10 Hz as an
Intention to all.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from automcm.applications.lane_change import PaperLaneChange
from automcm.applications.planning import intention
from automcm.applications.vehicle import Vehicle
from automcm.encoding.codec import JSON, CodecError, codec
from automcm.links.simulated_radio import Channel
from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_evaluation.framework.experiment import ExperimentError, Values
from automcm_simulation.road.drive import SimulatedDrive
from automcm_spec.vocabulary.messages import Cam, Cancel, Intention, Message, Session, Trajectory
from automcm_spec.vocabulary.parameters import Parameters

SPEED_KMH, GAP_M, BESIDE_M = 30.0, 22.0, 3.0
"""As in ``FourVehicles``."""
SIGNAL_MS, MANEUVER_MS = 1000, 15_000
"""The time of the first turn signal; the time between two, and from the last to the end."""
BIN_MS, OFFER_MS = 500, 1000
"""The width of a bar over time; the interval of measuring the always-on trajectories."""
CERTIFICATE_MS = 1000
"""A signed message has its sender's certificate this long after the last one that had it, and else
its digest, as a CAM in ETSI TS 103 097."""
RATE_HZ = 10
"""The rate of CAMs and of always-on trajectories, as in the paper (VI-A)."""
POINTS = 52
"""The paper's trajectory as we read it: 260 m, a point each metre, thinned to a fifth."""
CODECS = ("json", "uper")
FORMS = ("sent", "52 points", "52 points, lean")
"""A message as it was sent; with the paper's number of points in each trajectory; and the same,
but no trajectory in an Advertisement, which may go without (section 2 of docs/protocol.md)."""

_FIRST_ID, _EPOCH_MS = 3_000_000_000, 1_800_000_000_000


MessageBytes = dict[str, int]
"""The bytes of one or more messages by codec."""


@dataclass(frozen=True, slots=True)
class Sent:
    """One sent message.  ``prescriber`` is that of its session, 0 for a CAM."""

    ms: int
    src: int
    type: str
    prescriber: int
    forms: dict[str, MessageBytes]
    cancelled: int = 0
    """The addressee of a Cancel."""


@dataclass
class RecordingCodec:
    """The JSON codec with a record of encoded messages.  ``now`` must be set before."""

    now: Callable[[], int] = lambda: 0
    sent: list[Sent] = field(default_factory=list)
    name: str = "json"
    _known: dict[bytes, dict[str, MessageBytes]] = field(default_factory=dict)

    def encode(self, message: Message | Cam) -> bytes:
        """Encode as JSON and record the size."""
        data = JSON.encode(message)
        if data not in self._known:  # copies are equal byte for byte
            self._known[data] = in_forms(message)
        prescriber = 0 if isinstance(message, Cam) else message.session[0]
        cancelled = message.dst if isinstance(message, Cancel) else 0
        about = message.src, message.type, prescriber, self._known[data], cancelled
        self.sent.append(Sent(self.now(), *about))
        return data

    def decode(self, data: bytes) -> Message | Cam:
        """From JSON."""
        return JSON.decode(data)


def on_air(message: Message | Cam, points: int = 0, lean: bool = False) -> Message | Cam:
    """The message with ids of ten digits and times since 1970, as on a road, because small ids and
    times of a simulation have short encodings.  A CAM loses its optional fields: the
    experiment counts CAMs without them.

    ``points``: replace its trajectory, if it has one, by one with this many points.
    ``lean``: remove the trajectory of an Advertisement.
    """

    def named(session: Session) -> Session:
        return _FIRST_ID + session[0], session[1]

    changed: Values = {"src": _FIRST_ID + message.src}
    if isinstance(message, Cam):
        changed["generation_ms"] = _EPOCH_MS + message.generation_ms
        changed["marks"] = tuple(map(named, message.marks))
        changed |= dict.fromkeys(("length_mm", "width_mm", "station_type", "sigma_mm"))
        return message.model_copy(update=changed)
    changed["session"] = named(message.session)
    if message.dst:
        changed["dst"] = _FIRST_ID + message.dst
    for name in ("planned", "prescribed", "selected"):
        own: Trajectory | None = getattr(message, name, None)
        if own is None:
            continue
        if lean and message.type == "Advertisement":
            changed[name] = None
        elif points:
            changed[name] = sizes.trajectory(points)
        else:
            changed[name] = Trajectory(t0=_EPOCH_MS + own.t0, points=own.points)
    return message.model_copy(update=changed)


def measured(message: Message | Cam) -> MessageBytes:
    """Its size.  Raises ExperimentError if the extra ``automcm[asn1]`` is not installed."""
    try:
        return {name: len(codec(name).encode(message)) for name in CODECS}
    except CodecError as error:
        raise ExperimentError(f"bandwidth: {error}") from None


def in_forms(message: Message | Cam) -> dict[str, MessageBytes]:
    """Its size in each of FORMS."""
    if isinstance(message, Cam):
        return dict.fromkeys(FORMS, measured(on_air(message)))
    made = (on_air(message), on_air(message, POINTS), on_air(message, POINTS, lean=True))
    return {name: measured(form) for name, form in zip(FORMS, made, strict=True)}


def offered(src: int, planned: Trajectory) -> Intention:
    """The message of an always-on vehicle: an Intention to all."""
    return Intention(src=src, session=(src, 1), seq=1, planned=planned)


def column(receivers: int, beside: Sequence[int], gap_m: float = GAP_M) -> list[PaperLaneChange]:
    """Prescribers, each just ahead of one of the receivers, which drive in a row in the other lane.

    ``beside`` has the place of that receiver in the row for each prescriber, counted from the
    front.  Ids go from 1, prescribers first.  ``column(3, [1])`` is the paper's Fig. 6.
    """
    speed = SPEED_KMH / 3.6
    row = [-BESIDE_M - gap_m * (place - beside[0]) for place in range(receivers)]
    first = len(beside) + 1
    prescribers = [
        Vehicle(n, row[place] + BESIDE_M, 0, speed, speed) for n, place in enumerate(beside, 1)
    ]
    others = [Vehicle(first + place, x, 1, speed, speed) for place, x in enumerate(row)]
    return [PaperLaneChange(vehicle) for vehicle in (*prescribers, *others)]


@dataclass
class Recorded:
    """A drive with its sent messages and those of the always-on alternative."""

    drive: SimulatedDrive
    air: RecordingCodec
    vehicles: int
    offers: list[Sent] = field(default_factory=list)
    """One for each vehicle and OFFER_MS; it stands for all of that time."""
    planned: Trajectory | None = None
    """The last one offered."""


def record(
    receivers: int,
    beside: Sequence[int],
    *,
    seed: int,
    gap_m: float = GAP_M,
    loss: float = 0.0,
    parameters: Parameters | None = None,
) -> Recorded:
    """A drive in which the prescribers change lanes one after another."""
    drivers, air = column(receivers, beside, gap_m), RecordingCodec()
    drive = SimulatedDrive(
        drivers, seed=seed, channel=Channel(loss=loss), parameters=parameters, codec=air
    )
    recorded = Recorded(drive, air, len(drivers))
    clock = drive.simulation.clock
    air.now = clock.now
    end = SIGNAL_MS + MANEUVER_MS * len(beside)

    def offer() -> None:
        for driver in drivers:
            src = driver.vehicle.station_id
            recorded.planned = intention(driver.vehicle, clock.now())
            forms = in_forms(offered(src, recorded.planned))
            recorded.offers.append(Sent(clock.now(), src, "always-on", 0, forms))

    for n in range(len(beside)):
        clock.at(SIGNAL_MS + n * MANEUVER_MS, partial(drivers[n].signal, 1))
    for ms in range(0, end, OFFER_MS):
        clock.at(ms, offer)
    drive.run(end / 1000)
    return recorded


def session(recorded: Recorded, prescriber: int) -> Values:
    """The bytes of this prescriber's maneuver, from its first message to its last, and those of the
    CAMs and of the always-on alternative in this time."""
    own = [sent for sent in recorded.air.sent if sent.prescriber == prescriber]
    if not own:
        raise ExperimentError(f"bandwidth: station {prescriber} sent nothing")
    begin, end = own[0].ms, own[-1].ms
    cams = [s for s in recorded.air.sent if s.type == "CAM" and begin <= s.ms <= end]
    offers = [s for s in recorded.offers if begin - OFFER_MS < s.ms <= end]
    times = RATE_HZ * (end - begin) / 1000 * recorded.vehicles / len(offers)
    bins: Counter[int] = Counter()
    for sent in own:
        bins[sent.ms // BIN_MS] += sent.forms["sent"]["json"]
    peak = max(bins, key=lambda n: (bins[n], -n))
    busiest = [s for s in own if s.ms // BIN_MS == peak]
    return {
        "ms": end - begin,
        "finished": any(sent.type == "Fin" for sent in own),
        "cancelled": sorted({sent.cancelled for sent in own if sent.cancelled}),
        "count": dict(sorted(Counter(sent.type for sent in own).items())),
        "certificates": certificates(own),
        "bytes": {form: by_type(own, form) for form in FORMS},
        "by_station": {
            str(n): total([s for s in own if s.src == n])
            for n in sorted({sent.src for sent in own})
        },
        "busiest": {"count": len(busiest)} | total(busiest),
        "cams": {"count": len(cams)} | total(cams),
        "always": {
            form: {name: round(times * value, 3) for name, value in total(offers, form).items()}
            for form in FORMS[:2]
        },
    }


def certificates(sent: Sequence[Sent]) -> int:
    """The number of these messages that have a certificate if they are signed."""
    number, last = 0, dict[int, int]()
    for each in sent:
        if each.src not in last or each.ms - last[each.src] >= CERTIFICATE_MS:
            last[each.src] = each.ms
            number += 1
    return number


def total(sent: Sequence[Sent], form: str = "sent") -> MessageBytes:
    """The sum of all amounts."""
    return {name: sum(each.forms[form][name] for each in sent) for name in CODECS}


def by_type(sent: Sequence[Sent], form: str) -> dict[str, dict[str, int]]:
    """Bytes by codec and type."""
    kinds = sorted({each.type for each in sent})
    whole = {kind: total([s for s in sent if s.type == kind], form) for kind in kinds}
    return {name: {kind: whole[kind][name] for kind in kinds} for name in CODECS}


def over_time(recorded: Recorded) -> dict[str, dict[str, list[int]]]:
    """Bytes in each BIN_MS by codec and type, CAMs and always-on among them."""
    number = len(recorded.offers) // recorded.vehicles * OFFER_MS // BIN_MS
    found: dict[str, dict[str, list[int]]] = {name: {} for name in CODECS}

    def add(sent: Sent, at: int, times: int) -> None:
        for name in CODECS if at < number else ():  # the end of the drive is the next one's
            line = found[name].setdefault(sent.type, [0] * number)
            line[at] += times * sent.forms["sent"][name]

    for sent in recorded.air.sent:
        add(sent, sent.ms // BIN_MS, 1)
    for offer in recorded.offers:
        for later in range(0, OFFER_MS, BIN_MS):
            add(offer, (offer.ms + later) // BIN_MS, RATE_HZ * BIN_MS // 1000)
    return found
