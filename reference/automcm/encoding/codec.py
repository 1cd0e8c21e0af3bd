"""Codecs: a message as bytes and back (docs/messages.md).

There are two, ``json`` and ``uper``.  ``codec(name)`` gives one; UPER needs the extra
``automcm[asn1]``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.messages import MAX_BYTES, Cam, Message, MessageError

FRAME_BYTES = 1400
"""What a message may need if it is to travel in one frame (KIN-2)."""
NAMES = ("json", "uper")


class CodecError(ValueError):
    """No codec of that name, or it is not installed; the text says what to do."""


class CodecMissing(CodecError):
    """The codec is in an extra that is not installed."""


class Codec(Protocol):
    """A message as bytes and back: ``decode(encode(m)) == m``."""

    @property
    def name(self) -> str:
        """As in ``--codec`` and in logs."""

    def encode(self, message: Message | Cam) -> bytes:
        """At most MAX_BYTES.  Raises MessageError, naming what the codec cannot carry."""

    def decode(self, data: bytes) -> Message | Cam:
        """Raises MessageError, and nothing else, naming the first fault (END-5)."""


def bounded(data: bytes) -> bytes:
    """``data``.  Raises MessageError if there are more than MAX_BYTES."""
    if len(data) > MAX_BYTES:
        raise MessageError(f"message: {len(data)} bytes, more than {MAX_BYTES}")
    return data


@dataclass(frozen=True, slots=True)
class _Json:
    name: str = "json"

    def encode(self, message: Message | Cam) -> bytes:
        return bounded(messages.encode(message))

    def decode(self, data: bytes) -> Message | Cam:
        return messages.decode(bounded(data))


JSON: Codec = _Json()


def codec(name: str) -> Codec:
    """The codec of that name.  Raises CodecError, CodecMissing."""
    if name == "json":
        return JSON
    if name != "uper":
        raise CodecError(f"there is no codec {name!r}; there are: {', '.join(NAMES)}")
    try:
        from automcm.encoding.uper import UPER
    except ModuleNotFoundError as error:
        if error.name != "asn1tools":
            raise
        raise CodecMissing("the codec uper needs asn1tools: pip install 'automcm[asn1]'") from None
    return UPER
