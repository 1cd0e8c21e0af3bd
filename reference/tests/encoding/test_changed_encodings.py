"""A decoder of a changed encoding raises MessageError, or reads a message that stays as it is when
it is encoded and read again (END-5).

``make fuzz`` runs it on more.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
import pytest
from automcm_stage import cancel, fin
from encoded_examples import EXAMPLES
from hypothesis import given, settings
from hypothesis import strategies as st

from automcm.encoding.codec import JSON, Codec
from automcm.encoding.uper import UPER
from automcm_spec.vocabulary.messages import (
    LIMIT,
    MAX_DEPTH,
    Cam,
    CancelReason,
    Message,
    MessageError,
    MessageType,
    RefusalReason,
)

_TOKEN = re.compile(rb'"(?:[^"\\]|\\.)*"|[-+.\w]+|.', re.DOTALL)
_EDGE_TOKENS = (
    *b"null true NaN -Infinity -0 1.0 1e3 1E400 0x1 +1 01".split(),
    *(str(n).encode() for n in (0, -1, 1, 2**31, 2**32, LIMIT, LIMIT + 1, -LIMIT, 2**63, 2**64)),
    *(b"9" * 4300, b"9" * 5000, b"-" + b"9" * 400, b"0." + b"1" * 400),
    *(b'""', b'"\\ud800"', b'"\\udc00\\ud800"', b'"\\u0000"', b'"\xed\xa0\x80"', b'"\xff"'),
    *(b'"\xf0\x9f\x9a\x97"', b'"\\ud83d\\ude97"', b'"\n"', b'"' + b"x" * 300 + b'"'),
    *(b"[]", b"{}", b"[[]]", b'{"a":{}}', b"[" * MAX_DEPTH + b"]" * MAX_DEPTH),
    *(b"[" * 300, b'{"":' * 300, b"[" * 150 + b"null" + b"]" * 150),
    *(b'"v"', b'"seq"', b'"dst":0', b'"type"', b'"type":"Fin"', b'"busy"', b'"closed"', b'"CAM"'),
)


def _cut(used: Codec, data: bytes) -> list[Any]:
    """The tokens of JSON, the bits of UPER, which have no bounds between bytes."""
    if used.name == "json":
        return _TOKEN.findall(data)
    return list(np.unpackbits(np.frombuffer(data, np.uint8)))


def _joined(used: Codec, parts: Sequence[Any]) -> bytes:
    if used.name == "json":
        return b"".join(parts)
    return np.packbits(np.array(parts, np.uint8)).tobytes()


@st.composite
def changed(draw: st.DrawFn, used: Codec, pool: Sequence[list[Any]]) -> bytes:
    """One of these with some of its parts replaced: by a new one, by some of another, or by
    none."""
    parts, other = draw(st.sampled_from(pool)).copy(), draw(st.sampled_from(pool))
    edges: Sequence[Any] = _EDGE_TOKENS if used.name == "json" else (0, 1)
    for _ in range(draw(st.integers(1, 3))):
        at, start = draw(st.integers(0, len(parts))), draw(st.integers(0, len(other)))
        length = draw(st.sampled_from((0, 1, 1, 1, 8, len(parts))))
        new = (
            [draw(st.sampled_from(edges))],
            other[start : start + draw(st.integers(0, 8))],
            other[start:],
        )
        parts[at : at + length] = draw(st.sampled_from(new))
    return _joined(used, parts)


def check(used: Codec, data: bytes) -> None:
    """Raises AssertionError if the input breaks the codec."""
    try:
        message = used.decode(data)
    except MessageError as error:
        assert len(str(error)) <= 200 and str(error).isprintable()
        return
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a panic of compiled code is not an Exception
        raise AssertionError(f"decode raised {error!r:.200}") from error
    assert used.decode(used.encode(message)) == message


def survives(used: Codec, at_least: int) -> None:
    @settings(max_examples=max(at_least, settings().max_examples), report_multiple_bugs=False)
    @given(changed(used, [_cut(used, used.encode(message)) for message in EXAMPLES]))
    def decoded(data: bytes) -> None:
        check(used, data)

    decoded()


@pytest.mark.parametrize("used", [JSON, UPER], ids=lambda used: used.name)
def test_end_5_decoders_survive_changed_inputs(used: Codec) -> None:
    survives(used, 500)


def test_there_are_examples_of_every_type_and_reason() -> None:
    assert {m.type for m in EXAMPLES} == {*get_args(MessageType), "CAM"}
    reasons = {getattr(m, "reason", None) for m in EXAMPLES}
    assert reasons >= {*get_args(RefusalReason), *get_args(CancelReason)}


class Broken:
    """A codec with a fault that few inputs show."""

    name = "json"

    def __init__(self, fault: str) -> None:
        self.fault = fault

    def encode(self, message: Message | Cam) -> bytes:
        return JSON.encode(fin() if self.fault == "forgetful" else message)

    def decode(self, data: bytes) -> Message | Cam:
        if data[:1] == b"[" and self.fault == "leak":
            raise IndexError("out of range")
        if data[:1] == b"[" and self.fault == "long":
            raise MessageError("x" * 201)
        if data[:1] == b"[" and self.fault == "panic":
            raise BaseException("a panic of compiled code")
        message = JSON.decode(data)
        if self.fault == "again" and data == JSON.encode(message):
            raise TypeError("only what encode gives")
        return message


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        ("leak", "decode raised IndexError"),
        ("long", "<= 200"),
        ("panic", "decode raised BaseException"),
        ("again", "only what encode gives"),
    ],
)
def test_a_decoder_that_leaks_is_caught(fault: str, problem: str) -> None:
    with pytest.raises(Exception, match=problem):
        survives(Broken(fault), 5_000)


def test_a_codec_that_reads_its_own_bytes_as_another_message_is_caught() -> None:
    with pytest.raises(AssertionError, match="=="):
        check(Broken("forgetful"), JSON.encode(cancel()))
