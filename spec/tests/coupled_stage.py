"""Edits of Station.tla that couple its sessions, or the participants of one.

The lemmas must notice each (test_independence).
"""

from __future__ import annotations

from pathlib import Path
from shutil import copytree
from typing import NamedTuple

from automcm_spec.support.paths import TLA


class Edit(NamedTuple):
    """A replacement of text that occurs once in Station.tla."""

    old: str
    new: str


def edited(edit: Edit, folder: Path) -> Path:
    """A copy of the modules in ``folder``, with the edit."""
    tla = Path(copytree(TLA, folder / "tla"))
    module = tla / "Station.tla"
    text = module.read_text(encoding="utf-8")
    assert text.count(edit.old) == 1, f"must occur once in Station.tla: {edit.old}"
    module.write_text(text.replace(edit.old, edit.new), encoding="utf-8")
    return tla


COUPLED = {
    "an Ack of any session counts (END-6)": Edit(
        "/\\ e.to = m.src\n  /\\ e.session = m.session\n  /\\ m.of", "/\\ e.to = m.src\n  /\\ m.of"
    ),
    "an Ack of any participant counts (END-6)": Edit(
        "/\\ e.to = m.src\n  /\\ e.session = m.session\n  /\\ m.of",
        "/\\ e.session = m.session\n  /\\ m.of",
    ),
    "an Ack ends all sending to its sender (END-6)": Edit(
        "!.outbox = @ \\ acked]", "!.outbox = {e \\in @ : acked = {} \\/ e.to # m.src}]"
    ),
    "the outbox has room for one message to each peer (MEM-1)": Edit(
        "Post(st, ms) == [st EXCEPT !.outbox = @ \\cup",
        "Post(st, ms) == [st EXCEPT !.outbox = {e \\in @ : \\A m \\in ms : e.to # m.dst} \\cup",
    ),
    "one Cancel ends every session with its sender (END-2)": Edit(
        "IF ~In(st, m.session)\n    THEN Effect(st, IF m.seq",
        "IF ~Bound(st)\n    THEN Effect(st, IF m.seq",
    ),
    "a Cancel also ends the sending of earlier sessions (END-1)": Edit(
        '!.outbox = {e \\in @ : e.type \\in {"Fin", "Cancel"}} ]\n\n\\* ACT-6',
        "!.outbox = {} ]\n\n\\* ACT-6",
    ),
    "a Cancel of one participant removes all (END-2)": Edit(
        "ELSE Effect([st EXCEPT !.recorded = @ \\ {m.src},",
        "ELSE Effect([st EXCEPT !.recorded = {},",
    ),
    "a Fin of any session ends the present one (ACT-3)": Edit(
        'IF In(st, m.session) /\\ st.role = "receiver"', 'IF Bound(st) /\\ st.role = "receiver"'
    ),
    "a Prescription of any session is verified in the present one (NEG-1)": Edit(
        "IF ~In(st, m.session) THEN OnForeignPrescription",
        "IF ~Bound(st) THEN OnForeignPrescription",
    ),
    "an Acceptance of any session is taken in the present one (NEG-6)": Edit(
        "IF ~In(st, m.session) THEN\n    IF m.accepted", "IF ~Bound(st) THEN\n    IF m.accepted"
    ),
    "whoever intends in any session is recorded in the present one (ADV-5)": Edit(
        "IF ~In(st, m.session) THEN AnswerClosed", "IF ~Bound(st) THEN AnswerClosed"
    ),
    "recording one participant drops the others (ADV-5)": Edit(
        "[st EXCEPT !.recorded = @ \\cup {p}]", "[st EXCEPT !.recorded = {p}]"
    ),
    "a CAM with a mark of any session counts (ACT-5)": Edit(
        "Marked(st, marks) == st.session \\in marks", "Marked(st, marks) == marks # {}"
    ),
    "the lease runs only while nothing of another session is sent (ACT-4)": Edit(
        '  \\/ st.phase \\in {"PRESCRIBING", "ACTUATING"}\n',
        '  \\/ /\\ st.phase \\in {"PRESCRIBING", "ACTUATING"}\n'
        "     /\\ \\A e \\in st.outbox : e.session = st.session\n",
    ),
    "the end of the quarantine ends all sending (END-8)": Edit(
        'Ignore([st EXCEPT !.quarantine = FALSE], "END-8")',
        'Ignore([st EXCEPT !.quarantine = FALSE, !.outbox = {}], "END-8")',
    ),
    "a commitment that is broken off is quarantined only if nothing else is sent (ACT-6)": Edit(
        'IF st.phase = "ACTUATING" /\\ st.role = "receiver"\n',
        'IF /\\ st.phase = "ACTUATING" /\\ st.role = "receiver"\n'
        "                   /\\ \\A e \\in st.outbox : e.session = st.session\n",
    ),
    "the end of the back-off ends the quarantine (END-7)": Edit(
        'Ignore([st EXCEPT !.backoff = FALSE], "END-7")',
        'Ignore([st EXCEPT !.backoff = FALSE, !.quarantine = FALSE], "END-7")',
    ),
    "joining a session ends the back-off (END-7)": Edit(
        "!.session = m.session,\n", "!.session = m.session, !.backoff = FALSE,\n"
    ),
    "a station in quarantine does not say that a session is closed (END-8)": Edit(
        "  IN Effect(st, IF mine # {} THEN",
        "  IN IF st.quarantine THEN Ignore(st, rule) ELSE\n     Effect(st, IF mine # {} THEN",
    ),
    "a station that backs off accepts no proposal (END-7)": Edit(
        "ELSE LET m == Acceptance(me, st.session, st.proposal)",
        'ELSE IF st.backoff THEN Refuse(st, "CMD-1")\n'
        "  ELSE LET m == Acceptance(me, st.session, st.proposal)",
    ),
    "forgetting one prescriber forgets all (ADV-8)": Edit(
        "!.joined = {j \\in @ : j[1] # p}]", "!.joined = {}]"
    ),
    "joining one prescriber forgets the others (ADV-8)": Edit(
        "!.joined = {x \\in @ : x[1] # m.src}\n", "!.joined = {}\n"
    ),
    "a session is old if any prescriber had a later one (ADV-8)": Edit(
        "~ \\E j \\in st.joined : j[1] = s[1] /\\ j[2] >= s[2]",
        "~ \\E j \\in st.joined : j[2] >= s[2]",
    ),
    "joining a session uses up a number (ADV-1)": Edit(
        "!.session = m.session,\n", "!.session = m.session, !.number = @ + 1,\n"
    ),
    "remembered sessions take the room of participants (MEM-1)": Edit(
        "Cardinality(st.recorded \\cup st.withdrawn) < MaxParticipants",
        "Cardinality(st.recorded \\cup st.withdrawn) + Cardinality(st.joined) < MaxParticipants",
    ),
    "the number of the proposal goes on in the next session (NEG-1)": Edit(
        "!.proposal = 0, !.deciding = FALSE, !.heard", "!.deciding = FALSE, !.heard"
    ),
    "an answer repeats the Fin or Cancel of any session (ADV-5)": Edit(
        "/\\ e.to = m.src /\\ e.session = m.session\n", "/\\ e.to = m.src\n"
    ),
    "giving up one message gives up all to its addressee (REL-1)": Edit(
        "Drop(st, e)  == [st EXCEPT !.outbox = @ \\ {e}]",
        "Drop(st, e)  == [st EXCEPT !.outbox = {x \\in @ : x.to # e.to}]",
    ),
    "one message sent again sends all to its addressee (REL-1)": Edit(
        'ELSE Effect(st, {Copy(me, e)}, Nothing, "REL-1")',
        "ELSE Effect(st, {Copy(me, x) : x \\in {y \\in st.outbox : y.to = e.to}},\n"
        '              Nothing, "REL-1")',
    ),
    "a CAM of anyone with the mark counts (ACT-5)": Edit(
        'st.phase = "ACTUATING" /\\ OfPeer(st, i.src)\n', 'st.phase = "ACTUATING"\n'
    ),
    "a Cancel of any participant ends the session (END-2)": Edit(
        'ELSE IF st.phase # "CHOOSING" /\\ OfPeer(st, m.src)', 'ELSE IF st.phase # "CHOOSING"'
    ),
    "a Fin of anyone ends the session of a receiver (ACT-3)": Edit(
        'st.role = "receiver" /\\ OfPeer(st, m.src)\n', 'st.role = "receiver"\n'
    ),
    "a Cancel of an old session takes the memory back to it (ADV-8)": Edit(
        "IF ~In(st, m.session)\n    THEN Effect(st, IF m.seq",
        "IF ~Bound(st) /\\ ~NewerThanJoined(st, m.session)\n"
        "    THEN Effect([st EXCEPT !.joined = {j \\in @ : j[1] # m.session[1]}\n"
        '                                      \\cup {m.session}], acks, Nothing, "END-3")\n'
        "  ELSE IF ~In(st, m.session)\n    THEN Effect(st, IF m.seq",
    ),
    "after leaving, an Ack of any participant counts (END-6)": Edit(
        "acked == {e \\in st.outbox : AckMatches(e, m)}",
        "acked == {e \\in st.outbox : \\/ AckMatches(e, m)\n"
        "                               \\/ /\\ ~Bound(st) /\\ e.session = m.session\n"
        "                                  /\\ m.of = <<e.type, e.seq>>}",
    ),
    "a Cancel of another session starts a back-off (END-7)": Edit(
        "THEN Effect(st, IF m.seq # 0 THEN AckCopy(me, m)",
        "THEN Effect([st EXCEPT !.backoff = TRUE], IF m.seq # 0 THEN AckCopy(me, m)",
    ),
    "a Cancel of another session is told as a fallback (END-3)": Edit(
        'ELSE {}, Nothing, "END-3")\n  ELSE IF st.phase = "ADVERTISING"',
        'ELSE {}, <<"fallback", m.reason>>, "END-3")\n  ELSE IF st.phase = "ADVERTISING"',
    ),
    "a bound station's CAM does not name the session that it finished (ACT-2)": Edit(
        "\\cup {e.session : e \\in {x \\in st.outbox :",
        "\\cup {e.session : e \\in {x \\in st.outbox : ~Bound(st) /\\",
    ),
    "a Fin of anyone bars the session (ADV-8)": Edit(
        'ELSE Effect(st, AckCopy(me, m), Nothing, "END-3")\n\n(*',
        "ELSE Effect(IF m.session[1] = me \\/ ~NewerThanJoined(st, m.session) THEN st\n"
        "              ELSE [st EXCEPT !.joined = {j \\in @ : j[1] # m.session[1]}\n"
        "                                         \\cup {m.session}],\n"
        '              AckCopy(me, m), Nothing, "END-3")\n\n(*',
    ),
    "a full record drops the others for a new one (MEM-1)": Edit(
        'ELSE IF ~RoomToRecord(st) THEN Ignore(st, "MEM-1")',
        "ELSE IF ~RoomToRecord(st)\n"
        '      THEN Answer([st EXCEPT !.recorded = {p}], Ack(me, m), "MEM-1")',
    ),
    "an Ack that ends nothing arms the cam timer again (ACT-5)": Edit(
        'IF acked = {} THEN Ignore(st, "END-6")',
        'IF acked = {} THEN [Ignore(st, "END-6") EXCEPT !.again = {Timer("cam")}]',
    ),
    "a bound station sends nothing of another session again (REL-1)": Edit(
        'ELSE Effect(st, {Copy(me, e)}, Nothing, "REL-1")',
        'ELSE IF Bound(st) /\\ e.session # st.session THEN Ignore(st, "REL-1")\n'
        '  ELSE Effect(st, {Copy(me, e)}, Nothing, "REL-1")',
    ),
    "a Cancel is not kept while another session is sent (REL-1)": Edit(
        "Effect(Post(BreakOff(st), ms), ms, told, rule)",
        "Effect(IF \\E e \\in st.outbox : e.session # st.session THEN BreakOff(st)\n"
        "         ELSE Post(BreakOff(st), ms), ms, told, rule)",
    ),
}
"""Forty-two edits by what they do, with the rule that they break."""

DEPENDENT = {
    "the peer's id is at most the sender's": Edit(
        "OfPeer(st, src)    == src = Peer(st)", "OfPeer(st, src)    == src >= Peer(st)"
    ),
    "a station with a certain id": Edit(
        "OfPeer(st, src)    == src = Peer(st)", "OfPeer(st, src)    == src = Peer(st) \\/ src = 5"
    ),
    "arithmetic on ids": Edit(
        "NextTarget(st, p) == p = st.target", "NextTarget(st, p) == p + 1 = st.target"
    ),
    "ids in a range": Edit(
        "NextTarget(st, p) == p = st.target", "NextTarget(st, p) == p \\in 1 .. 3"
    ),
    "the smallest id first": Edit(
        "IF c.target \\in st.recorded THEN",
        "IF \\A p \\in st.recorded : c.target <= p THEN",
    ),
    "the prescribers are in order": Edit(
        "j[1] = s[1] /\\ j[2] >= s[2]", "j[1] >= s[1] /\\ j[2] >= s[2]"
    ),
    "an id compared with a session number": Edit(
        "j[1] = s[1] /\\ j[2] >= s[2]", "j[1] = s[2] /\\ j[2] >= s[2]"
    ),
    "the distance of session numbers": Edit("j[2] >= s[2]", "j[2] - s[2] > 0"),
    "a session number has a limit": Edit("j[2] >= s[2]", "(j[2] >= s[2] \\/ s[2] > 9)"),
    "a session number is skipped": Edit("!.number = @ + 1]", "!.number = @ + 2]"),
    "a session number compared with a proposal": Edit(
        "OlderOrSame(m.proposal, st.proposal)\n", "OlderOrSame(m.session[2], st.proposal)\n"
    ),
    "as many participants as the id": Edit(
        "Cardinality(st.joined) < MemoryLimit", "Cardinality(st.joined) < p"
    ),
}
"""Edits that use ids or session numbers otherwise than test_data_independence allows."""
