"""Logs that begin in mid-session: what cannot be told, and from where on they are judged."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest
from generated_logs import mutated
from merged_runs import records

from automcm.links.simulated_radio import Channel
from automcm_maintenance.corpus.corpus import index
from automcm_maintenance.corpus.corpus_bad import renumber
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.log_format.log import Header, Receive, Restart, Send
from automcm_spec.log_format.reader import read
from automcm_spec.vocabulary.parameters import Parameters, in_header
from automcm_traces.checker.log_start import LogStart, remembered_for
from automcm_traces.explain.explain import Verdict, text, verdict_of
from automcm_traces.explain.lint import level, lint
from automcm_traces.system.timeline import timeline

Json = Any
CORPUS = Path(__file__).resolve().parents[2] / "corpus"
GOOD = [e.file for e in index(CORPUS) if e.verdict == "allowed" and "bad/" not in e.file]
KINDS = (
    *(("receive", "send"), ("send",), ("receive", "send", "timer")),
    *(("indication", "receive", "send"), ("command", "receive", "restart", "send", "timer")),
)


def only(lines: list[Json], kinds: tuple[str, ...]) -> list[Json]:
    """The log with only these kinds of event."""
    kept = [r | {"complete": sorted(kinds)} if r["rec"] == "header" else r for r in lines]
    kept = [{**r} for r in kept if r.get("ev", kinds[0]) in kinds]
    renumber(kept)
    return kept


def judged(folder: Path, lines: list[Json], cut: int, *, marked: bool = False) -> Verdict:
    """The verdict on the log without its first events, with their seq or marked in the header."""
    header, events = lines[0], lines[1 + cut :]
    if marked:
        header = header | {"begins": "running"}
    path = folder / "cut.ndjson"
    path.write_text("".join(json.dumps(line) + "\n" for line in [header, *events]))
    return verdict_of(path)


def two_sessions(folder: Path, seed: int) -> list[list[Json]]:
    """The logs of a run with a pause between two sessions that is longer than the memory."""
    chance = random.Random(seed)
    channel = Channel(loss=chance.choice([0, 0.2]), duplicate=chance.choice([0, 0.2]))
    simulation = Simulation(seed=seed, channel=channel, logs=folder)
    parameters = Parameters(t_timeout=400, t_cam=1000, backoff_max=chance.choice([600, 2000]))
    maneuver_ms = chance.choice([600, 4000])  # one is longer than the memory
    for station in (1001, 2002):
        simulation.add(station, Straight(maneuver_ms=maneuver_ms), parameters)
    for at in (500, 11_000):
        simulation.request(chance.choice([1001, 2002]), at=at)
    if chance.random() < 0.3:
        simulation.restart(2002, at=chance.randrange(600, 5000))
    simulation.run(until=15_000)
    return [records(path) for path in sorted(folder.iterdir())]


def test_a_moment_names_its_event_in_a_log_that_was_cut(tmp_path: Path) -> None:
    """Its station restarts, and timers of before are stopped."""
    lines = two_sessions(tmp_path / "run", 8)[1]
    assert judged(tmp_path, lines, 4, marked=True).judged_from > 2
    log = read(tmp_path / "cut.ndjson")
    moments = timeline(log).moments
    assert len(moments) > 9 and all(log.events[m.at][0] == m.line for m in moments)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", range(4))
def test_no_cut_of_the_corpus_diverges(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    reached = 0
    for file in random.Random(0).sample(GOOD, len(GOOD))[seed::4]:
        lines = records(CORPUS / file)
        if chance.random() < 0.6:
            lines = only(lines, chance.choice(KINDS))
        cuts = range(1, len(lines) - 2)
        for cut in chance.sample(cuts, min(3, len(cuts))):
            verdict = judged(tmp_path, lines, cut, marked=chance.random() < 0.5)
            assert verdict.verdict == "cannot_tell", (file, cut, text(verdict))
            assert "mid-session" in verdict.finding.observed
            reached += verdict.judged_from > 0
    assert reached


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", [0, 1, 2, 1006, 1026, 1027])  # the last restart in the pause
def test_a_cut_log_is_judged_after_a_pause(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    (tmp_path / "run").mkdir()
    for lines in two_sessions(tmp_path / "run", seed):
        parts = [lines, *(only(lines, kinds) for kinds in KINDS)]
        for n, part in enumerate(parts):
            early = [i for i, r in enumerate(part[1:-1]) if i > 0 and r["t_ms"] < 3_000]
            for cut in chance.sample(early, min(3, len(early))):
                verdict = judged(tmp_path, part, cut, marked=chance.random() < 0.5)
                assert verdict.verdict == "cannot_tell", (n, cut, text(verdict))
                assert n or 0 < verdict.judged_from < len(part) - cut, text(verdict)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", range(6))
def test_a_divergence_after_the_part_that_cannot_be_judged_is_found(
    seed: int, tmp_path: Path
) -> None:
    chance = random.Random(seed)
    (tmp_path / "run").mkdir()
    found = 0
    for lines in two_sessions(tmp_path / "run", seed):
        for _ in range(12):
            texts, _, _ = mutated([json.dumps(r) for r in lines], chance.randrange(10**6))
            wrong = [json.loads(line) for line in texts]
            whole = judged(tmp_path, wrong, 0)
            if whole.verdict != "diverges" or whole.finding.at.line < 5:
                continue
            cut = chance.randrange(1, min(whole.finding.at.line - 2, 60))
            part = judged(tmp_path, wrong, cut)
            at = whole.finding.at.line - cut
            if part.judged_from and part.judged_from < at:
                assert (part.verdict, part.finding.at.line) == ("diverges", at), text(part)
                assert part.finding.rule == whole.finding.rule
                assert f"judged from line {part.judged_from} on" in text(part)
                found += 1
            else:
                assert part.verdict == "cannot_tell" or part.finding.at.line > at
    assert found


def test_a_log_that_claims_a_fresh_start_diverges(tmp_path: Path) -> None:
    """Only a cut that the log itself admits is excused."""
    lines = records(CORPUS / "pair/2002.ndjson")
    cut = next(n for n, r in enumerate(lines) if r.get("phase") == "WAITING")
    renumber(kept := [lines[0], *lines[cut + 1 :]])
    assert judged(tmp_path, kept, 0).verdict == "diverges"
    assert judged(tmp_path, kept, 0, marked=True).verdict == "cannot_tell"


def test_the_mark_allows_any_first_seq(tmp_path: Path) -> None:
    lines = records(CORPUS / "pair/2002.ndjson")
    for marked, wanted in ((False, ["seq"]), (True, [])):
        judged(tmp_path, lines, 5, marked=marked)
        found = lint(tmp_path / "cut.ndjson")
        assert [f.rule for f in found if level(f) == "error"] == wanted


def test_it_begins_at_an_input() -> None:
    """An effect may belong to an input before the pause was over."""
    first = records(CORPUS / "pair/2002.ndjson")[0]
    header = Header.model_validate(first | {"parameters": in_header(Parameters().known)})
    start, later = LogStart(header), {"seq": 1, "t_ms": 60_000, "rec": "event", "tx": "2002:1"}
    fin = {"v": 1, "type": "Fin", "src": 1, "dst": 2002, "session": [1, 1], "seq": 2}
    moved = Restart(rec="event", seq=1, t_ms=0, ev="restart", phase="STANDALONE")
    assert LogStart(header).known_before(moved)
    assert not start.known_before(
        Receive(**later | {"t_ms": 0, "phase": "STANDALONE"}, ev="receive", message=fin)
    )
    assert not start.known_before(Send(**later, ev="send", message=fin | {"type": "Ack"}))
    assert start.known_before(Receive(**later, ev="receive", message=fin))


def test_how_long_a_station_remembers() -> None:
    """All timers that may outlive a session; unknown without their parameters."""
    p = Parameters().known
    assert remembered_for(p) == 2100 + 4200
    assert remembered_for(p | {"t_cam_loss": 20_000}) == 20_050
    for name in ("t_giveup", "t_advertise", "t_life", "t_cam_loss", "t_resend"):
        assert remembered_for({k: v for k, v in p.items() if k != name}) is None
