"""The corpus: each verdict is given again, and every transition is found again in the logs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from automcm_maintenance.corpus.corpus import COVERAGE, CorpusEntry, index, index_text
from automcm_maintenance.corpus.corpus_walks import transition
from automcm_spec.log_format.log import RECORD, Receive, Send
from automcm_spec.log_format.reader import read
from automcm_spec.vocabulary import renumbering
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.station import Command, Expire, Input, Message, Restart, Session
from automcm_traces.checker.engine import Engine
from automcm_traces.checker.track import InputStep, Track
from automcm_traces.explain.explain import verdicts_of

CORPUS = Path(__file__).resolve().parents[2] / "corpus"
ENTRIES = index(CORPUS)


def of(kind: str) -> list[CorpusEntry]:
    return [entry for entry in ENTRIES if entry.file.startswith(f"{kind}/")]


def test_the_index_names_every_log_and_no_other() -> None:
    files = {path.relative_to(CORPUS).as_posix() for path in CORPUS.rglob("*.ndjson")}
    assert files == {entry.file for entry in ENTRIES}
    assert index_text(ENTRIES) == (CORPUS / "index.json").read_bytes()
    assert all(entry.story.endswith(".") and "\n" not in entry.story for entry in ENTRIES)


@pytest.mark.parametrize("entry", of("bad"), ids=lambda entry: Path(entry.file).stem)
def test_what_is_wrong_is_named_at_its_line(entry: CorpusEntry) -> None:
    beside = [CORPUS / entry.beside] if entry.beside else []
    verdict = verdicts_of([*beside, CORPUS / entry.file])[-1]
    assert (verdict.verdict, verdict.finding.at.line) == (entry.verdict, entry.line), verdict
    if entry.verdict == "diverges":  # because of the station, not of its log
        assert (verdict.finding.rule, verdict.hint) == (entry.rule, ""), verdict


@pytest.mark.parametrize(
    "kind", [pytest.param("behaviours", marks=pytest.mark.slow), "four-vehicles", "pair"]
)
def test_good_logs_are_allowed(kind: str) -> None:
    entries = of(kind)
    assert entries and all(entry.verdict == "allowed" for entry in entries)
    together: dict[str, list[Path]] = {}
    for entry in entries:
        walk = entry.file.split("-")[0] if kind == "behaviours" else kind
        together.setdefault(walk, []).append(CORPUS / entry.file)
    verdicts = [verdict for files in together.values() for verdict in verdicts_of(files)]
    assert [v.file for v in verdicts if v.verdict != "allowed"] == []


def test_counterexamples_are_judged_as_the_index_says() -> None:
    entries = of("counterexamples")
    found = [verdicts_of([CORPUS / entry.file])[0] for entry in entries]
    assert [(v.verdict, v.finding.at.line, v.finding.rule) for v in found] == [
        (entry.verdict, entry.line, entry.rule) for entry in entries
    ]


def test_of_each_ablated_mechanism_a_station_diverges() -> None:
    """Where an operator of the station is replaced, and not a bound, a duration or a timer."""
    diverging = {e.file.split("/")[1] for e in of("counterexamples") if e.verdict == "diverges"}
    assert diverging >= {
        *("no_session_number", "no_session_number_crosses", "no_proposal_number", "bare_ack"),
        *("ack_from_anybody", "no_busy_refusal", "busy_overwrites_commitment", "rejoin"),
        *("no_quarantine", "retarget", "abandoned_acceptance", "no_re_ack", "closed_despite_fin"),
        *("mark_dropped_early", "no_max_rounds", "two_instructions", "acts_on_nothing_agreed"),
        *("plain_cams", "silent_cam_loss", "no_hold_timed", "no_give_up_timed"),
        "lease_from_acceptance",
    }


def test_every_transition_of_the_closed_models_is_in_a_log() -> None:
    """The digests are TLC's; here the transitions come from the logs and the engine's track."""
    counts = json.loads((CORPUS / COVERAGE).read_text())
    taken: set[str] = set()
    for entry in of("behaviours"):
        taken |= transitions(CORPUS / entry.file)
    for model, count in counts.items():
        assert len(count["digests"]) == count["new"]
        assert set(count["digests"]) - taken == set(), model
    assert sum(count["new"] for count in counts.values()) > 1000


def transitions(path: Path) -> set[str]:
    """The digests of the transitions that a log takes, with the ids of the models again."""
    log = read(path)
    events = dict(log.events)
    engine = Engine(log.header)
    me, before, found = log.header.station, renumbering.state(engine.track.state, of_model), set()
    sent = {
        (m["type"], m.get("dst", 0), *m["session"], m["seq"]): (seq_of(m), m.get("accepted", False))
        for _, e in log.events
        if isinstance(e, Send) and "session" in (m := e.message)
    }

    def step(done: InputStep, track: Track) -> None:
        nonlocal before
        event = RECORD.dump_python(events[done.at], exclude_none=True)
        i = renumbering.input_of(given(event, sent), of_model)
        found.add(transition(me // 1001, before, i).digest)
        before = renumbering.state(track.state, of_model)

    engine.observer = step
    for at, one in log.events:
        if not isinstance(one, Receive) or one.message is None or one.message["type"] != "CAM":
            engine.feed(at, one)
    engine.finish()
    return found


def seq_of(m: dict[str, Any]) -> int:
    """The seq of a message in the specification: its proposal, 1, or 0 for an answer."""
    return int(m.get("proposal", 1)) if m["seq"] else 0


def of_model(session: Session) -> Session:
    """A session with the ids of the models."""
    return session[0] // 1001, session[1]


def given(event: dict[str, Any], sent: dict[Any, tuple[int, bool]]) -> Input:
    """An input of a log."""
    if event["ev"] == "receive":
        m = event["message"]
        reason = m.get("reason", "none")
        said = reason in ("none", "busy", "unknown_session", "closed")
        of_ = "none", 0
        if m["type"] == "Ack":
            type_, seq = m["of"]["type"], m["of"]["seq"]
            of_ = type_, sent.get((type_, m["src"], *m["session"], seq), (0, False))[0]
        about = m.get("proposal", 0), m.get("accepted", False), reason if said else "as_sent", of_
        ids = m["type"], m["src"], m.get("dst", 0), tuple(m["session"])
        return spec.Receive("receive", Message(*ids, seq_of(m), *about), "planned" in event)
    if event["ev"] == "command":
        c = event["command"]
        session = tuple(c.get("session", (0, 0)))
        return Command("command", c["name"], session, c.get("proposal", 0), c.get("target", 0))
    if event["ev"] == "restart":
        return Restart("restart")
    timer = event["timer"]
    name = timer["name"]
    if name == "forget":
        return Expire("expire", (name, timer["station"]))
    if name not in ("resend", "giveup"):
        return Expire("expire", (name,))
    m = timer["message"]
    k, accepted = sent[(m["type"], m.get("to", 0), *m["session"], m["seq"])]
    entry = spec.Entry(m["type"], m.get("to", 0), tuple(m["session"]), k, accepted)
    return Expire("expire", (name, entry))
