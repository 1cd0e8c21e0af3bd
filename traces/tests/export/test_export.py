"""Logs for other tools: Mermaid, and MCAP there and back."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import pytest

from automcm_maintenance.corpus.corpus_bad import EditedLog as Edited
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain.log_table import Logs
from automcm_traces.export import mcap_file
from automcm_traces.export.mcap_file import McapError
from automcm_traces.export.mermaid import diagram

CORPUS = Path(__file__).parents[2] / "corpus"
PAIR = [CORPUS / "pair/1001.ndjson", CORPUS / "pair/2002.ndjson"]


def drawn(paths: list[Path], most: int = 400, unfold: bool = True) -> list[str]:
    logs = Logs(paths)
    return list(diagram(logs.rows(), logs.stations, most, unfold))


def test_a_diagram_has_a_head_messages_and_phases() -> None:
    """That it has each message is in test_six_views."""
    lines = drawn(PAIR)
    assert lines[:3] == [
        "sequenceDiagram",
        "  participant S1001 as 1001",
        "  participant S2002 as 2002",
    ]
    assert "  S2002-x S1001: Acceptance refuses (unsafe) p1 1001/1#35;2" in lines
    assert "  Note over S2002: = ACTUATING" in lines
    assert not any("CAM" in line for line in lines)


def test_a_long_diagram_is_cut_and_says_so() -> None:
    whole, cut = drawn(PAIR), drawn(PAIR, 10)
    arrows = [line for line in whole if "->>" in line or "-x " in line]
    assert cut[-1] == f"  Note over S1001,S2002: {len(arrows) - 10} more messages are not shown"
    assert sum("->>" in line or "-x " in line for line in cut) == 10


def test_copies_are_one_arrow_and_the_omitted_messages_are_counted() -> None:
    lines = drawn(PAIR, unfold=False)
    assert "  S1001->>S2002: Advertisement 1001/1#35;1 \u00d74" in lines
    notes = [line for line in drawn(PAIR) if "Note" in line]
    assert [line for line in lines if "Note" in line] == notes  # no phase is lost
    cut = drawn(PAIR, 5, unfold=False)[-1]
    whole = [line for line in drawn(PAIR) if re.search(r">>|-x |\)S", line)]
    kept = [line for line in drawn(PAIR, 5, unfold=False) if re.search(r">>|-x |\)S", line)]
    copies = [int(n) for line in kept for n in re.findall("\u00d7([0-9]+)", line)]
    number = len(kept) + sum(copies) - len(copies)
    assert cut == f"  Note over S1001,S2002: {len(whole) - number} more messages are not shown"


def test_a_copy_that_changes_the_phase_is_no_copy(tmp_path: Path) -> None:
    lines = [json.loads(line) for line in PAIR[1].read_text().splitlines()]
    copies = [r for r in lines if r.get("message", {}).get("type") == "Advertisement"]
    copies[-1]["phase"] = "CHOOSING"
    (tmp_path / "2002.ndjson").write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert "  Note over S2002: = CHOOSING" in drawn([tmp_path / "2002.ndjson"], unfold=False)


def test_no_text_of_a_log_is_mermaid(tmp_path: Path) -> None:
    """A semicolon ends a line in Mermaid, a hash begins a code; a line feed must not come."""
    log = Edited(PAIR[1].read_bytes())
    line = log.find("send", type="Acceptance", reason="unsafe")
    log.at(line)["message"]["reason"] = "a;b\nS9->>S1: <img>#"
    (tmp_path / "odd.ndjson").write_bytes(log.text())
    lines = drawn([tmp_path / "odd.ndjson"])
    (odd,) = [line for line in lines if "img" in line]
    label = odd.split(": ", 1)[1]
    assert re.sub(r"#(\w+);", "", label).count(";") == 0
    assert "<" not in label
    assert not any("\n" in line for line in lines)


def test_an_mcap_gives_back_the_same_logs(tmp_path: Path) -> None:
    """Byte for byte, also what has no type: an event of an unknown kind, an incomplete line."""
    pytest.importorskip("mcap")
    log = tmp_path / "1.ndjson"
    head, first, *more = PAIR[0].read_bytes().splitlines(keepends=True)
    unknown = json.dumps(json.loads(first) | {"ev": "battery", "volt": 12, "raw": "\u2028"})
    later = [re.sub(rb'"seq":1,', b'"seq":2,', line, count=1) for line in [first]]
    log.write_bytes(b"".join([head, unknown.encode() + b"\r\n", *later, more[-1][:9]]))
    logs = [*PAIR, log]
    data = mcap_file.written(logs)
    assert data == mcap_file.written(logs)
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    assert mcap_file.logs(path) == {p.name: p.read_bytes() for p in logs}


def test_an_mcap_has_a_json_channel_with_a_schema_and_times_for_each_station() -> None:
    reader = pytest.importorskip("mcap.reader")
    found = list(reader.make_reader(io.BytesIO(mcap_file.written(PAIR))).iter_messages())
    assert {channel.topic for _, channel, _ in found} == {
        "/automcm/1001",
        "/automcm/2002",
        "/automcm_arrows",
    }
    assert {schema.encoding for schema, _, _ in found} == {"jsonschema"}
    assert json.loads(found[0][0].data)["type"] == "object"
    for _, _, message in found:
        line = json.loads(message.data)
        if line.get("rec") == "event":
            assert message.log_time == line["t_ms"] * 1_000_000


def test_what_is_no_mcap_is_one_clear_error(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    whole = mcap_file.written(PAIR)
    for n, data in enumerate([b"", b"rubbish", whole[:3000], bytes(len(whole)), whole[:-20]]):
        path = tmp_path / f"{n}.mcap"
        path.write_bytes(data)
        with pytest.raises(McapError, match=f"{n}.mcap") as error:
            mcap_file.logs(path)
        assert "\n" not in str(error.value)


def test_the_name_of_a_channel_leaves_the_folder_alone(tmp_path: Path) -> None:
    writer = pytest.importorskip("mcap.writer")
    stream = io.BytesIO()
    w = writer.Writer(stream)
    w.start()
    for station, file in ((1, "../../up.ndjson"), (2, "up.ndjson"), (3, "/etc/x")):
        topic = f"/automcm/{station}"
        channel = w.register_channel(topic, "json", 0, metadata={"file": file})
        w.add_message(channel, 0, b"{}", 0)
    w.finish()
    path = tmp_path / "foreign.mcap"
    path.write_bytes(stream.getvalue())
    assert sorted(mcap_file.logs(path)) == ["3.ndjson", "up-2.ndjson", "up.ndjson"]


def test_a_log_that_cannot_be_read_does_not_become_an_mcap() -> None:
    pytest.importorskip("mcap")
    with pytest.raises(BadInput):
        mcap_file.written([CORPUS / "bad/time_backwards.ndjson"])


def test_without_the_extra_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr("automcm_traces.export.mcap_file.importlib.import_module", missing)
    with pytest.raises(McapError, match=r"pip install 'automcm\[mcap\]'"):
        mcap_file.written(PAIR)
