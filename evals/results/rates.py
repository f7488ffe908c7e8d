"""How shares are told: with their interval, so that few trials are not read as many."""

from ...engine.analysis import rate


def rate_text(count: int, of: int) -> str:
    """A share with its 95 % Wilson interval, in words; a dash without trials."""
    interval = rate(count, of)
    return "-" if interval.share is None else f"{interval.share:.1%} ({interval.low:.1%} to {interval.high:.1%})"
