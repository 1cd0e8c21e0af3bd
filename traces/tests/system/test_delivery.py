"""What became of each message; each class seen in a run or in an edited log."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from merged_runs import Run, killed, plain, records, rewritten, without_tx

from automcm.links.simulated_radio import Channel
from automcm_spec.log_format.log import Send
from automcm_spec.log_format.reader import Log, read
from automcm_traces.system.delivery import counts, forged, forged_receptions, outcomes
from automcm_traces.system.fates import ANYONE
from automcm_traces.system.log_merge import Merged, merge


def counted(merged: Merged) -> Counter[str]:
    return Counter(outcome for *_, outcome in outcomes(merged))


def between(merged: Merged, src: int, dst: int) -> Counter[str]:
    return Counter(counts(merged).get(f"{src}-{dst}"))


@pytest.mark.parametrize("seed", range(2))
def test_what_is_lost_is_what_the_radio_lost(tmp_path: Path, seed: int) -> None:
    """Losses end early enough that every one is certain, but for what was sent before the first
    event of a log."""
    chance = random.Random(seed)
    run = Run(tmp_path, seed=seed, drop=lambda s, d, m, now: now < 3000 and chance.random() < 0.3)
    found = merge(run.logs())
    n = counted(found)
    assert n["lost"] + n["unobserved"] == run.lost > 50 and n["unobserved"] <= 2
    assert not found.forged and not n["duplicated"]
    assert n["delivered"] + n["in_flight"] == sum(n.values()) - run.lost
    assert n["in_flight"] <= 6


def test_what_is_doubled_is_duplicated(tmp_path: Path) -> None:
    found = merge(Run(tmp_path, channel=Channel(duplicate=1.0)).logs())
    n = counted(found)
    assert n["duplicated"] > 200 and n["lost"] == 0


def test_without_ids_the_numbers_are_the_same(tmp_path: Path) -> None:
    chance = random.Random(1)
    run = Run(tmp_path, drop=lambda s, d, m, now: now < 3000 and chance.random() < 0.3)
    named = merge(run.logs())
    unnamed = merge([without_tx(tmp_path / f"{n}.ndjson") for n in (1, 2, 3)])
    assert counts(unnamed) == counts(named) and not unnamed.forged


def test_a_log_that_stops_leaves_messages_in_flight(tmp_path: Path) -> None:
    one, _, three = plain(tmp_path)
    found = merge([one, killed(tmp_path / "2.ndjson", 3000), three])
    late = between(found, 1, 2)
    assert late["lost"] == 0 and late["in_flight"] > 50
    arrows = merge([one, killed(tmp_path / "2.ndjson", 3000), three]).arrows()
    from_dead = [a for a in arrows if a.source == 2 and a.fate == "sender_unobserved"]
    assert len(from_dead) > 50 and not found.forged  # sent after its log stops


def test_what_was_sent_before_a_log_begins_is_not_observed(tmp_path: Path) -> None:
    one, _, three = plain(tmp_path)
    lines = [r for r in records(tmp_path / "2.ndjson") if r.get("t_ms", 0) >= 6000]
    header = records(tmp_path / "2.ndjson")[0]
    late = rewritten(tmp_path / "2.ndjson", [header, *lines])  # without its end
    n = between(merge([one, late, three]), 1, 2)
    assert n["lost"] == 0 and n["unobserved"] > 50 and n["delivered"] > 15


def test_an_addressee_without_a_log_is_not_observed(tmp_path: Path) -> None:
    one, _, three = plain(tmp_path)
    found = merge([one, three])
    n = between(found, 1, 2)
    assert n["unobserved"] == sum(n.values()) > 2
    fates = {(a.source, a.fate) for a in merge([one, three]).arrows() if a.leaves is None}
    assert fates == {(2, "sender_unobserved")} and not found.forged


def partial(path: Path, *kinds: str) -> Log:
    lines = records(path)
    lines[0]["complete"] = list(kinds)
    return rewritten(path, lines)


def test_a_log_that_does_not_promise_its_receptions_loses_nothing(tmp_path: Path) -> None:
    run = Run(tmp_path, drop=lambda src, dst, m, now: now < 3000)
    one, _, three = run.logs()
    two = partial(tmp_path / "2.ndjson", "send")
    n = between(merge([one, two, three]), 1, 2)
    assert n["lost"] == 0 and n["unobserved"] > 20


def edit(path: Path, number: int, **change: Any) -> Log:
    lines = records(path)
    record = [r for r in lines if r.get("ev") == "receive"][number]
    record |= change
    return rewritten(path, lines)


def test_a_message_that_its_sender_did_not_send_is_forged(tmp_path: Path) -> None:
    one, _, three = plain(tmp_path)
    lines = records(tmp_path / "2.ndjson")
    record = next(r for r in lines if r.get("ev") == "receive")
    content = record["message"] | {"x_mm": 123}
    number = lines.index(record) + 1
    two = edit(tmp_path / "2.ndjson", 0, message=content)
    (text,) = forged(merge([one, two, three]))
    assert text.startswith(f"{two.file}:{number}: FORGED CAM")
    assert text.endswith("has another message under this tx")
    two = edit(tmp_path / "2.ndjson", 0, tx=f"{content['src']}:999999")
    (text,) = forged(merge([one, two, three]))
    assert text.endswith("contains no such sent message")


def test_a_sender_that_does_not_promise_its_sendings_forges_nothing(tmp_path: Path) -> None:
    _, two, three = plain(tmp_path)
    lines = records(tmp_path / "1.ndjson")
    lines[0]["complete"] = ["receive"]
    one = rewritten(tmp_path / "1.ndjson", [r for r in lines if r.get("ev") != "send"])
    found = merge([one, two, three])
    assert not found.forged and not forged_receptions(merge([one, two, three]))
    fates = {(a.source, a.fate) for a in merge([one, two, three]).arrows() if a.leaves is None}
    assert fates == {(1, "sender_unobserved")}


def test_forged_receptions_of_a_log_that_stops_go_as_far_as_it_does(tmp_path: Path) -> None:
    one, _, three = plain(tmp_path)
    dead = killed(tmp_path / "2.ndjson", 3000)
    assert not forged_receptions(merge([one, dead, three]))
    lines = records(tmp_path / "2.ndjson")
    del lines[next(n for n, r in enumerate(lines) if r.get("ev") == "send")]
    assert forged_receptions(merge([one, rewritten(tmp_path / "2.ndjson", lines), three]))


def test_a_log_that_lost_records_proves_nothing(tmp_path: Path) -> None:
    one, _, three = Run(tmp_path, drop=lambda src, dst, m, now: now < 3000).logs()
    lines = records(tmp_path / "2.ndjson")
    lines[-1]["lost_records"] = 1
    found = merge([one, rewritten(tmp_path / "2.ndjson", lines), three])
    assert between(found, 1, 2)["lost"] == 0 < between(found, 1, 3)["lost"]
    del lines[next(n for n, r in enumerate(lines) if r.get("ev") == "send")]
    assert not merge([one, rewritten(tmp_path / "2.ndjson", lines), three]).forged


def test_one_log_shows_its_messages_to_anyone_and_the_copies_that_it_received(
    tmp_path: Path,
) -> None:
    one = Run(tmp_path, channel=Channel(duplicate=1.0)).logs()[0]
    arrows = list(merge([one]).arrows())
    got = Counter(arrow.fate for arrow in arrows if arrow.arrives)
    assert got.keys() == {"sender_unobserved", "duplicated"}
    assert abs(got["duplicated"] - got["sender_unobserved"]) < 5
    sent = [arrow for arrow in arrows if arrow.leaves]
    assert {arrow.fate for arrow in sent} == {"unobserved"}
    assert {arrow.to for arrow in sent} == {ANYONE, 2, 3}
    assert len(sent) == sum(isinstance(e, Send) for _, e in one)


def test_a_message_to_its_own_sender_is_no_arrow(tmp_path: Path) -> None:
    plain(tmp_path)
    lines = records(tmp_path / "1.ndjson")
    before = len([*merge([read(tmp_path / "1.ndjson")]).arrows()])
    next(r for r in lines if r.get("message", {}).get("dst") == 2)["message"]["dst"] = 1
    assert len([*merge([rewritten(tmp_path / "1.ndjson", lines)]).arrows()]) == before - 1
