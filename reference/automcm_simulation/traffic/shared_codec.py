"""A codec for many stations in one process, which decodes a broadcast once and not per receiver."""

from __future__ import annotations

from automcm.encoding.codec import Codec
from automcm_spec.vocabulary.messages import Cam, Message

KEPT = 4096
"""The number of messages remembered: more than arrive within the longest delay."""


class SharedCodec:
    """``codec``, which remembers the last messages.  Messages are immutable; invalid ones are
    decoded each time."""

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self._known: dict[bytes, Message | Cam] = {}

    @property
    def name(self) -> str:
        """As ``Codec.name``."""
        return self._codec.name

    def encode(self, message: Message | Cam) -> bytes:
        """As ``Codec.encode``."""
        return self._codec.encode(message)

    def decode(self, data: bytes) -> Message | Cam:
        """As ``Codec.decode``."""
        message = self._known.get(data)
        if message is None:
            message = self._codec.decode(data)
            if len(self._known) >= KEPT:
                self._known.clear()
            self._known[data] = message
        return message
