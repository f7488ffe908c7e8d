"""How long work says how far it is: a callable that every operation receives."""

from typing import Protocol


class ProgressReporter(Protocol):
    """Called by an operation with the share done in [0, 1] and a few words; may be called as often as convenient."""

    def __call__(self, share: float, message: str = "") -> None:
        """Report the share done, never less than before, and what is being done now."""


def silent(share: float, message: str = "") -> None:
    """A reporter for callers that do not want to know."""
    del share, message
