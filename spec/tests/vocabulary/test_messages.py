"""The messages on the wire: round trips, and refusals that name the field."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, get_args

import pytest
from automcm_stage import ack, advertisement, cam, cancel, fin, intention, no, prescription, yes
from hypothesis import given, settings
from hypothesis import strategies as st

from automcm_spec.vocabulary import messages

SMALL, BIG = -(2**40), 2**40
ids = st.integers(1, 2**32 - 1)
naturals = st.integers(0, BIG)
positive = st.integers(1, BIG)
anything = st.integers(SMALL, BIG)
sessions = st.tuples(ids, positive)
points = st.lists(st.tuples(anything, anything, anything), min_size=1, max_size=4).map(tuple)
trajectories = st.builds(messages.Trajectory, t0=anything, points=points)
texts = st.text(max_size=8)
values = st.recursive(
    st.booleans() | anything | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=6,
)
details = st.dictionaries(texts, values, max_size=3)
FIELDS: dict[str, st.SearchStrategy[Any]] = {
    **dict.fromkeys(("src", "dst"), ids),
    **dict.fromkeys(("seq", "proposal", "lease_ms"), positive),
    **dict.fromkeys(("hold_ms", "generation_ms"), naturals),
    **dict.fromkeys(("x_mm", "y_mm", "heading_mrad", "speed_mm_s"), anything),
    **dict.fromkeys(("planned", "prescribed"), trajectories),
    **dict.fromkeys(("length_mm", "width_mm"), st.none() | st.integers(100, 102_100)),
    "station_type": st.none() | st.integers(0, 255),
    "sigma_mm": st.none() | naturals,
    "session": sessions,
    "scenario": texts,
    "details": details,
    "of": st.builds(
        messages.MessageId, type=st.sampled_from(get_args(messages.MessageType)), seq=naturals
    ),
    "marks": st.lists(sessions, max_size=3).map(tuple),
}


def built(model: Any, **fields: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Messages of this type, whose other fields are any that ``FIELDS`` has."""
    names = model.model_fields.keys() - ({"dst"} if model is messages.Advertisement else set())
    return st.builds(model, **{n: s for n, s in FIELDS.items() if n in names} | fields)


def of_reasons(model: Any, reasons: Any, **fields: Any) -> st.SearchStrategy[Any]:
    """The seq of an answer is 0 (END-6)."""
    return st.sampled_from(get_args(reasons)).flatmap(
        lambda reason: built(
            model,
            reason=st.just(reason),
            seq=st.just(0) if reason in messages.ANSWER_REASONS else positive,
            **fields,
        )
    )


BY_TYPE = {
    "Advertisement": built(messages.Advertisement, planned=st.none() | trajectories),
    "Intention": built(messages.Intention),
    "Prescription": built(messages.Prescription),
    "Acceptance": built(messages.Acceptance, accepted=st.just(True), selected=trajectories)
    | of_reasons(messages.Acceptance, messages.RefusalReason, accepted=st.just(False)),
    "Fin": built(messages.Fin),
    "Cancel": of_reasons(messages.Cancel, messages.CancelReason),
    "Ack": built(messages.Ack, seq=st.just(0)),
    "CAM": built(messages.Cam),
}
ONE_OF_EACH: list[messages.Message | messages.Cam] = [
    advertisement(),
    intention(),
    prescription(),
    yes(),
    no(),
    fin(),
    cancel(),
    ack(fin()),
    cam(1, 0, (9, 1)),
]
LORRY = {"length_mm": 16_500, "width_mm": 2_550}
WITH_EXTENT: list[messages.Message | messages.Cam] = [
    intention(**LORRY),
    cam(1, 0, (9, 1)).model_copy(update=LORRY | {"station_type": 8, "sigma_mm": 700}),
]


@pytest.mark.parametrize("type_", BY_TYPE)
def test_every_message_survives_the_wire(type_: str) -> None:
    @settings(derandomize=True, max_examples=60, deadline=None, database=None)
    @given(BY_TYPE[type_])
    def survives(message: messages.Message | messages.Cam) -> None:
        data = messages.encode(message)
        assert messages.decode(data) == message
        assert messages.decode(data.decode()) == message
        assert messages.encode(messages.decode(data)) == data
        assert json.loads(data) == messages.to_dict(message)

    survives()


@pytest.mark.parametrize("message", ONE_OF_EACH, ids=lambda m: m.type)
def test_bytes_are_compact_and_absent_fields_left_out(
    message: messages.Message | messages.Cam,
) -> None:
    data = messages.encode(message)
    assert data == json.dumps(json.loads(data), separators=(",", ":")).encode()
    assert b"null" not in data
    assert b'"dst":0' not in data


def test_field_order_on_the_wire_does_not_matter_but_what_is_sent_is_canonical() -> None:
    data = messages.encode(prescription())
    backwards = json.dumps(dict(reversed(json.loads(data).items())), indent=2)
    assert messages.encode(messages.decode(backwards)) == data


def test_canonical_bytes_of_an_ack_and_a_broadcast() -> None:
    assert messages.encode(ack(fin())) == (
        b'{"v":1,"src":1,"dst":9,"session":[9,1],"seq":0,"type":"Ack","of":{"type":"Fin","seq":7}}'
    )
    assert messages.encode(advertisement()) == (
        b'{"v":1,"src":9,"session":[9,1],"seq":1,"type":"Advertisement",'
        b'"scenario":"lane_change","details":{}}'
    )


def changed(message: messages.Message | messages.Cam, **fields: Any) -> bytes:
    return json.dumps(messages.to_dict(message) | fields).encode()


def without(message: messages.Message | messages.Cam, name: str) -> bytes:
    return json.dumps({k: v for k, v in messages.to_dict(message).items() if k != name}).encode()


def refused(data: bytes | str, text: str) -> None:
    """``data`` is no message, and the error names this field, or says this."""
    with pytest.raises(
        messages.MessageError, match=text if " " in text else rf"(^|[ .]){text}(\.\S*)?: "
    ):
        messages.decode(data)


NEEDED = [
    (message, name)
    for message in ONE_OF_EACH
    for name in messages.to_dict(message)
    # dst is absent in a broadcast; v and an Ack's seq can have one value only; reason and
    # selected are looked at below
    if name not in ("v", "dst", "type", "reason", "selected")
    and (message.type, name) != ("Ack", "seq")
] + [(cancel(), "reason")]
INTEGERS = [
    (m, n)
    for m in [*ONE_OF_EACH, *WITH_EXTENT]
    for n, value in messages.to_dict(m).items()
    if type(value) is int and n != "v" and (m.type, n) != ("Ack", "seq")
]
TYPED = [(m, n) for m, n in NEEDED if n != "details"] + [(m, "v") for m in ONE_OF_EACH]
NO_WAY_TO_LEAVE_OUT = [
    (advertisement(), "planned"),
    (advertisement(), "dst"),
    (yes(), "reason"),
    (no(), "selected"),
]
WRONG: list[tuple[messages.Message | messages.Cam, str, Any]] = [
    *((m, n, None) for m, n in TYPED + NO_WAY_TO_LEAVE_OUT),
    *((m, n, value) for m, n in INTEGERS for value in ("1", 1.0, 1.5, True, [1], {})),
    *((m, "extra", 1) for m in ONE_OF_EACH),
    *((m, "dst", 0) for m in ONE_OF_EACH[:-1]),
    *((fin(), "v", v) for v in (2, "1", True, 1.0)),
    *((fin(), "src", src) for src in (0, 2**32, -1)),
    (fin(), "dst", 2**32),
    *((fin(), "session", s) for s in ([9], [9, 1, 1], [0, 1], [9, 0], "9,1", [9, "1"])),
    (advertisement(), "scenario", 1),
    (advertisement(), "details", []),
    (prescription(), "proposal", 0),
    (prescription(), "hold_ms", -1),
    (prescription(), "lease_ms", 0),
    *((yes(), "accepted", value) for value in (1, "true")),
    (no(), "reason", "tired"),
    (cancel(), "reason", "unsafe"),
    *((ack(fin()), "seq", seq) for seq in (False, 0.0, 1, None)),
    *(
        (ack(fin()), "of", of)
        for of in ({"type": "CAM", "seq": 1}, {"type": "Fin"}, {"type": "Fin", "seq": -1})
    ),
    (cam(1, 0), "marks", [[9]]),
    (cam(1, 0), "generation_ms", -1),
    *((m, n, v) for m in WITH_EXTENT for n in LORRY for v in (None, -4500, 0, 99, 102_101)),
    *((cam(1, 0), "station_type", value) for value in (None, -1, 256)),
    *((cam(1, 0), "sigma_mm", value) for value in (None, -1, messages.LIMIT + 1)),
    *((m, n, 500) for m in ONE_OF_EACH for n in LORRY if m.type not in ("CAM", "Intention")),
    *((m, n, 5) for m in ONE_OF_EACH[:-1] for n in ("station_type", "sigma_mm")),
    (intention(), "planned", []),
    *(
        (intention(), "planned", {"t0": 0, "points": points})
        for points in ([], [[0, 0]], [[0, 0, 0, 0]], [[0, 0, 0.5]], [[0, 0, "0"]], [[0, 0, None]])
    ),
    (intention(), "planned", {"t0": 0}),
    (intention(), "planned", {"points": [[0, 0, 0]]}),
    (intention(), "planned", {"t0": 0, "points": [[0, 0, 0]], "v": 1}),
]
ANSWER = "seq: must be 0 if and only if"
TOGETHER = "must be present if and only if"
REFUSED: list[tuple[bytes, str]] = [
    *((without(m, n), n) for m, n in NEEDED),
    *((without(ack(fin()), n), n) for n in ("v", "seq")),
    *((changed(m, **{n: value}), n) for m, n, value in WRONG),
    *((changed(m, seq=0), "seq") for m in [*ONE_OF_EACH[:5], fin(), cancel()]),
    *((changed(no(reason=r), seq=1), ANSWER) for r in ("busy", "unknown_session")),
    (changed(cancel("closed"), seq=1), ANSWER),
    (without(no(), "reason"), f"reason: {TOGETHER}"),
    (changed(yes(), reason="unsafe"), f"reason: {TOGETHER}"),
    (without(yes(), "selected"), f"selected: {TOGETHER}"),
    (changed(no(), selected=messages.to_dict(yes())["selected"]), f"selected: {TOGETHER}"),
    (changed(no(), accepted=True), f"reason: {TOGETHER}"),
    (changed(yes(), accepted=False), f"reason: {TOGETHER}"),
    (changed(advertisement(), details={"lanes": [1, None]}), "lanes"),
]
"""What breaks the grammar, and the field or the text in the error; END-5, END-6."""


@pytest.mark.parametrize(("data", "text"), REFUSED, ids=range(len(REFUSED)))
def test_end_5_end_6_what_breaks_the_grammar_is_refused_by_name(data: bytes, text: str) -> None:
    refused(data, text)


@pytest.mark.parametrize(
    ("fields", "extent"),
    [
        ({}, messages.CAR_MM),
        ({"station_type": 5}, messages.CAR_MM),
        ({"station_type": 1}, messages.CAR_MM),
        ({"station_type": 200}, messages.CAR_MM),
        ({"station_type": 8}, (18_750, 2_600)),
        ({"station_type": 8, "length_mm": 9_000}, (9_000, 2_600)),
        ({"station_type": 7, "width_mm": 2_000}, (7_500, 2_000)),
        (LORRY, (16_500, 2_550)),
        (LORRY | {"station_type": 5}, (16_500, 2_550)),
    ],
)
def test_an_absent_extent_is_that_of_the_station_type(
    fields: dict[str, int], extent: tuple[int, int]
) -> None:
    read = messages.decode(changed(cam(1, 0), **fields))
    assert isinstance(read, messages.Cam) and read.extent_mm == extent


def test_the_page_has_the_same_assumed_extents() -> None:
    page = (Path(__file__).parents[3] / "docs" / "protocol.md").read_text()
    rows = re.findall(r"^\| (.*) \| (\d+) \W (\d+) \|", page, re.MULTILINE)
    found = {n: (int(length), int(width)) for text, length, width in rows for n in numbers(text)}
    assert found == {None: messages.CAR_MM} | messages.EXTENTS_MM


def numbers(text: str) -> list[int | None]:
    """The station types that a row names; None for all that no row names."""
    return [int(n) for n in re.findall(r"\d+", text)] or [None]


def test_the_word_null_in_a_text_is_no_null() -> None:
    assert messages.decode(changed(advertisement(), details={"lane": "null"}))


@pytest.mark.parametrize("type_", ["Hello", "cam", "", 1, None, ["Fin"]])
def test_an_unknown_type_is_refused(type_: Any) -> None:
    with pytest.raises(messages.MessageError, match="type"):
        messages.decode(changed(fin(), type=type_))
    with pytest.raises(messages.MessageError, match="type"):
        messages.decode(without(fin(), "type"))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"hello",
        b"null",
        b"[]",
        b"1",
        b'"Fin"',
        b"\x00\x01\x02",
        b"\xff\xfe\xfd",
        messages.encode(fin())[:-1],
        messages.encode(fin()) + b"}",
        messages.encode(fin()) * 2,
        b"[" * 100_000,
        b"x" * 1_000_000,
        b"9" * 100_000,
    ],
    ids=range(14),
)
def test_what_is_no_json_object_is_refused(data: bytes) -> None:
    with pytest.raises(messages.MessageError, match=r"^message: "):
        messages.decode(data)


def test_a_huge_message_is_read_or_refused_like_any_other() -> None:
    long = messages.Trajectory(t0=0, points=((0, 0, 0),) * 50_000)
    assert messages.decode(messages.encode(intention(planned=long))) == intention(planned=long)
    refused(changed(fin(), extra="x" * 1_000_000), "extra")
    refused(changed(advertisement(), details={"n": 0}, extra=list(range(100_000))), "extra")


@settings(derandomize=True, max_examples=200, deadline=None, database=None)
@given(st.sampled_from(ONE_OF_EACH), st.integers(0, 400), st.integers(0, 255))
def test_end_5_a_flipped_byte_is_refused_or_gives_a_whole_message(
    message: messages.Message, place: int, byte: int
) -> None:
    data = bytearray(messages.encode(message))
    data[place % len(data)] = byte
    try:
        read = messages.decode(bytes(data))
    except messages.MessageError:
        return
    assert messages.decode(messages.encode(read)) == read
