"""The fuzzer of the decoders: inputs that they survive, and that it finds a leaking decoder."""

from __future__ import annotations

from typing import get_args

import pytest
from automcm_stage import cancel, fin

from automcm.encoding.codec import JSON, codec
from automcm_maintenance.benches import decoder_fuzz
from automcm_spec.vocabulary.messages import (
    Cam,
    CancelReason,
    Message,
    MessageError,
    MessageType,
    RefusalReason,
)


def test_the_fuzzer_starts_from_every_type_and_reason() -> None:
    examples = decoder_fuzz.examples()
    assert {m.type for m in examples} == {*get_args(MessageType), "CAM"}
    reasons = {getattr(m, "reason", None) for m in examples}
    assert reasons >= {*get_args(RefusalReason), *get_args(CancelReason)}


# The fuzzer.


@pytest.mark.parametrize(("name", "count"), [("json", 4000), ("uper", 1500)])
def test_end_5_decoders_survive_changed_inputs(name: str, count: int) -> None:
    accepted = decoder_fuzz.fuzz(codec(name), count, seed=7)
    assert count // 50 < accepted < count // 2
    assert decoder_fuzz.fuzz(codec(name), count, seed=7) == accepted


class Broken:
    """A codec with a fault that few inputs show."""

    name = "json"

    def __init__(self, fault: str) -> None:
        self.fault = fault

    def encode(self, message: Message | Cam) -> bytes:
        return JSON.encode(message)

    def decode(self, data: bytes) -> Message | Cam:
        if self.fault == "leak" and data[:1] == b"[":
            raise IndexError("out of range")
        if self.fault == "long" and not data:
            raise MessageError("x" * 201)
        if self.fault == "panic" and not data:
            raise BaseException("a panic of compiled code")
        message = JSON.decode(data)
        if self.fault == "again" and data == JSON.encode(message):
            raise TypeError("only what encode gives")
        return message


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        ("leak", "decode raised IndexError: out of range"),
        ("long", "an error of 201 characters"),
        ("panic", "decode raised BaseException"),
        ("again", "TypeError: only what encode gives"),
    ],
)
def test_a_decoder_that_leaks_is_caught(fault: str, problem: str) -> None:
    with pytest.raises(decoder_fuzz.Found, match=problem) as found:
        decoder_fuzz.fuzz(Broken(fault), 50_000, seed=1)
    with pytest.raises(decoder_fuzz.Found, match=problem):
        decoder_fuzz.check(Broken(fault), found.value.data)


def test_a_codec_that_reads_its_own_bytes_as_another_message_is_caught() -> None:
    class Forgetful(Broken):
        def encode(self, message: Message | Cam) -> bytes:
            return JSON.encode(fin())

    with pytest.raises(decoder_fuzz.Found, match="read again as another message"):
        decoder_fuzz.check(Forgetful(""), JSON.encode(cancel()))
