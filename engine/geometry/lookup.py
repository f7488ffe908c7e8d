"""Linear interpolation of single values in a table, several times as fast as numpy for one value."""

from bisect import bisect_right

import numpy as np
from numpy.typing import ArrayLike


class Lookup:
    """A table of ascending positions and their values; returns what ``np.interp`` returns for a single position."""

    def __init__(self, places: ArrayLike, values: ArrayLike) -> None:
        self._places: list[float] = np.asarray(places, dtype=np.float64).tolist()
        self._values: list[float] = np.asarray(values, dtype=np.float64).tolist()

    def at(self, place: float) -> float:
        """Return the value at a place: interpolated, or that of the nearest end."""
        places, values = self._places, self._values
        index = bisect_right(places, place) - 1
        if index < 0:
            return values[0]
        if index >= len(places) - 1 or places[index] == place:
            return values[min(index, len(places) - 1)]
        slope = (values[index + 1] - values[index]) / (places[index + 1] - places[index])
        return slope * (place - places[index]) + values[index]
