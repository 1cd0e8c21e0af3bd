"""The handlers of Station.tla from the request to the Acceptance, as decision trees."""

from __future__ import annotations

from automcm_traces.guards_common import (
    REFUSED,
    accepted,
    ack_if_reliable,
    bound,
    closed,
    copy,
    deciding_on,
    inside,
    phase,
    session,
    verifies,
)
from automcm_traces.guards_tree import Choice, Guard, Tree, all_of, leaf

REQUEST = Choice(
    bound("OnRequest"),
    leaf("ADV-1", REFUSED),
    Choice(
        Guard(
            "OnRequest",
            "st.backoff",
            lambda f: f.st.backoff,
            ("st.backoff",),
            "it backs off after a session without participants",
            "it does not back off",
        ),
        leaf("END-7", REFUSED),
        Choice(
            Guard(
                "OnRequest",
                "~Room(st)",
                lambda f: not f.room,
                ("st.outbox", "OutboxLimit", "Reserve"),
                "the outbox has no room",
                "the outbox has room",
            ),
            leaf("MEM-1", REFUSED),
            leaf("ADV-1", "send Advertisement", "phase ADVERTISING", "arm advertise, resend"),
        ),
    ),
)

ADVERTISEMENT = Choice(
    bound("OnAdvertisement"),
    leaf("ADV-4"),
    Choice(
        Guard(
            "OnAdvertisement",
            "Quarantined(st)",
            lambda f: f.st.quarantine,
            ("st.quarantine",),
            "it is in quarantine after a restart",
            "it is not in quarantine",
        ),
        leaf("END-8"),
        Choice(
            Guard(
                "OnAdvertisement",
                "~NewerThanJoined(st, m.session)",
                lambda f: f.joined_since,
                ("m.session", "st.joined"),
                "it has already joined this session, or a later one",
                "it has not joined this session, nor a later one",
            ),
            leaf("ADV-8"),
            Choice(
                Guard(
                    "OnAdvertisement",
                    "~concerned",
                    lambda f: not f.concerned,
                    ("concerned",),
                    "the Advertisement does not concern it (no planned with it)",
                    "the Advertisement concerns it",
                ),
                leaf("ADV-3"),
                Choice(
                    Guard(
                        "OnAdvertisement",
                        "~(Room(st) /\\ RoomToRemember(st, m.src))",
                        lambda f: not (f.room and f.room_to_remember),
                        ("st.outbox", "OutboxLimit", "Reserve", "st.joined", "MemoryLimit"),
                        "there is no room in the outbox or the memory",
                        "there is room in the outbox and the memory",
                    ),
                    leaf("MEM-1"),
                    leaf(
                        "ADV-3",
                        "send Intention",
                        "phase INTENDING",
                        "arm giveup, resend",
                        "stop forget?",
                    ),
                ),
            ),
        ),
    ),
)

INTENTION = Choice(
    inside("OnIntention", "~In(st, m.session)"),
    closed("ADV-5"),
    Choice(
        phase(
            "OnIntention",
            'st.phase = "ADVERTISING"',
            lambda f: f.st.phase == "ADVERTISING",
            "ADVERTISING",
        ),
        Choice(
            Guard(
                "OnIntention",
                "p \\in st.recorded",
                lambda f: f.m.src in f.st.recorded,
                ("m.src", "st.recorded"),
                "the sender is recorded already",
                "the sender is not recorded yet",
            ),
            leaf("ADV-5", "send Ack"),
            Choice(
                Guard(
                    "OnIntention",
                    "p \\in st.withdrawn",
                    lambda f: f.m.src in f.st.withdrawn,
                    ("m.src", "st.withdrawn"),
                    "the sender has withdrawn",
                    "the sender has not withdrawn",
                ),
                closed("ADV-5"),
                Choice(
                    Guard(
                        "OnIntention",
                        "~RoomToRecord(st)",
                        lambda f: not f.room_to_record,
                        ("st.recorded", "st.withdrawn", "MaxParticipants"),
                        "there is no room for another participant",
                        "there is room for another participant",
                    ),
                    leaf("MEM-1"),
                    leaf("ADV-5", "send Ack"),
                ),
            ),
        ),
        Choice(
            Guard(
                "OnIntention",
                "p \\in st.recorded \\cup {st.target}",
                lambda f: f.m.src in f.st.recorded or f.m.src == f.st.target,
                ("m.src", "st.recorded", "st.target"),
                "the sender takes part",
                "the sender does not take part",
            ),
            leaf("ADV-5", "send Ack"),
            closed("ADV-5"),
        ),
    ),
)

PRESCRIBE = Choice(
    Guard(
        "OnPrescribe",
        '~(st.phase = "CHOOSING" \\/ st.deciding)',
        lambda f: not (f.st.phase == "CHOOSING" or f.st.deciding),
        ("st.phase", "st.deciding"),
        "there is nothing to choose or to propose now",
        "it is the application's turn to choose or to propose",
    ),
    leaf("CMD-1", REFUSED),
    Choice(
        Guard(
            "OnPrescribe",
            "c.session # st.session \\/ c.proposal # NextProposal(st.proposal)",
            lambda f: f.c.session != f.st.session or f.c.proposal != f.st.proposal + 1,
            ("c.session", "st.session", "c.proposal", "st.proposal"),
            "the command is for another session, or not the next proposal",
            "the command is the next proposal of its session",
        ),
        leaf("PRE-5", REFUSED),
        Choice(
            phase(
                "OnPrescribe",
                'st.phase = "CHOOSING"',
                lambda f: f.st.phase == "CHOOSING",
                "CHOOSING",
            ),
            Choice(
                Guard(
                    "OnPrescribe",
                    "c.target \\in st.recorded",
                    lambda f: f.c.target in f.st.recorded,
                    ("c.target", "st.recorded"),
                    "the target is recorded",
                    "the target is not recorded",
                ),
                leaf(
                    "PRE-2",
                    "send Cancel not_selected?, Prescription",
                    "phase PRESCRIBING",
                    "arm giveup, lease, resend",
                    "stop decide",
                ),
                leaf("PRE-2", REFUSED),
            ),
            Choice(
                Guard(
                    "OnPrescribe",
                    "NextTarget(st, c.target)",
                    lambda f: f.c.target == f.st.target,
                    ("c.target", "st.target"),
                    "the target is the one of this session",
                    "the target is not the one of this session",
                ),
                leaf(
                    "NEG-7",
                    "send Prescription",
                    "phase PRESCRIBING",
                    "arm giveup, lease, resend",
                    "stop decide",
                ),
                leaf("NEG-7", REFUSED),
            ),
        ),
    ),
)

PROCEED = Choice(
    phase("OnProceed", 'st.phase # "CHOOSING"', lambda f: f.st.phase != "CHOOSING", "CHOOSING"),
    leaf("CMD-1", REFUSED),
    Choice(
        session("OnProceed"),
        leaf("PRE-5", REFUSED),
        leaf(
            "PRE-3",
            "send Cancel not_needed",
            "phase STANDALONE",
            "arm giveup, resend",
            "stop decide",
        ),
    ),
)

PRESCRIPTION = Choice(
    inside("OnPrescription", "~In(st, m.session)"),
    Choice(
        bound("OnForeignPrescription"),
        leaf("NEG-4", "send Acceptance refused busy"),
        leaf("NEG-5", "send Acceptance refused unknown_session"),
    ),
    Choice(
        Guard(
            "OnPrescription",
            "OlderOrSame(m.proposal, st.proposal)",
            lambda f: f.m.proposal <= f.st.proposal,
            ("m.proposal", "st.proposal"),
            "the proposal is not newer than the last one seen",
            "the proposal is newer than the last one seen",
        ),
        leaf("NEG-1", "send Ack"),
        Choice(
            phase(
                "OnPrescription",
                'st.phase \\in {"INTENDING", "WAITING"}',
                lambda f: f.st.phase in ("INTENDING", "WAITING"),
                "waiting for a proposal",
            ),
            leaf(
                "NEG-1",
                "send Ack",
                "told verify",
                "phase NEGOTIATING",
                "arm decide",
                "stop giveup?, hold?, resend?",
            ),
            leaf("END-5", "told discarded"),
        ),
    ),
)

ACCEPT = Choice(
    verifies("OnAccept"),
    leaf("CMD-1", REFUSED),
    Choice(
        deciding_on("OnAccept"),
        leaf("PRE-5", REFUSED),
        leaf(
            "NEG-2",
            "send Acceptance accepted",
            "phase ACTUATING",
            "arm cam, giveup, lease, resend",
            "stop decide",
        ),
    ),
)

REFUSE = Choice(
    verifies("OnRefuse"),
    leaf("CMD-1", REFUSED),
    Choice(
        deciding_on("OnRefuse"),
        leaf("PRE-5", REFUSED),
        leaf(
            "NEG-3",
            "send Acceptance refused unsafe",
            "phase WAITING",
            "arm giveup, hold, resend",
            "stop decide",
        ),
    ),
)


def _answered(*ack: str) -> Tree:
    """The answer to the current proposal; ``ack`` is what goes out for a reliable one."""
    another = [
        Guard(
            "OnAcceptance",
            'm.reason \\notin {"busy", "unknown_session"}',
            lambda f: f.m.reason not in ("busy", "unknown_session"),
            ("m.reason",),
            "the receiver is in this session and can take another proposal",
            "the receiver is not in this session",
        ),
        Guard(
            "OnAcceptance",
            "RoundLeft(st)",
            lambda f: bool(f.st.proposal < f.limits["MaxRounds"]),
            ("st.proposal", "MaxRounds"),
            "a round is left",
            "no round is left",
        ),
    ]
    return Choice(
        accepted(),
        leaf(
            "NEG-6",
            *ack,
            "told accepted",
            "phase ACTUATING",
            "arm cam",
            "stop answer?, giveup?, resend?",
        ),
        all_of(
            another,
            leaf(
                "NEG-7",
                *ack,
                "told propose",
                "phase NEGOTIATING?",
                "arm decide",
                "stop answer?, giveup?, lease, resend?",
            ),
            leaf(
                "NEG-7",
                *ack,
                "send Cancel no_agreement",
                "told fallback no_agreement",
                "phase STANDALONE",
                "arm giveup, resend",
                "stop answer?, giveup?, lease, resend?",
            ),
        ),
    )


ACCEPTANCE = Choice(
    inside("OnAcceptance", "~In(st, m.session)"),
    Choice(accepted(), closed("NEG-6"), ack_if_reliable()),
    Choice(
        Guard(
            "OnAcceptance",
            "m.src # st.target \\/ m.proposal > st.proposal",
            lambda f: f.m.src != f.st.target or f.m.proposal > f.st.proposal,
            ("m.src", "st.target", "m.proposal", "st.proposal"),
            "it is not from the target, or for a proposal never sent",
            "it is from the target, for a proposal that was sent",
        ),
        leaf("END-5", "told discarded"),
        Choice(
            Guard(
                "OnAcceptance",
                "~(AwaitsAnswer(st) /\\ SameProposal(m.proposal, st.proposal))",
                lambda f: not (f.awaits_answer and f.m.proposal == f.st.proposal),
                ("st.phase", "st.deciding", "m.proposal", "st.proposal"),
                "no answer to this proposal is awaited",
                "the answer to this proposal is awaited",
            ),
            ack_if_reliable(),
            Choice(copy("OnAcceptance"), _answered("send Ack"), _answered()),
        ),
    ),
)
