"""Both codecs: round trips, refused bytes and sizes."""

from __future__ import annotations

import builtins
import itertools
import sys
from functools import cache
from typing import Any, get_args

import asn1tools
import pytest
from automcm_stage import advertisement, cam, fin, intention
from encoded_examples import EXAMPLES
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from test_messages import BY_TYPE, changed

from automcm.encoding.codec import FRAME_BYTES, JSON, Codec, CodecError, codec
from automcm.encoding.uper import MAX_POINTS, SCHEMA, UPER
from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_spec.vocabulary.messages import (
    LIMIT,
    MAX_BYTES,
    MAX_DEPTH,
    MAX_MARKS,
    MESSAGE,
    Cam,
    CancelReason,
    Message,
    MessageError,
    MessageType,
    RefusalReason,
    Trajectory,
    decode,
    encode,
    to_dict,
)

EXTRAS = Cam.model_fields.keys() - to_dict(cam(1, 0)).keys()
BOTH: list[Codec] = [JSON, UPER]


def refused(used: Codec, data: bytes, text: str) -> None:
    with pytest.raises(MessageError) as error:
        used.decode(data)
    assert text in str(error.value), str(error.value)


@pytest.mark.parametrize("used", BOTH, ids=lambda c: c.name)
@pytest.mark.parametrize("type_", BY_TYPE)
def test_every_message_survives_both_codecs(type_: str, used: Codec) -> None:
    @settings(derandomize=True, max_examples=20, deadline=None, database=None)
    @given(BY_TYPE[type_])
    def survives(message: Message | Cam) -> None:
        data = used.encode(message)
        assert used.decode(data) == message
        assert used.encode(used.decode(data)) == data
        assert codec("json").encode(used.decode(data)) == encode(message)

    survives()


@pytest.mark.parametrize("used", BOTH, ids=lambda c: c.name)
@pytest.mark.parametrize("message", EXAMPLES, ids=lambda m: m.type)
def test_every_reason_and_form_survives(message: Message | Cam, used: Codec) -> None:
    assert used.decode(used.encode(message)) == message


numbers = st.integers(-LIMIT, LIMIT)
near = st.sampled_from([2**n + d for n in (7, 8, 11, 13, 15, 16, 31, 32) for d in (-1, 0, 1)])
steps = st.tuples(*[near | near.map(int.__neg__) | numbers] * 3)


@given(numbers, st.lists(steps, min_size=1, max_size=5).map(tuple), st.booleans())
def test_uper_loses_nothing_of_any_trajectory(
    t0: int, moves: tuple[tuple[int, int, int], ...], relative: bool
) -> None:
    points = moves
    if relative:
        sums = (itertools.accumulate(each) for each in zip(*moves, strict=True))
        points = tuple((t, x, y) for t, x, y in zip(*sums, strict=True))
        points = tuple(p for p in points if max(map(abs, p)) <= LIMIT) or ((0, 0, 0),)
    message = intention(planned=Trajectory(t0=t0, points=points))
    assert UPER.decode(UPER.encode(message)) == message


@pytest.mark.parametrize(
    ("dt", "dx", "short"),
    [
        (2047, 0, True),
        (2048, 0, False),
        (-1, 0, False),
        (0, 8191, True),
        (0, 8192, False),
        (0, -8192, True),
        (0, -8193, False),
    ],
)
def test_a_step_takes_five_bytes_where_it_fits(dt: int, dx: int, short: bool) -> None:
    start = (10**5, 10**5, 10**5)
    one = UPER.encode(intention(planned=Trajectory(t0=0, points=(start,))))
    end = (start[0] + dt, start[1] + dx, start[2])
    moved = intention(planned=Trajectory(t0=0, points=(start, end)))
    data = UPER.encode(moved)
    assert (len(data) == len(one) + 5) == short
    assert UPER.decode(data) == moved


def test_uper_of_a_fin_is_known() -> None:
    # v 4 bits 0, body 3 bits 4 (fin), dst present, src-1, dst-1, 9-1, n8 1, n8 7
    bits = "00001001" + f"{8:032b}{0:032b}{8:032b}" + f"00{1:08b}" + f"00{7:08b}"
    assert UPER.encode(fin()) == int(bits.ljust(128, "0"), 2).to_bytes(16, "big")


def test_what_the_schema_enumerates_is_what_the_models_allow() -> None:
    types = asn1tools.parse_files([str(SCHEMA)])["AutoMCM"]["types"]

    def values(name: str) -> list[str]:
        return [value for value, _ in types[name]["values"]]

    assert values("MessageType") == [name.lower() for name in get_args(MessageType)]
    for name, reasons in (("RefusalReason", RefusalReason), ("CancelReason", CancelReason)):
        assert values(name) == [reason.replace("_", "-") for reason in get_args(reasons)]


@cache
def schema() -> Any:
    """The schema as asn1tools compiles it."""
    return asn1tools.compile_files(str(SCHEMA), "uper")


def packed(**fields: Any) -> bytes:
    """A Fin with other content than ours, as asn1tools encodes it."""
    header = {"src": 9, "dst": 1, "session": {"prescriber": 9, "number": ("n8", 1)}}
    body = {"header": header, "seq": ("n8", 7)} | fields
    return bytes(schema().types["Packet"].encode({"v": 1, "body": ("fin", body)}))


def test_uper_has_one_encoding_of_a_message() -> None:
    data = UPER.encode(fin())
    assert packed() == data
    refused(UPER, data + b"\0", "canonical encoding")
    refused(UPER, data[:-1] + bytes([data[-1] | 1]), "canonical encoding")
    refused(UPER, packed(seq=("n16", 7)), "canonical encoding")
    assert UPER.decode(packed(seq=("n16", 700))) == fin(seq=700)


@pytest.mark.parametrize("extras", [{"length-mm": ("n8", 99)}, {"width-mm": ("n32", 102_101)}])
def test_end_5_uper_refuses_extras_out_of_bounds(extras: dict[str, Any]) -> None:
    data = bytes(schema().types["Extras"].encode(extras))
    refused(UPER, UPER.encode(cam(1, 0)) + data, f"CAM.{next(iter(extras)).replace('-', '_')}")
    refused(UPER, UPER.encode(fin()) + data, "Fin." + next(iter(extras)).replace("-", "_"))


def test_end_5_details_in_uper_are_compact_json() -> None:
    one, data = advertisement(details={"a": 1}), b'{"a":1}'
    packet = UPER.encode(one)
    bits = f"{int.from_bytes(packet, 'big'):0{8 * len(packet)}b}"
    text = f"{int.from_bytes(data, 'big'):0{8 * len(data)}b}"
    assert bits.count(text) == 1
    for other, problem in [
        (b'{"a":2}', ""),
        (b'{"a" 1}', "Advertisement.details: Invalid JSON"),
        (b'{"\xff":1}', "not UTF-8"),
        (b"[[[1]]]", "details: must be an object"),
        (b'{ "":1}', "canonical encoding"),
        (b'{"a":-}', "details"),
        (b'{"":.5}', "details"),
        (b'{"":-0}', "canonical encoding"),
    ]:
        swapped = bits.replace(text, f"{int.from_bytes(other, 'big'):0{len(text)}b}")
        changed_packet = int(swapped, 2).to_bytes(len(packet), "big")
        if problem:
            refused(UPER, changed_packet, problem)
        else:
            assert UPER.decode(changed_packet) == advertisement(details={"a": 2})


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda m: m.type)
def test_end_5_what_is_cut_off_is_refused_with_the_field(message: Message | Cam) -> None:
    bare = message.model_copy(update=dict.fromkeys(EXTRAS & type(message).model_fields.keys()))
    data, whole = UPER.encode(message), len(UPER.encode(bare))
    for length in range(len(data)):
        if length == whole:
            assert UPER.decode(data[:length]) == bare
        else:
            refused(UPER, data[:length], "" if length in (whole - 1, len(data) - 1) else "out of")
    refused(UPER, data[:3], f"{message.type}.src: out of data")


@pytest.mark.parametrize("used", BOTH, ids=lambda c: c.name)
def test_end_5_what_is_longer_than_a_datagram_is_refused_both_ways(used: Codec) -> None:
    refused(used, bytes(MAX_BYTES + 1), f"message: {MAX_BYTES + 1} bytes, more than {MAX_BYTES}")
    refused(used, b"", "")
    with pytest.raises(MessageError, match="bytes, more than"):
        used.encode(advertisement(scenario="x" * MAX_BYTES))


def test_uper_says_which_field_it_cannot_carry() -> None:
    long = Trajectory(t0=0, points=((0, 0, 0),) * (MAX_POINTS + 1))
    with pytest.raises(MessageError, match=r"^Intention\.planned\.points: 16385 points"):
        UPER.encode(intention(planned=long))


@pytest.mark.parametrize("used", BOTH, ids=lambda c: c.name)
def test_act_5_a_cam_has_room_for_so_many_marks(used: Codec) -> None:
    marks = ((9, 1),) * MAX_MARKS
    assert used.decode(used.encode(cam(1, 0, *marks))) == cam(1, 0, *marks)
    with pytest.raises(ValueError, match="marks"):
        cam(1, 0, *marks, (9, 1))


def test_a_codec_has_a_name() -> None:
    assert [codec(used.name) for used in BOTH] == BOTH
    with pytest.raises(CodecError, match="there is no codec 'xml'; the codecs are json, uper"):
        codec("xml")


def test_without_asn1tools_the_error_says_what_to_install(monkeypatch: Any) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: Any) -> Any:
        if name == "asn1tools":
            raise ModuleNotFoundError("No module named 'asn1tools'", name=name)
        return real(name, *rest)

    monkeypatch.delitem(sys.modules, "automcm.encoding.uper")
    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(CodecError, match=r"pip install 'automcm\[asn1\]'"):
        codec("uper")
    assert codec("json") is JSON


# What got through, or took long, before there was this test.


@pytest.mark.parametrize("n", [LIMIT + 1, -LIMIT - 1, 10**30, 10**4200])
def test_end_5_integers_have_a_bound(n: int) -> None:
    for data in (
        changed(advertisement(), details={"a": [n]}),
        changed(fin(), seq=abs(n)),
        changed(cam(1, 0), x_mm=n),
        changed(intention(), planned={"t0": n, "points": [[0, 0, 0]]}),
        changed(intention(), planned={"t0": 0, "points": [[0, 0, n]]}),
    ):
        refused(JSON, data, "")
    edge = changed(advertisement(), details={"a": [LIMIT, -LIMIT]})
    for used in BOTH:
        assert used.decode(used.encode(decode(edge))) == decode(edge)


@pytest.mark.parametrize("text", ["\ud800", "a\udfffb", "\udc00\ud800"])
def test_a_message_that_could_not_be_sent_cannot_be_made(text: str) -> None:
    for fields in ({"scenario": text}, {"details": {"a": [text]}}, {"details": {text: 1}}):
        with pytest.raises(ValidationError):
            advertisement(**fields)
        # as JSON escapes it, a text of ASCII
        refused(JSON, changed(advertisement(), **fields), "Invalid JSON")


def test_end_5_details_have_a_bound_of_depth() -> None:
    def nested(depth: int) -> dict[str, Any]:
        value: Any = 1
        for level in range(depth - 1):
            value = [value] if level % 2 else {"a": value}
        return {"a": value}

    deepest = advertisement(details=nested(MAX_DEPTH))
    for used in BOTH:
        assert used.decode(used.encode(deepest)) == deepest
    refused(JSON, changed(advertisement(), details=nested(MAX_DEPTH + 1)), "nested more than 32")
    for depth in (MAX_DEPTH + 1, 250, 300, 900):
        with pytest.raises(ValidationError, match="nested more than 32"):
            advertisement(details=nested(depth))


@pytest.mark.parametrize("value", [1.0, None, (1,), b"x", {1: 2}, object()])
def test_details_made_by_an_application_are_held_to_the_same(value: Any) -> None:
    with pytest.raises(ValidationError):
        advertisement(details={"a": value})
    with pytest.raises(ValidationError):
        advertisement(details=[value])


WIDE = 13_000


@pytest.mark.parametrize("depth", [1, 25, 150])
@pytest.mark.parametrize("value", ["1", "null", "1.5", "[]", "{}"])
def test_end_5_no_input_takes_out_of_proportion(depth: int, value: str) -> None:
    """A null below 150 lists once had an error for each choice of each level: 11 s."""
    start = encode(advertisement())[:-3] + b'{"a":' + b"[" * depth
    data = start + ",".join([value] * WIDE).encode() + b"]" * depth + b"}}"
    assert len(data) <= MAX_BYTES + 100
    try:
        MESSAGE.validate_json(data)
    except ValidationError as error:
        assert error.error_count() == 1
        with pytest.raises(MessageError) as refused:
            decode(data)
        assert len(str(refused.value)) <= 200


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31m", "\u2028", "x" * 300])
def test_end_5_an_error_is_one_printable_line(name: str) -> None:
    with pytest.raises(MessageError) as error:
        decode(changed(advertisement(), details={name: None}))
    assert str(error.value).isprintable() and len(str(error.value)) <= 200


# Sizes.


def test_kin_2_the_papers_trajectory_fits_one_frame() -> None:
    measured = sizes.measure()
    assert len(measured) == 6 + 4 * len(sizes.POINTS)
    fits = {(name, m.points, n <= FRAME_BYTES) for m in measured for name, n in m.bytes.items()}
    assert {case[:2] for case in fits if not case[2]} == {("json", 260)}
    assert ("json", 260, True) not in fits
    assert max(max(m.bytes.values()) for m in measured if m.points == 0) < 200


def test_kin_2_the_most_points_that_fit() -> None:
    for used, least in ((JSON, 52), (UPER, 260)):
        most = sizes.most_points(used)
        assert most >= least
        fitting, too_many = (sizes.carrying(sizes.trajectory(n))[2] for n in (most, most + 1))
        assert len(used.encode(fitting)) <= FRAME_BYTES < len(used.encode(too_many))
    assert sizes.most_points(JSON, 100) == 0
    assert 2000 < sizes.most_points(JSON, MAX_BYTES) < 4000


def test_details_are_a_copy() -> None:
    mine: dict[str, Any] = {"a": [1]}
    message = advertisement(details=mine)
    mine["a"].append(2)
    assert message.details == {"a": [1]}
