"""What happens when a timer of Station.tla expires, as decision trees, and when it is armed."""

from __future__ import annotations

from automcm_traces.guards_common import phase
from automcm_traces.guards_tree import Choice, Guard, leaf

ADVERTISE_END = Choice(
    Guard(
        "OnAdvertiseEnd",
        "st.recorded = {}",
        lambda f: not f.st.recorded,
        ("st.recorded",),
        "nobody is recorded",
        "somebody is recorded",
    ),
    leaf("PRE-1", "told no_participants", "phase STANDALONE", "arm backoff", "stop resend"),
    leaf("PRE-1", "told choose", "phase CHOOSING", "arm decide", "stop resend"),
)

DECIDE = Choice(
    phase("OnDecide", 'st.role = "receiver"', lambda f: f.st.role == "receiver", "a receiver"),
    leaf(
        "NEG-3",
        "send Acceptance refused undecided",
        "told undecided",
        "phase WAITING",
        "arm giveup, hold, resend",
    ),
    leaf(
        "PRE-5",
        "send Cancel abort",
        "told fallback abort",
        "phase STANDALONE",
        "arm giveup, resend",
    ),
)


def _entry(where: str, type_: str) -> Guard:
    return Guard(
        where,
        f'e.type = "{type_}"',
        lambda f: f.e.type == type_,
        ("e.type",),
        f"the message is of type {type_}",
        f"the message is not of type {type_}",
    )


RESEND = Choice(
    _entry("OnResend", "Advertisement"),
    leaf("ADV-2", "send Advertisement", "arm resend"),
    leaf(
        "REL-1",
        "send Intention?, Prescription?, Acceptance accepted?, Acceptance refused as_sent?",
        "send Fin?, Cancel as_sent?",
        "arm resend",
    ),
)

GIVE_UP = Choice(
    _entry("GiveUpEntry", "Intention"),
    leaf("ADV-6", "phase WAITING", "arm hold", "stop resend"),
    Choice(
        _entry("GiveUpEntry", "Prescription"),
        leaf(
            "PRE-4",
            "send Cancel timeout",
            "told fallback timeout",
            "phase STANDALONE",
            "arm giveup, resend",
            "stop lease, resend",
        ),
        Choice(
            _entry("GiveUpEntry", "Acceptance"),
            leaf("NEG-9", "stop resend"),
            leaf("REL-1", "stop resend"),
        ),
    ),
)


def _timer(name: str) -> Guard:
    return Guard(
        "OnExpiry",
        f't[1] = "{name}"',
        lambda f: bool(f.t[0] == name),
        ("t[1]",),
        f"the timer is {name}",
        f"the timer is not {name}",
    )


EXPIRY = Choice(
    _timer("answer"),
    leaf(
        "NEG-8",
        "send Cancel timeout",
        "told fallback timeout",
        "phase STANDALONE",
        "arm giveup, resend",
        "stop lease",
    ),
    Choice(
        _timer("lease"),
        leaf(
            "ACT-4",
            "send Cancel lease_expired",
            "told fallback lease_expired",
            "phase STANDALONE",
            "arm forget?, giveup, resend",
            "stop answer?, cam?, giveup?, resend?",
        ),
        Choice(
            _timer("quarantine"),
            leaf("END-8"),
            leaf("END-7"),
        ),
    ),
)


def _in(phase_: str) -> Guard:
    return phase("Armed", f'st.phase = "{phase_}"', lambda f: f.st.phase == phase_, phase_)


def _sent_still(text: str) -> Guard:
    return Guard(
        "Armed",
        text,
        lambda f: list(f.e) in f.st.outbox,
        ("e.type", "e.to", "e.session", "st.outbox"),
        "the message is still being sent",
        "no such message is being sent any more",
    )


ARMED: dict[str, Guard] = {
    "advertise": _in("ADVERTISING"),
    "decide": Guard(
        "Armed",
        '\\/ st.phase = "CHOOSING" '
        '\\/ st.phase = "NEGOTIATING" /\\ (st.role = "receiver" \\/ st.deciding)',
        lambda f: (
            f.st.phase == "CHOOSING"
            or (f.st.phase == "NEGOTIATING" and (f.st.role == "receiver" or f.st.deciding))
        ),
        ("st.phase", "st.role", "st.deciding"),
        "the application has something to decide",
        "the application has nothing to decide",
    ),
    "hold": _in("WAITING"),
    "answer": Guard(
        "Armed",
        'st.phase = "NEGOTIATING" /\\ st.role = "prescriber" /\\ ~st.deciding',
        lambda f: f.st.phase == "NEGOTIATING" and f.st.role == "prescriber" and not f.st.deciding,
        ("st.phase", "st.role", "st.deciding"),
        "it awaits the answer to a proposal that was acked",
        "it does not await the answer to a proposal that was acked",
    ),
    "cam": _in("ACTUATING"),
    "lease": Guard(
        "Armed",
        "LeaseRuns(st)",
        lambda f: (
            f.st.phase in ("PRESCRIBING", "ACTUATING")
            or (f.st.phase == "NEGOTIATING" and f.st.role == "prescriber" and not f.st.deciding)
        ),
        ("st.phase", "st.role", "st.deciding"),
        "a lease runs",
        "no lease runs",
    ),
    "giveup": _sent_still("GiveUp(e) : e \\in st.outbox"),
    "resend": _sent_still("Resend(e) : e \\in st.outbox"),
    "quarantine": Guard(
        "Armed",
        "st.quarantine",
        lambda f: f.st.quarantine,
        ("st.quarantine",),
        "it is in quarantine",
        "it is not in quarantine",
    ),
    "backoff": Guard(
        "Armed",
        "st.backoff",
        lambda f: f.st.backoff,
        ("st.backoff",),
        "it backs off",
        "it does not back off",
    ),
    "forget": Guard(
        "Armed",
        "x \\in st.joined : x # st.session",
        lambda f: any(j[0] == f.t[1] and j != f.st.session for j in f.st.joined),
        ("t[2]", "st.joined", "st.session"),
        "a session of that prescriber is remembered, and left",
        "no session of that prescriber is remembered, or it is still in it",
    ),
}
"""By the timer's name: when it is armed."""

_ADVERTISED = Guard(
    "Armed",
    "Resend(Entry(Advertisement(me, st.session)))",
    lambda f: f.st.phase == "ADVERTISING" and bool(f.e.session == f.st.session),
    ("st.phase", "e.session", "st.session"),
    "it is ADVERTISING this session",
    "it is not ADVERTISING this session",
)


def armed(timer: list[object]) -> Guard:
    """The guard of Armed that keeps this timer of the oracle running."""
    entry = timer[1] if len(timer) > 1 else None
    if isinstance(entry, list) and entry[0] == "Advertisement":
        return _ADVERTISED
    return ARMED[str(timer[0])]
