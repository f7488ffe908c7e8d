"""Separates thinking that a server leaves at the start of an answer, between ``<think>`` and ``</think>``."""

from collections.abc import Iterator

from .interface import TextPart, ThinkingPart

_OPEN, _CLOSE = "<think>", "</think>"


class ThinkingTags:
    """Separates thinking from text while an answer arrives in pieces, which may end within a tag."""

    def __init__(self) -> None:
        self._waiting = ""
        self._inside: bool | None = None
        """True inside the thinking; None if the answer has not shown it yet."""

    def feed(self, text: str) -> Iterator[TextPart | ThinkingPart]:
        """Yield the parts that a piece completes."""
        self._waiting += text
        if self._inside is None:
            begun = self._waiting.lstrip()
            if begun.startswith(_OPEN):
                self._inside, self._waiting = True, begun.removeprefix(_OPEN)
            elif not _OPEN.startswith(begun):
                self._inside = False
        if self._inside:
            thought, close, rest = self._waiting.partition(_CLOSE)
            kept = "" if close else _beginning_of_close(thought)
            thought = thought.removesuffix(kept)
            if thought:
                yield ThinkingPart(thought)
            self._inside, self._waiting = not close, rest.lstrip() if close else kept
        if self._inside is False:
            yield from self.rest()

    def rest(self) -> Iterator[TextPart | ThinkingPart]:
        """Yield the remainder when the answer has ended."""
        if self._waiting:
            yield ThinkingPart(self._waiting) if self._inside else TextPart(self._waiting)
        self._waiting = ""


def _beginning_of_close(text: str) -> str:
    """Return the end of a text that may be the start of the closing tag."""
    return next((_CLOSE[:length] for length in range(len(_CLOSE) - 1, 0, -1) if text.endswith(_CLOSE[:length])), "")
