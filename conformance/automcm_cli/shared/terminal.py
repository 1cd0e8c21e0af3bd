"""Output by rich without characters that control a terminal or forge a line."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Console, RenderableType
from rich.segment import Segment
from rich.text import Text

from automcm_spec.support.bad_input import printable


class Terminal(Console):
    """A console for text from anywhere: it adds its own escape sequences and shows no others.

    A string is one line; the lines of a ``rich.text.Text`` are those of its author.
    """

    def render_str(self, text: str, **more: Any) -> Text:
        """A string as text on one line."""
        return super().render_str(printable(text), **more)

    def render(self, renderable: RenderableType, options: Any = None) -> Iterator[Segment]:
        """The segments of anything printed."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text, "\n"), style, control)
