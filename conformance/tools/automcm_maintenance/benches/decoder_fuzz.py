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
from typing import Any, get_args

from automcm.encoding.codec import Codec, codec
from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.messages import LIMIT, MAX_BYTES, MAX_DEPTH, Cam, Message, MessageError

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


def examples() -> list[Message | Cam]:
    """Messages of every type, reason and form, from which the inputs are made."""
    plain: dict[str, Any] = {message.type: message for message in sizes.plain()}
    far = messages.Trajectory(
        t0=-LIMIT, points=((LIMIT, -LIMIT, 0), (2048, 8192, -8193), (2050, 8193, 0))
    )
    driven = [
        one
        for each in (sizes.trajectory(2), sizes.trajectory(20), far)
        for one in sizes.carrying(each)
    ]
    details = {"lane": 2, "zone": [[0, 1, -7], {"open": True, "name": "B\u00e9\n"}], "": {}}
    extent = {"length_mm": 16_500, "width_mm": 2550}
    changed: list[tuple[Any, dict[str, Any]]] = [
        (driven[0], {"details": details | {"n": LIMIT}}),
        (driven[1], extent),
        (plain["Fin"], {"session": (2**32 - 1, LIMIT), "seq": 2**33}),
        (plain["CAM"], {"marks": ()}),
        (plain["CAM"], extent | {"station_type": 8, "sigma_mm": 700}),
    ]
    for reason in get_args(messages.RefusalReason):
        seq = 0 if reason in messages.ANSWER_REASONS else 2
        changed.append((plain["Acceptance"], {"reason": reason, "seq": seq}))
    for reason in get_args(messages.CancelReason):
        changed.append((plain["Cancel"], {"reason": reason, "seq": 0 if reason == "closed" else 3}))
    return [*plain.values(), *driven, *(each.model_copy(update=to) for each, to in changed)]


class Mutator:
    """Makes inputs from ``valid`` encodings; the same seed gives the same inputs.

    ``text``: the encodings have tokens.
    """

    def __init__(self, valid: Sequence[bytes], seed: str, text: bool) -> None:
        self._random = random.Random(seed)
        self._split = _TOKEN.findall if text else lambda data: [data]
        self._pool: list[list[bytes]] = [self._split(data) for data in valid]
        self._text = text

    def keep(self, data: bytes) -> None:
        """Use this input as a source of further ones."""
        if len(data) > KEPT_BYTES:
            return
        if len(self._pool) == POOL:
            self._pool.pop(self._below(POOL))
        self._pool.append(self._split(data))

    def next(self) -> bytes:
        """The next input: up to 3 changes of tokens, of bytes or of bits."""
        tokens, others = self._one(self._pool), self._one(self._pool)
        chance, times = self._random.random(), self._one((1, 1, 1, 2, 3))
        if self._text and chance < 0.6:
            changed = tokens.copy()
            for _ in range(times):
                self._splice(changed, others, [self._one(_EDGE_TOKENS)])
            return b"".join(changed)
        data, other = bytearray(b"".join(tokens)), b"".join(others)
        if chance > 0.9999:
            return bytes(data * (MAX_BYTES // max(len(data), 1) + self._below(2)))
        for _ in range(times):
            if chance < 0.85:
                self._splice(data, other, self._random.randbytes(1))
            else:
                data = self._shifted(data)
        return bytes(data)

    def _below(self, n: int) -> int:
        return int(self._random.random() * n)  # a third of the time of randrange

    def _one(self, among: Sequence[Any]) -> Any:
        return among[self._below(len(among))]

    def _splice(self, parts: Any, other: Any, new: Any) -> None:
        """Replace some tokens or bytes by a new one, by some of another input, or by none."""
        at, start, some = self._below(len(parts)), self._below(len(other)), 1 + self._below(8)
        end = at + self._one((0, 0, 1, 1, 1, 1, some, len(parts)))
        by = (new, new, other[start : start + 1], other[start : start + some], other[start:], ())
        parts[at:end] = self._one(by)

    def _shifted(self, data: bytearray) -> bytearray:
        """Change a bit, or insert or drop one, which shifts the rest."""
        at, value = self._below(8 * len(data)), int.from_bytes(data, "big")
        high, dropped, added = value >> at, self._below(2), self._below(2)
        high = high >> dropped << added | self._below(1 + added)
        value = high << at | value & ((1 << at) - 1)
        return bytearray(value.to_bytes(len(data) + 1, "big").lstrip(b"\0"))


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


def fuzz(tested: Codec, count: int, seed: int) -> int:
    """Decode ``count`` inputs; returns how many were accepted.  Raises Found for the first input
    that breaks the codec."""
    valid = [tested.encode(message) for message in examples()]
    mutator = Mutator(valid, f"{tested.name} {seed}", text=tested.name == "json")
    accepted = 0
    for _ in range(count):
        data = mutator.next()
        if check(tested, data):
            accepted += 1
            mutator.keep(data)
    return accepted


def main(arguments: Sequence[str] | None = None) -> int:
    """The fuzzer as a command; returns 1 if an input breaks a decoder."""
    parser = argparse.ArgumentParser(
        prog="python -m automcm_maintenance.benches.decoder_fuzz", description=__doc__
    )
    parser.add_argument("--count", type=int, default=10_000_000, help="inputs altogether")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    shares = {"uper": options.count // 5, "json": options.count - options.count // 5}
    for name, count in shares.items():
        started = time.monotonic()
        try:
            accepted = fuzz(codec(name), count, options.seed)
        except Found as found:
            print(f"{name}, seed {options.seed}: {found}\n{found.data.hex()}")
            return 1
        took = time.monotonic() - started
        print(f"{name}, seed {options.seed}: {count:,} inputs, {accepted:,} accepted, {took:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
