"""Which of many shapes meet, up to a number of pairs: n shapes that all lie on one place make n² of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

PAIRS_EACH = 50
"""Pairs that are looked for, for each shape; chosen: the lanes of the densest of 40 road networks make 3.5."""
_FEWEST_LOOKED_FOR = 50_000
"""However few shapes there are; chosen: 316 of them may all meet, more than SUMO knows paths through a junction."""
_TOGETHER = 32
"""Shapes that are compared with all others at a time; chosen, so that a crowd is noticed before it fills the memory."""


@dataclass(frozen=True)
class MeetingPairs:
    """Pairs (n, 2) of numbers of shapes, the smaller one first, in ascending order.

    ``most``: how many are looked for; ``is_whole``: whether these are all, or the first ones of more than that.
    """

    pairs: NDArray[np.int64]
    most: int
    is_whole: bool


def meeting_pairs(shapes: Sequence[Any] | NDArray[Any], predicate: Literal["intersects", "crosses"]) -> MeetingPairs:
    """The pairs of shapes (shapely) for which the predicate holds, at most ``PAIRS_EACH`` for each shape on average.

    Time and memory grow as n log n, however many shapes lie over one another.
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
