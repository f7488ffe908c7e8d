"""Compares two evaluations of the same requests, paired by request."""

from collections.abc import Sequence
from dataclasses import dataclass

from ...engine.analysis import mcnemar_exact
from ...schemas.errors import InvalidRequest
from .rates import rate_text
from .rows import Row


@dataclass(frozen=True)
class Comparison:
    """The comparison of two evaluations on their common requests.

    ``gained`` are requests that only the second fulfilled, ``lost`` those that only the first did; ``p`` is the
    two-sided p value of the exact McNemar test.
    """

    pairs: int
    first_done: int
    second_done: int
    gained: tuple[Row, ...]
    lost: tuple[Row, ...]
    p: float
    unpaired: int

    def to_text(self, first: str, second: str) -> str:
        """Return the comparison as text; for each flipped request, it shows the row of the side that failed."""
        lines = [
            f"{self.pairs} requests in both" + (f"; {self.unpaired} only in one, left out" if self.unpaired else ""),
            f"{first}: done {rate_text(self.first_done, self.pairs)}",
            f"{second}: done {rate_text(self.second_done, self.pairs)}",
            f"exact McNemar test: {len(self.gained)} gained, {len(self.lost)} lost, p = {self.p:.3g}",
        ]
        for word, rows in (("gained", self.gained), ("lost", self.lost)):
            lines += [f"{word}: {row.request_id} ({row.request.category}): {_reason(row)}" for row in rows]
        return "\n".join(lines)


def compare_rows(first: Sequence[Row], second: Sequence[Row]) -> Comparison:
    """Compare two evaluations, paired by request.

    Raises:
        InvalidRequest: they have no request in common, or one of these differs in text or truth.
    """
    before, after = ({row.request_id: row for row in rows} for rows in (first, second))
    both = [key for key in before if key in after]
    if not both:
        raise InvalidRequest(
            "the two evaluations have no request in common", next_step="compare evaluations of the same corpus"
        )
    other = [key for key in both if before[key].request != after[key].request]
    if other:
        raise InvalidRequest(
            f"{other[0]} differs between the two files", next_step="compare evaluations of the same version of a corpus"
        )
    gained = tuple(before[key] for key in both if after[key].score.done and not before[key].score.done)
    lost = tuple(after[key] for key in both if before[key].score.done and not after[key].score.done)
    return Comparison(
        pairs=len(both),
        first_done=sum(before[key].score.done for key in both),
        second_done=sum(after[key].score.done for key in both),
        gained=gained,
        lost=lost,
        p=mcnemar_exact(len(lost), len(gained)),
        unpaired=len(before.keys() ^ after.keys()),
    )


def _reason(row: Row) -> str:
    return "; ".join(row.score.misses) or row.attempt.failure or "no reason is recorded"
