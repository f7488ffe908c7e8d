"""Formats shares with their interval, so that few trials do not look like many."""

from ...engine.analysis import rate


def rate_text(count: int, of: int) -> str:
    """Return a share with its 95 % Wilson interval as text, or a dash if there are no trials."""
    interval = rate(count, of)
    return "-" if interval.share is None else f"{interval.share:.1%} ({interval.low:.1%} to {interval.high:.1%})"
