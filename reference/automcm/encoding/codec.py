"""Codecs: a message as bytes and back (docs/messages.md).

There are two, ``json`` and ``uper``; ``codec(name)`` returns one.  UPER needs the extra
``automcm[asn1]``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.messages import MAX_BYTES, Cam, Message, MessageError

FRAME_BYTES = 1400
"""Maximum bytes of a message that fits in one frame (KIN-2)."""
NAMES = ("json", "uper")


class CodecError(ValueError):
    """There is no codec with that name, or it is not installed; the text gives the remedy."""


class CodecMissing(CodecError):
    """The codec needs an extra that is not installed."""


class Codec(Protocol):
    """A message as bytes and back: ``decode(encode(m)) == m``."""

    @property
    def name(self) -> str:
        """As in ``--codec`` and in logs."""

    def encode(self, message: Message | Cam) -> bytes:
        """The message in at most MAX_BYTES.  Raises MessageError if the codec cannot carry it."""

    def decode(self, data: bytes) -> Message | Cam:
        """The message.  Raises only MessageError, which names the first error (END-5)."""


def bounded(data: bytes) -> bytes:
    """Returns ``data``.  Raises MessageError for more than MAX_BYTES."""
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
    """The codec with that name.  Raises CodecError, CodecMissing."""
    if name == "json":
        return JSON
    if name != "uper":
        raise CodecError(f"there is no codec {name!r}; the codecs are {', '.join(NAMES)}")
    try:
        from automcm.encoding.uper import UPER
    except ModuleNotFoundError as error:
        if error.name != "asn1tools":
            raise
        raise CodecMissing("the codec uper needs asn1tools: pip install 'automcm[asn1]'") from None
    return UPER
