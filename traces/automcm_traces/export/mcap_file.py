"""Converts logs to MCAP, for Foxglove and similar tools, and back: one JSON channel per station.

Every line of a log becomes a message, with its line feed, whatever it contains: nothing is lost.
One more channel has the fate of each message.
The log time is ``t_ms``, because the absolute time is unknown. Needs the extra ``mcap``.
"""

from __future__ import annotations

import importlib
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from automcm_spec.log_format import log_schema
from automcm_spec.log_format.event_text import summary
from automcm_spec.log_format.log import SCHEMA
from automcm_spec.log_format.reader import header_of, records
from automcm_spec.support.bad_input import name_of, one_line
from automcm_traces.explain.log_table import arrow_rows

TOPIC = "/automcm/"
"""The name of a channel is this and the id of its station."""
ARROWS = "/automcm_arrows"
"""The channel of the fates of all messages."""
ARROW = {
    "title": "automcm.arrow/1",
    "type": "object",
    "properties": {
        **{name: {"type": "integer"} for name in ("from", "to", "station", "line")},
        **{name: {"type": "string"} for name in ("fate", "reason", "file", "event")},
    },
}
"""``station`` and ``line`` are those of the event where the message arrives, or, if it never does,
where it leaves; ``event`` is its summary. Only a rejected message has a ``reason``."""
LATEST_MS = 2**63 // 10**6
"""The latest time: MCAP counts nanoseconds in 64 bits."""


class McapError(Exception):
    """The extra is not installed, or a file is not an MCAP with logs; the text is one line."""


def _module(name: str) -> Any:
    try:
        return importlib.import_module(f"mcap.{name}")
    except ImportError:
        raise McapError("the package mcap is missing: pip install 'automcm[mcap]'") from None


def _line_schema() -> dict[str, Any]:
    """A simple schema of a line for viewers: the fields of all records."""
    records = (each.get("properties", {}) for each in log_schema.schema()["$defs"].values())
    fields = {
        name: {"type": "object"} | {key: of[key] for key in ("type", "items") if key in of}
        for record in records
        if "rec" in record
        for name, of in record.items()
    }
    return {"title": SCHEMA, "type": "object", "properties": fields}


def written(paths: Sequence[Path]) -> bytes:
    """The logs as one MCAP; equal logs give equal bytes.

    Raises McapError, OSError, and BadInput for a log that cannot be read to its end.
    """
    library = _module("writer")
    stream = io.BytesIO()
    writer = library.Writer(stream, compression=library.CompressionType.NONE)
    writer.start(profile="", library="automcm")
    schema = writer.register_schema(
        name=SCHEMA, encoding="jsonschema", data=json.dumps(_line_schema()).encode()
    )
    for path in paths:
        channel = writer.register_channel(
            topic=f"{TOPIC}{header_of(path).station}",
            message_encoding="json",
            schema_id=schema,
            metadata={"file": Path(name_of(path)).name},
        )
        times = {n: getattr(record, "t_ms", 0) for n, record in records(path)}
        t_ms = 0
        with open(path, "rb") as lines:
            for number, line in enumerate(lines, 1):
                t_ms = max(t_ms, times[number])
                if t_ms > LATEST_MS:
                    raise McapError(
                        f"{name_of(path)}:{number}: t_ms: must be at most {LATEST_MS} ms for MCAP, "
                        f"not {t_ms} ms"
                    )
                now = t_ms * 10**6
                writer.add_message(channel, now, line, now, sequence=number)
    _add_arrows(writer, paths)
    writer.finish()
    return stream.getvalue()


def _add_arrows(writer: Any, paths: Sequence[Path]) -> None:
    schema = writer.register_schema(
        name=ARROW["title"], encoding="jsonschema", data=json.dumps(ARROW).encode()
    )
    channel = writer.register_channel(topic=ARROWS, message_encoding="json", schema_id=schema)
    for path, row in arrow_rows(paths):
        event = row.event
        assert event is not None, "a row with arrows has an event"
        place = {"file": Path(name_of(path)).name, "station": row.station, "line": row.line}
        for arrow in row.arrows:
            data = json.dumps(arrow.as_dict() | place | {"event": summary(event)}).encode()
            now = event.t_ms * 10**6
            writer.add_message(channel, now, data, now, sequence=row.line)


def logs(path: Path) -> dict[str, bytes]:
    """The logs in an MCAP, by file name.

    Raises OSError, and McapError if it contains none.
    """
    reader = _module("reader")
    found: dict[int, tuple[str, list[tuple[int, bytes]]]] = {}
    with open(path, "rb") as stream:
        try:
            messages = list(reader.make_reader(stream).iter_messages(log_time_order=False))
        except Exception as error:  # a broken file makes the library raise any exception
            text = f"{type(error).__name__}: {error}"
            raise McapError(one_line(f"{path}: cannot be read as MCAP: {text}")) from None
    for _, channel, message in messages:
        if channel.topic.startswith(TOPIC) and channel.message_encoding == "json":
            name = _name(channel.topic, channel.metadata.get("file", ""))
            _, lines = found.setdefault(channel.id, (name, []))
            lines.append((message.sequence, bytes(message.data)))
    if not found:
        raise McapError(f"{path}: contains no JSON channel named {TOPIC}STATION")
    texts: dict[str, bytes] = {}
    for id_, (name, lines) in found.items():
        if name in texts:
            name = f"{Path(name).stem}-{id_}.ndjson"
        *before, last = (line for _, line in sorted(lines))
        texts[name] = b"".join(line.removesuffix(b"\n") + b"\n" for line in before) + last
    return texts


def _name(topic: str, file: str) -> str:
    """A file name for a channel: that of the original log, without its folder."""
    name = Path(file.replace("\\", "/")).name
    if not name.endswith(".ndjson") or not name.isprintable():
        station = topic.removeprefix(TOPIC)
        name = f"{station if station.isalnum() else 'log'}.ndjson"
    return name
