"""Ablations: the running station without one mechanism of the protocol.

docs/protocol.md lists the mechanisms and docs/models.md has a counterexample for each.  An
ablation gives a service other rows, another parameter or other marks; the code of the station and
of the service is unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from typing import Any

from automcm.core.actuating import cam_counts, newer
from automcm.core.advertising import answer_closed
from automcm.core.ending import ACK, FIRST, drop
from automcm.core.negotiating import agreed, not_yet_sent, untaken
from automcm.core.outcome import (
    Me,
    Outcome,
    Received,
    Row,
    Rules,
    ack,
    acked,
    foreign,
    ignore,
    leave,
    leave_with,
    own,
)
from automcm.core.rules import RULES, entry_of
from automcm.core.state import State, Timer
from automcm.service.service import McService
from automcm_maintenance.verify.spec_mapping import without
from automcm_spec.vocabulary.application import Fallback, Verify
from automcm_spec.vocabulary.messages import (
    Ack,
    Advertisement,
    Intention,
    MessageId,
    Reliable,
    Session,
    Trajectory,
)
from automcm_spec.vocabulary.parameters import Parameters

Then = Callable[[Me, State, Any], Outcome]
When = Callable[[Me, State, Any], bool]
PARAMETERS = Parameters(clock_drift=0)
"""The clocks here have no drift, and a margin would hide a wrong lease (ACT-4)."""


@dataclass(frozen=True, slots=True)
class Ablation:
    """An ablation disables ``rule``.

    ``breaks`` is the property that then fails in model checking; ``model`` has the counterexample
    (docs/models.md).
    """

    name: str
    rule: str
    breaks: str
    model: str
    text: str
    rules: Rules = field(default_factory=lambda: RULES)
    parameters: Parameters = PARAMETERS
    marks: Callable[[State], tuple[Session, ...]] = attrgetter("marks")
    """The sessions that a CAM names."""
    unseen: str = ""
    """The reason why random faults may not show the effect."""

    @property
    def service(self) -> Callable[..., McService]:
        """Make a service without the mechanism."""
        return partial(McService, rules=self.rules, marks=self.marks)


def _row(kind: str, rule: str, of: When | Then | None = None, rules: Rules = RULES) -> Row[Any]:
    """The row of a rule for inputs of this kind; if there are several, the one with this function.

    Raises LookupError unless there is exactly one.
    """
    found = [row for row in rules[kind] if row.rule == rule and of in (None, row.when, row.then)]
    if len(found) != 1:
        raise LookupError(f"{kind}: {len(found)} rows of {rule}, not one")
    return found[0]


def changed(
    kind: str,
    rule: str,
    *,
    of: When | Then | None = None,
    when: When | None = None,
    then: Then | None = None,
    rules: Rules = RULES,
) -> Rules:
    """The rules with another row in place of ``_row``; phases.py need not allow what it does."""
    old = _row(kind, rule, of, rules)
    new = Row(rule, when or old.when, then or old.then, declared=False)
    return {**rules, kind: tuple(new if row is old else row for row in rules[kind])}


def never(me: Me, st: State, i: Any) -> bool:
    """The guard of a disabled row."""
    return False


# -- replacement rows


def any_cam(me: Me, st: State, i: Any) -> bool:
    """ACT-5 without the marks."""
    return st.phase == "ACTUATING" and i.message.src == st.peer and newer(me, st, i)


def silent(me: Me, st: State, i: Any) -> Outcome:
    """ACT-2 without its Cancel."""
    return leave_with(st, (), Fallback(session=own(st), reason="cam_loss"))


def lease_anew(me: Me, st: State, i: Any) -> Outcome:
    """NEG-6 with a restart of ACT-4's lease."""
    outcome = agreed(me, st, i)
    return outcome._replace(again=(*outcome.again, Timer("lease")))


def free_at_once(kind: str, rule: str) -> Then:
    """Against ACT-6: the row without its quarantine."""
    usual = _row(kind, rule).then

    def then(me: Me, st: State, i: Any) -> Outcome:
        outcome: Outcome = usual(me, st, i)
        return outcome._replace(state=outcome.state._replace(quarantine=st.quarantine))

    return then


def _no_break_off() -> Rules:
    rules = RULES
    for row in (("command abort", "END-1"), ("expire cam", "ACT-2"), ("expire lease", "ACT-4")):
        rules = changed(*row, then=free_at_once(*row), rules=rules)
    return rules


def abandon(me: Me, st: State, i: Any) -> Outcome:
    """Against NEG-9: no Ack of the Acceptance, no commitment."""
    if st.phase == "ACTUATING":
        return Outcome(leave(st), indication=Fallback(session=own(st), reason="timeout"))
    return drop(st, entry_of(st, i.timer), None)


def take_over(me: Me, st: State, i: Any) -> Outcome:
    """Against NEG-4: the last instruction counts."""
    m = i.message
    taken = State(
        number=st.number,
        joined=st.joined,
        outbox=st.outbox,
        phase="NEGOTIATING",
        role="receiver",
        session=m.session,
        proposal=m.proposal,
        lease_ms=m.lease_ms,
    )
    indication = Verify(session=m.session, proposal=m.proposal, prescription=m)
    return Outcome(taken, (ack(me, m),), indication)


STANDING = Trajectory(t0=0, points=((0, 0, 0), (1000, 0, 0)))


def intend_again(me: Me, st: State, i: Received[Advertisement]) -> Outcome:
    """Against ADV-4: a bound receiver also answers another Advertisement.

    Its plan is not requested, so this is only for applications that ignore it.
    """
    m = i.message
    if st.role != "receiver" or m.session == st.session:
        return Outcome(st)
    intention = Intention(src=me.station_id, dst=m.src, session=m.session, seq=1, planned=STANDING)
    return Outcome(st, (intention,))


def _no_busy_refusal() -> Rules:
    rules = changed("receive Prescription", "NEG-4", then=take_over)
    return changed("receive Advertisement", "ADV-4", then=intend_again, rules=rules)


def ack_misread(entry: Callable[[State, Ack], Reliable | None]) -> Rules:
    """Against END-6: an Ack counts for the entry that ``entry`` gives for it."""

    def misread(st: State, i: Received[Ack]) -> Received[Ack]:
        named = entry(st, i.message)
        if named is None:
            return i
        of = MessageId(type=named.type, seq=named.seq)
        return Received(i.message.model_copy(update={"src": named.dst, "of": of}))

    def changed(row: Row[Received[Ack]]) -> Row[Received[Ack]]:
        return row._replace(
            when=lambda me, st, i: row.when(me, st, misread(st, i)),
            then=lambda me, st, i: row.then(me, st, misread(st, i)),
        )

    return {**RULES, "receive Ack": tuple(map(changed, FIRST + ACK))}


def acked_by_any(st: State, m: Ack) -> Reliable | None:
    """END-6 without type and seq: any Ack from that station in that session."""
    return next((e for e in st.outbox if (e.dst, e.session) == (m.src, m.session)), None)


def bound_session(st: State) -> tuple[Session, ...]:
    """ACT-5's marks without the sessions whose Fin is not acknowledged."""
    return () if st.session is None else (st.session,)


def always_closed(me: Me, st: State, i: Any) -> Outcome:
    """ADV-5 without the search for a Fin or Cancel that is still being sent."""
    return answer_closed(me, st._replace(outbox=()), i)._replace(state=st)


def _closed() -> Rules:
    rules = changed("receive Intention", "ADV-5", of=foreign, then=always_closed)
    return changed("receive Acceptance", "NEG-6", of=answer_closed, then=always_closed, rules=rules)


def _no_proposal_number() -> Rules:
    """NEG-6 and END-5 without the check of an Acceptance's proposal."""
    rules = changed(
        "receive Acceptance",
        "END-5",
        of=not_yet_sent,
        when=lambda me, st, i: i.message.src != st.target,
    )
    return changed(
        "receive Acceptance",
        "NEG-6",
        of=untaken,
        when=lambda me, st, i: not st.awaits_answer,
        rules=rules,
    )


def _copies_ignored() -> Rules:
    """Without effect: the rows whose only effect is an Ack."""
    return {
        kind: tuple(row._replace(then=ignore) if row.then is acked else row for row in rows)
        for kind, rows in RULES.items()
    }


WHOLE = Ablation("whole protocol", "", "", "", "nothing is taken away")
ABLATIONS = (
    Ablation(
        "no CAM-loss fallback",
        "ACT-2",
        "L-3",
        "no_cam_loss_fallback",
        "a station goes on although it hears no CAM",
        changed("expire cam", "ACT-2", then=ignore),
    ),
    Ablation(
        "silent CAM-loss fallback",
        "ACT-2",
        "T-2",
        "silent_cam_loss",
        "a station that hears no CAM leaves without a Cancel",
        changed("expire cam", "ACT-2", then=silent),
        unseen="hazards stay within B; the fault classes above show the cost",
    ),
    Ablation(
        "plain CAMs count",
        "ACT-5",
        "T-2",
        "plain_cams",
        "a CAM counts without the mark of the session",
        changed("receive CAM", "ACT-5", of=cam_counts, when=any_cam),
    ),
    Ablation(
        "mark dropped with the Fin",
        "ACT-5",
        "L-2",
        "mark_dropped_early",
        "a finished prescriber no longer names the session",
        marks=bound_session,
        unseen="visible only if all copies of a Fin are lost for t_cam_loss while CAMs pass",
    ),
    Ablation(
        "no lease",
        "ACT-4",
        "L-1",
        "no_lease",
        "nothing ends when its lease does",
        changed("expire lease", "ACT-4", then=ignore),
        unseen="visible only with a prescriber that never ends its maneuver",
    ),
    Ablation(
        "lease from the Acceptance",
        "ACT-4",
        "T-4",
        "lease_from_acceptance",
        "the prescriber counts its lease from hearing the Acceptance",
        changed("receive Acceptance", "NEG-6", of=agreed, then=lease_anew),
        unseen="visible only if a lease ends before the maneuver",
    ),
    Ablation(
        "no busy refusal",
        "NEG-4",
        "S-1",
        "no_busy_refusal",
        "a receiver answers a second Advertisement (ADV-4), and the last instruction counts",
        _no_busy_refusal(),
        unseen="visible only if a second prescriber asks a committed target",
    ),
    Ablation(
        "Acceptance abandoned",
        "NEG-9",
        "S-5",
        "abandoned_acceptance",
        "a receiver whose Acceptance is not acknowledged in time lets go",
        changed("expire giveup", "NEG-9", then=abandon),
        unseen="visible only if every Ack of an Acceptance is lost while CAMs pass",
    ),
    Ablation(
        "no retransmission",
        "REL-1",
        "L-2",
        "no_retransmission",
        "t_timeout is 0: every message is sent once",
        parameters=replace(PARAMETERS, t_timeout=0),
    ),
    Ablation(
        "copies are not acked",
        "END-3",
        "L-2",
        "no_re_ack",
        "a message that changes nothing is not acknowledged",
        _copies_ignored(),
        unseen="an Acceptance also ends a Prescription; other give-ups change no phase",
    ),
    Ablation(
        "no proposal number",
        "NEG-6",
        "S-3",
        "no_proposal_number",
        "an Acceptance counts whatever proposal it names",
        _no_proposal_number(),
        unseen="visible only if a refusal is still retransmitted after the next proposal",
    ),
    Ablation(
        "no session number",
        "END-4",
        "S-5",
        "no_session_number",
        "any session of the same prescriber counts as the own one",
        without("END-4"),
        unseen="visible only if a message of one session is still sent in the next",
    ),
    Ablation(
        "Ack without type and seq",
        "END-6",
        "S-6",
        "bare_ack",
        "an Ack is taken for the oldest message sent to that station in that session",
        ack_misread(acked_by_any),
        unseen="visible only with an Acceptance while a refusal is unacknowledged",
    ),
    Ablation(
        "no memory of sessions",
        "ADV-8",
        "S-6",
        "rejoin",
        "a receiver that has left a session may join it again",
        changed("receive Advertisement", "ADV-8", when=never),
        unseen="visible only if a receiver joins twice in the window, with an old copy between",
    ),
    Ablation(
        "no quarantine",
        "END-8",
        "S-4",
        "no_quarantine",
        "a station that has restarted joins at once",
        changed("receive Advertisement", "END-8", when=never),
        unseen="visible only with a restart within the window and a late copy from before it",
    ),
    Ablation(
        "free after breaking off",
        "ACT-6",
        "S-8",
        "no_break_off",
        "a receiver that ends its commitment itself joins and requests at once",
        _no_break_off(),
        unseen="visible only if another prescriber asks while the first still acts",
    ),
    Ablation(
        "closed in place of the Fin",
        "ADV-5",
        "L-2",
        "closed_despite_fin",
        "a late copy is answered with Cancel(closed) although a Fin is being sent",
        _closed(),
        unseen="visible only if an Acceptance is retransmitted after its Fin was lost",
    ),
    Ablation(
        "no hold timer",
        "ADV-7",
        "L-1",
        "no_hold",
        "a receiver waits for ever",
        changed("expire hold", "ADV-7", then=ignore),
        unseen="visible only if every Cancel to a waiting receiver is lost",
    ),
)
BY_NAME = {ablation.name: ablation for ablation in (WHOLE, *ABLATIONS)}
