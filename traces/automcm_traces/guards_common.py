"""Guards and endings that several handlers of Station.tla share (see ``guards_tree``)."""

from __future__ import annotations

from automcm_traces.guards_tree import Choice, Guard, Test, Tree, leaf


def phase(where: str, text: str, test: Test, wanted: str) -> Guard:
    """A guard on phase or role; ``wanted`` says what it is, or is not if the text is negated."""
    shows = tuple(f"st.{name}" for name in ("phase", "role") if f"st.{name}" in text)
    words = f"it is {wanted}", f"it is not {wanted}"
    negated = text.startswith("~") or "#" in text or "\\notin" in text
    return Guard(where, text, test, shows, *(words[::-1] if negated else words))


def bound(where: str) -> Guard:
    """Whether it is in a session."""
    return Guard(
        where,
        "Bound(st)",
        lambda f: f.bound,
        ("st.phase",),
        "it is in a session",
        "it is in no session",
    )


def inside(where: str, text: str = "In(st, m.session)") -> Guard:
    """Whether it is in the session of the message (END-4)."""
    negated = text.startswith("~")
    words = "it is in the session of the message", "it is not in the session of the message"
    return Guard(
        where,
        text,
        lambda f: f.inside(f.m.session) != negated,
        ("m.session", "st.session", "st.phase"),
        *(words[::-1] if negated else words),
    )


def copy(where: str) -> Guard:
    """Whether the message wants an Ack."""
    return Guard(
        where,
        "m.seq # 0",
        lambda f: f.m.seq != 0,
        ("m.seq",),
        "the message was sent reliably",
        "the message is an answer (seq 0), which is not acked",
    )


def accepted() -> Guard:
    """Whether an Acceptance accepts."""
    return Guard(
        "OnAcceptance",
        "m.accepted",
        lambda f: f.m.accepted,
        ("m.accepted",),
        "the proposal is accepted",
        "the proposal is refused",
    )


def session(where: str) -> Guard:
    """Whether a command is for another session (PRE-5)."""
    return Guard(
        where,
        "c.session # st.session",
        lambda f: f.c.session != f.st.session,
        ("c.session", "st.session"),
        "the command is for another session",
        "the command is for its session",
    )


def deciding_on(where: str) -> Guard:
    """Whether a command is for another session or proposal (PRE-5)."""
    return Guard(
        where,
        "c.session # st.session \\/ c.proposal # st.proposal",
        lambda f: f.c.session != f.st.session or f.c.proposal != f.st.proposal,
        ("c.session", "st.session", "c.proposal", "st.proposal"),
        "the command is for another session or proposal",
        "the command is for the proposal at hand",
    )


def verifies(where: str) -> Guard:
    """Whether a receiver has no proposal to verify (CMD-1)."""
    return phase(
        where,
        '~(st.phase = "NEGOTIATING" /\\ st.role = "receiver")',
        lambda f: not (f.st.phase == "NEGOTIATING" and f.st.role == "receiver"),
        "verifying a proposal",
    )


REFUSED = "told refused"


def closed(rule: str) -> Tree:
    """AnswerClosed."""
    return Choice(
        Guard(
            "AnswerClosed",
            "mine # {}",
            lambda f: bool(f.mine),
            ("m.src", "m.session", "st.outbox"),
            "a Fin or Cancel to the sender is still being sent",
            "no Fin or Cancel to the sender is being sent any more",
        ),
        leaf(rule, "send Cancel as_sent?", "send Fin?"),
        leaf(rule, "send Cancel closed"),
    )


def ack_if_reliable() -> Tree:
    """AckIfReliable."""
    return Choice(
        copy("AckIfReliable"),
        leaf("NEG-6", "send Ack"),
        leaf("NEG-6"),
    )
