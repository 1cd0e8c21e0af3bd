"""A fuzzer for the decoders, which may raise only MessageError (END-5).

``python -m automcm_maintenance.benches.decoder_fuzz --count 10000000 --seed 1`` changes valid
encodings at random and decodes the results.  An accepted input must be unchanged after encoding and
decoding it again.  The same seed, count and codec give the same inputs.  The exit code is 1 if an
input breaks a decoder; it is printed in hexadecimal.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

from automcm.encoding.codec import NAMES, Codec, codec
from automcm_spec.vocabulary.messages import (
    ANSWER_REASONS,
    LIMIT,
    MAX_BYTES,
    MAX_DEPTH,
    Acceptance,
    Ack,
    Advertisement,
    Cam,
    Cancel,
    CancelReason,
    Fin,
    Intention,
    Message,
    MessageError,
    MessageId,
    Prescription,
    RefusalReason,
    Trajectory,
)

POOL = 512
"""Number of encodings kept for mutation; accepted inputs replace others at random."""
KEPT_BYTES = 2048
"""Longer inputs, in bytes, are not kept, so that the run stays fast."""

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


class Found(Exception):
    """An input that breaks a decoder, and the failure."""

    def __init__(self, data: bytes, problem: str) -> None:
        super().__init__(problem)
        self.data = data


@dataclass(frozen=True, slots=True)
class FuzzCounts:
    """Numbers of accepted and refused inputs."""

    accepted: int
    refused: int


def examples() -> list[Message | Cam]:
    """Messages of every type, reason and form, from which the inputs are made."""
    car = {"src": 1001, "dst": 2002, "session": (1001, 3), "seq": 4}
    short = Trajectory(t0=1000, points=((0, 0, 0), (600, 5000, -20)))
    far = Trajectory(t0=-LIMIT, points=((LIMIT, -LIMIT, 0), (2048, 8192, -8193), (2050, 8193, 0)))
    long = Trajectory(t0=2**40, points=tuple((600 * i, 5000 * i, 17 * i) for i in range(20)))
    zone = [[0, 1, -7], {"open": True, "name": "B\u00e9\n"}]
    lane = {"lane": 2, "zone": zone, "": {}, "n": LIMIT}
    extent = {"length_mm": 16_500, "width_mm": 2550}
    to_all = {"src": 9, "session": (9, 1), "seq": 1, "scenario": "lane_change"}
    made: list[Message | Cam] = [
        Advertisement.model_validate(to_all | {"details": {}}),
        Advertisement.model_validate(to_all | {"details": lane, "planned": short}),
        *(Intention.model_validate(car | {"planned": each}) for each in (short, far, long)),
        Intention.model_validate(car | {"planned": short} | extent),
        Acceptance.model_validate(car | {"proposal": 1, "accepted": True, "selected": short}),
        Fin.model_validate(car),
        Fin.model_validate(car | {"session": (2**32 - 1, LIMIT), "seq": 2**33}),
    ]
    for prescribed in (short, long):
        times = {"proposal": 2, "hold_ms": 2000, "lease_ms": 60_000}
        made.append(Prescription.model_validate(car | times | {"prescribed": prescribed}))
    for refused in get_args(RefusalReason):
        no = {"proposal": 1, "accepted": False, "reason": refused}
        seq = {"seq": 0} if refused in ANSWER_REASONS else {}
        made.append(Acceptance.model_validate(car | no | seq))
    for reason in get_args(CancelReason):
        seq = {"seq": 0} if reason == "closed" else {}
        made.append(Cancel.model_validate(car | {"reason": reason} | seq))
    made.append(Ack.model_validate(car | {"seq": 0, "of": MessageId(type="Fin", seq=4)}))
    place = {"x_mm": 10, "y_mm": -300, "heading_mrad": 1571, "speed_mm_s": 8333}
    for marks in ((), ((1001, 3),), ((1001, 3), (2002, 2**40))):
        at = {"src": 7, "generation_ms": 2**41, "marks": marks}
        made.append(Cam.model_validate(at | place))
        made.append(Cam.model_validate(at | place | extent | {"station_type": 8, "sigma_mm": 700}))
    return made


class Mutator:
    """Makes inputs from ``valid`` encodings; the same seed gives the same inputs."""

    def __init__(self, valid: Sequence[bytes], seed: str, text: bool) -> None:
        self._random = random.Random(seed)
        self._text = text
        self._pool = list(valid)
        self._tokens = [self._split(data) for data in self._pool]

    def _split(self, data: bytes) -> list[bytes]:
        return _TOKEN.findall(data) if self._text else []

    def keep(self, data: bytes) -> None:
        """Use this input as a source of further ones."""
        if len(data) > KEPT_BYTES:
            return
        if len(self._pool) < POOL:
            self._pool.append(data)
            self._tokens.append(self._split(data))
        else:
            at = self._below(POOL)
            self._pool[at], self._tokens[at] = data, self._split(data)

    def next(self) -> bytes:
        """The next input."""
        at = self._below(len(self._pool))
        times = 1
        while times < 6 and self._random.random() < 0.4:
            times += 1
        if self._text and self._random.random() < 0.6:
            tokens = self._tokens[at].copy()
            for _ in range(times):
                edge = _EDGE_TOKENS[self._below(len(_EDGE_TOKENS))]
                self._change(tokens, self._tokens, [edge])
            return b"".join(tokens)
        data = bytearray(self._pool[at])
        for _ in range(times):
            if self._random.random() < 0.6:
                self._change(data, self._pool, self._random.randbytes(1))
            else:
                data = self._change_bits(data)
        return bytes(data)

    def _below(self, n: int) -> int:
        return int(self._random.random() * n)

    def _change(self, parts: Any, pool: Sequence[Any], new: Sequence[Any]) -> None:
        """Change tokens or bytes: by a new one, by others of this input, or by those of another."""
        at = self._below(len(parts))
        other = pool[self._below(len(pool))]
        start, some = self._below(len(other)), 1 + self._below(8)
        match self._below(8):
            case 0:
                parts[at : at + 1] = new
            case 1:
                parts[at : at + 1] = other[start : start + 1]
            case 2 if parts:
                place = self._below(len(parts))
                parts[at], parts[place] = parts[place], parts[at]
            case 3:
                del parts[at : at + some]
            case 4:
                parts[at:at] = parts[at : at + some]
            case 5:
                parts[at:at] = other[start : start + some]
            case 6:
                del parts[at:]
            case _:
                parts[at:] = other[start:]

    def _change_bits(self, data: bytearray) -> bytearray:
        size = len(data)
        bits = self._below(8 * size)
        if self._below(5000) == 0:
            return (data or bytearray(1)) * (MAX_BYTES // max(size, 1) + self._below(2))
        value = int.from_bytes(data, "big")
        low = value & ((1 << bits) - 1)
        match self._below(3):
            case 0 if size:
                value ^= 1 << bits
            case 1:  # inserts a bit, which shifts the rest
                value = (value >> bits) << (bits + 1) | self._below(2) << bits | low
            case _:
                value = (value >> (bits + 1)) << bits | low
        return bytearray(value.to_bytes(size + 1, "big").lstrip(b"\0"))


def check(tested: Codec, data: bytes) -> bool:
    """Whether the codec accepts the input.  Raises Found if the input breaks it."""
    try:
        message = tested.decode(data)
    except MessageError as error:
        text = str(error)
        if len(text) > 200 or not text.isprintable():
            raise Found(data, f"an error of {len(text)} characters: {text[:200]!r}") from None
        return False
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a panic of compiled code is not an Exception
        raise Found(data, f"decode raised {type(error).__name__}: {error!s:.200}") from error
    try:
        again = tested.decode(tested.encode(message))
    except Exception as error:
        problem = f"accepted, then not encoded and read again: {type(error).__name__}"
        raise Found(data, f"{problem}: {error!s:.200}") from error
    if again != message:
        raise Found(data, "accepted, then read again as another message")
    return True


def fuzz(
    tested: Codec,
    count: int,
    seed: int,
) -> FuzzCounts:
    """Decode ``count`` inputs.  Raises Found for the first input that breaks the codec."""
    valid = [tested.encode(message) for message in examples()]
    mutator = Mutator(valid, f"{tested.name} {seed}", text=tested.name == "json")
    accepted = 0
    for _ in range(count):
        data = mutator.next()
        if check(tested, data):
            accepted += 1
            mutator.keep(data)
    return FuzzCounts(accepted, count - accepted)


def main(arguments: Sequence[str] | None = None) -> int:
    """The fuzzer as a command; returns 1 if an input breaks a decoder or memory leaks."""
    parser = argparse.ArgumentParser(
        prog="python -m automcm_maintenance.benches.decoder_fuzz", description=__doc__
    )
    parser.add_argument("--count", type=int, default=10_000_000, help="inputs altogether")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--codec", choices=NAMES, help="else json 4/5 of the inputs, uper 1/5")
    options = parser.parse_args(arguments)
    shares = {options.codec: options.count}
    if options.codec is None:
        shares = {"uper": options.count // 5, "json": options.count - options.count // 5}
    for name, count in shares.items():
        started = time.monotonic()
        try:
            outcome = fuzz(codec(name), count, options.seed)
        except Found as found:
            print(f"{name}, seed {options.seed}: {found}\n{found.data.hex()}")
            return 1
        print(
            f"{name}, seed {options.seed}: {count:,} inputs, {outcome.accepted:,} accepted, "
            f"{outcome.refused:,} refused, {time.monotonic() - started:.0f} s"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
