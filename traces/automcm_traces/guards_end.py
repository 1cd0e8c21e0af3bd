"""The handlers of Station.tla from ACTUATING on, and the table of all."""

from __future__ import annotations

from automcm_traces.guards_common import (
    REFUSED,
    copy,
    inside,
    phase,
    session,
)
from automcm_traces.guards_start import (
    ACCEPT,
    ACCEPTANCE,
    ADVERTISEMENT,
    INTENTION,
    PRESCRIBE,
    PRESCRIPTION,
    PROCEED,
    REFUSE,
    REQUEST,
)
from automcm_traces.guards_timers import ADVERTISE_END, DECIDE, EXPIRY, GIVE_UP, RESEND
from automcm_traces.guards_tree import BROADCAST, ME, Choice, Guard, Test, Tree, all_of, leaf

_CAM = all_of(
    [
        phase("OnCam", 'st.phase = "ACTUATING"', lambda f: f.st.phase == "ACTUATING", "ACTUATING"),
        Guard(
            "OnCam",
            "i.src = Peer(st)",
            lambda f: f.i.src == f.peer,
            ("i.src", "Peer(st)"),
            "the CAM is from the peer",
            "the CAM is not from the peer",
        ),
        Guard(
            "OnCam",
            "Marked(st, i.marks)",
            lambda f: f.st.session in f.i.marks,
            ("st.session", "i.marks"),
            "the CAM is marked with the session",
            "the CAM is not marked with the session",
        ),
        Guard(
            "OnCam",
            "i.newer \\/ ~st.heard",
            lambda f: f.i.newer or not f.st.heard,
            ("i.newer", "st.heard"),
            "the CAM is newer than the last one that counted",
            "the CAM is not newer than the last one that counted",
        ),
    ],
    leaf("ACT-5", "arm cam"),
    leaf("ACT-5"),
)

_COMPLETE = Choice(
    phase(
        "OnComplete",
        '~(st.phase = "ACTUATING" /\\ st.role = "prescriber")',
        lambda f: not (f.st.phase == "ACTUATING" and f.st.role == "prescriber"),
        "ACTUATING as prescriber",
    ),
    leaf("CMD-1", REFUSED),
    Choice(
        session("OnComplete"),
        leaf("PRE-5", REFUSED),
        leaf("ACT-3", "send Fin", "phase STANDALONE", "arm giveup, resend", "stop cam, lease"),
    ),
)

_FIN = all_of(
    [
        inside("OnFin"),
        phase("OnFin", 'st.role = "receiver"', lambda f: f.st.role == "receiver", "a receiver"),
        Guard(
            "OnFin",
            "m.src = Peer(st)",
            lambda f: f.m.src == f.peer,
            ("m.src", "Peer(st)"),
            "it is from the peer",
            "it is not from the peer",
        ),
    ],
    leaf(
        "ACT-3",
        "send Ack",
        "told finished",
        "phase STANDALONE",
        "arm forget",
        "stop cam?, decide?, giveup?, hold?, lease?, resend?",
    ),
    leaf("END-3", "send Ack"),
)

_ABORT = Choice(
    Guard(
        "OnAbort",
        "~Bound(st)",
        lambda f: not f.bound,
        ("st.phase",),
        "it is in no session",
        "it is in a session",
    ),
    leaf("CMD-1", REFUSED),
    Choice(
        session("OnAbort"),
        leaf("PRE-5", REFUSED),
        leaf(
            "END-1",
            "send Cancel abort?",
            "phase STANDALONE",
            "arm forget?, giveup?, resend?",
            "stop advertise?, answer?, cam?, decide?, giveup?, hold?, lease?, resend?",
        ),
    ),
)


def _cancelled(reason: str, *ack: str) -> Tree:
    """OnCancel; ``ack`` is what goes out for a reliable one; only an answer says ``closed``."""
    answer = ["stop answer?"] if ack else []  # a prescriber is not told that it is closed
    return Choice(
        inside("OnCancel", "~In(st, m.session)"),
        leaf("END-3", *ack),
        Choice(
            phase(
                "OnCancel",
                'st.phase = "ADVERTISING"',
                lambda f: f.st.phase == "ADVERTISING",
                "ADVERTISING",
            ),
            Choice(
                Guard(
                    "OnCancel",
                    "m.src \\in st.withdrawn \\/ (m.src \\notin st.recorded /\\ ~RoomToRecord(st))",
                    lambda f: (
                        f.m.src in f.st.withdrawn
                        or (f.m.src not in f.st.recorded and not f.room_to_record)
                    ),
                    ("m.src", "st.withdrawn", "st.recorded", "MaxParticipants"),
                    "the sender has withdrawn already, or there is no room to note it",
                    "the sender can still withdraw",
                ),
                leaf("END-3", *ack),
                leaf("END-2", *ack),
            ),
            Choice(
                Guard(
                    "OnCancel",
                    'st.phase = "CHOOSING" /\\ m.src \\in st.recorded',
                    lambda f: f.st.phase == "CHOOSING" and f.m.src in f.st.recorded,
                    ("st.phase", "m.src", "st.recorded"),
                    "it is CHOOSING, and the sender is one of those recorded",
                    "it is not CHOOSING, or the sender is not recorded",
                ),
                Choice(
                    Guard(
                        "OnCancel",
                        "st.recorded = {m.src}",
                        lambda f: bool(f.st.recorded == [f.m.src]),
                        ("st.recorded", "m.src"),
                        "the sender is the only one recorded",
                        "others are recorded too",
                    ),
                    leaf(
                        "PRE-1",
                        *ack,
                        "told no_participants",
                        "phase STANDALONE",
                        "arm backoff",
                        "stop decide",
                    ),
                    leaf("END-2", *ack),
                ),
                Choice(
                    Guard(
                        "OnCancel",
                        'st.phase # "CHOOSING" /\\ m.src = Peer(st)',
                        lambda f: f.st.phase != "CHOOSING" and f.m.src == f.peer,
                        ("st.phase", "m.src", "Peer(st)"),
                        "it is from the peer",
                        "it is not from the peer",
                    ),
                    leaf(
                        "END-2",
                        *ack,
                        f"told fallback {reason}",
                        "phase STANDALONE",
                        "arm forget?",
                        *answer,
                        "stop cam?, decide?, giveup?, hold?, lease?, resend?",
                    ),
                    leaf("END-3", *ack),
                ),
            ),
        ),
    )


_CANCEL = Choice(copy("OnCancel"), _cancelled("as_sent", "send Ack"), _cancelled("closed"))


def _acks(type_: str) -> Guard:
    return Guard(
        "OnAck",
        f'"{type_}" \\in types',
        lambda f: type_ in f.types,
        ("m.of",),
        f"it acks the {type_}",
        f"it does not ack a{'n' if type_[0] in 'AI' else ''} {type_}",
    )


_ACK = Choice(
    Guard(
        "OnAck",
        "acked = {}",
        lambda f: not f.acked,
        ("m.src", "m.session", "m.of", "st.outbox"),
        "it matches nothing that is still being sent",
        "it matches a message that is still being sent",
    ),
    leaf("END-6"),
    Choice(
        _acks("Intention"),
        leaf("ADV-6", "phase WAITING", "arm hold", "stop giveup, resend"),
        Choice(
            _acks("Prescription"),
            leaf("PRE-4", "phase NEGOTIATING", "arm answer", "stop giveup, resend"),
            Choice(
                _acks("Acceptance"),
                leaf("NEG-9", "stop giveup, resend"),
                leaf("END-6", "stop giveup, resend"),
            ),
        ),
    ),
)


def _message(type_: str, tree: Tree) -> Tree:
    """OnMessage: what breaks the protocol in a message of this type, and then its handler."""
    broken: list[tuple[str, Test, tuple[str, ...], str, str]] = [
        (
            "m.src = me",
            lambda f: f.m.src == ME,
            ("m.src",),
            "it is an echo of its own",
            "it is from another station",
        ),
        (
            '(m.dst = Broadcast) # (m.type = "Advertisement")',
            lambda f: (f.m.dst == BROADCAST) != (f.m.type == "Advertisement"),
            ("m.dst", "m.type"),
            "an Advertisement to one, or another message to all",
            "the type may be addressed so",
        ),
        (
            'm.type \\in {"Advertisement", "Prescription"} /\\ m.src # m.session[1]',
            lambda f: f.m.type in ("Advertisement", "Prescription") and f.m.src != f.m.session[0],
            ("m.type", "m.src", "m.session"),
            "only the prescriber of the session may send this",
            "the sender may send this",
        ),
        (
            'm.type \\in {"Intention", "Acceptance"} /\\ m.session[1] # me',
            lambda f: f.m.type in ("Intention", "Acceptance") and f.m.session[0] != ME,
            ("m.type", "m.session"),
            "this goes only to the prescriber of the session",
            "the message may go to this station",
        ),
        (
            'm.type = "Cancel" /\\ m.reason = "closed" /\\ m.src # m.session[1]',
            lambda f: f.m.type == "Cancel" and f.m.reason == "closed" and f.m.src != f.m.session[0],
            ("m.type", "m.reason", "m.src", "m.session"),
            "only the prescriber may say that a session is closed",
            "no foreign Cancel (closed)",
        ),
    ]
    for text, test, shows, yes, no in reversed(broken):
        if text.startswith("m.type") and f'"{type_}"' not in text:
            continue
        guard = Guard("BreaksProtocol", text, test, shows, yes, no)
        tree = Choice(guard, leaf("END-5", "told discarded"), tree)
    return Choice(
        Guard(
            "OnMessage",
            "m.dst \\notin {me, Broadcast}",
            lambda f: f.m.dst not in (ME, BROADCAST),
            ("m.dst",),
            "it is addressed to another station",
            "it is addressed to this station",
        ),
        leaf("MSG-1"),
        tree,
    )


HANDLERS: dict[str, Tree] = {
    "OnRequest": REQUEST,
    "OnPrescribe": PRESCRIBE,
    "OnProceed": PROCEED,
    "OnAccept": ACCEPT,
    "OnRefuse": REFUSE,
    "OnComplete": _COMPLETE,
    "OnAbort": _ABORT,
    "OnAdvertisement": _message("Advertisement", ADVERTISEMENT),
    "OnIntention": _message("Intention", INTENTION),
    "OnPrescription": _message("Prescription", PRESCRIPTION),
    "OnAcceptance": _message("Acceptance", ACCEPTANCE),
    "OnFin": _message("Fin", _FIN),
    "OnCancel": _message("Cancel", _CANCEL),
    "OnAck": _message("Ack", _ACK),
    "OnCam": _CAM,
    "OnAdvertiseEnd": ADVERTISE_END,
    "OnResend": RESEND,
    "GiveUpEntry": GIVE_UP,
    "OnDecide": DECIDE,
    "OnHold": leaf(
        "ADV-7", "told fallback timeout", "phase STANDALONE", "arm forget", "stop giveup?, resend?"
    ),
    "OnForget": leaf("ADV-8"),
    "OnCamLoss": leaf(
        "ACT-2",
        "send Cancel cam_loss",
        "told fallback cam_loss",
        "phase STANDALONE",
        "arm forget?, giveup, resend",
        "stop giveup?, lease, resend?",
    ),
    "OnExpiry": EXPIRY,
    "OnRestart": leaf(
        "END-8",
        "phase STANDALONE?",
        "arm quarantine",
        "stop advertise?, answer?, backoff?, cam?, decide?",
        "stop forget?, giveup?, hold?, lease?, resend?",
    ),
}
"""By ``automcm_spec.rules.handler``: the tree of each kind of input."""
