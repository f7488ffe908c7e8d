"""Finds the pairs of shapes that meet, up to a limit, since n shapes at one spot form n² pairs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

PAIRS_EACH = 50
"""Limit of pairs per shape (chosen: the lanes of the densest of 40 road networks form 3.5)."""
_FEWEST_LOOKED_FOR = 50_000
"""Least limit for few shapes (chosen: 316 of them may all meet, more than SUMO's paths through a junction)."""
_TOGETHER = 32
"""Shapes compared with all others at a time (chosen to notice a crowd before it fills the memory)."""


@dataclass(frozen=True)
class MeetingPairs:
    """Pairs (n, 2) of shape numbers in ascending order, each with the smaller number first.

    ``most``: the limit; ``is_whole``: True if these are all pairs, False if more pairs exist.
    """

    pairs: NDArray[np.int64]
    most: int
    is_whole: bool


def meeting_pairs(shapes: Sequence[Any] | NDArray[Any], predicate: Literal["intersects", "crosses"]) -> MeetingPairs:
    """Return the pairs of shapely shapes for which the predicate holds, at most ``PAIRS_EACH`` per shape on average.

    Time and memory grow as n log n, even if many shapes overlap.
    """
    from shapely import STRtree

    tree, given = STRtree(shapes), np.asarray(shapes, dtype=object)
    most = max(_FEWEST_LOOKED_FOR, PAIRS_EACH * len(given))
    found: list[NDArray[np.int64]] = []
    count = 0
    for begin in range(0, len(given), _TOGETHER):
        first, second = tree.query(given[begin : begin + _TOGETHER], predicate=predicate)
        pairs = np.column_stack([first + begin, second])
        pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        found.append(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].astype(np.int64))
        count += len(pairs)
        if count > most:
            break
    together = np.concatenate([np.empty((0, 2), dtype=np.int64), *found])
    return MeetingPairs(together[:most], most, len(together) <= most)
