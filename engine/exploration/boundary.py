"""Adaptive refinement of the edges between classes over two parameters.

The search knows nothing of driving: points of a square lattice have labels, and the search asks for the points that it
needs. It starts with a coarse grid and splits cells whose corners have different labels into four. Once they are small,
it bisects their sides between points of different labels, since an edge is nearly straight inside a small cell; then it
splits them again. Finally, it checks the centres of some cells that seem uniform, because a small island may be between
the corners. The sequence depends only on labels and seed, so an interrupted search continues from the known labels.
"""

import math
import random
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import NormalDist

Place = tuple[int, int]
"""A point of the lattice."""
_Spot = tuple[float, float]

START, LEVELS = 4, 4
"""Cells along each side of the first grid, and how often a cell may be halved: 64 cells along a side (chosen)."""
SIZE: int = START * 2**LEVELS
"""Cells of the finest lattice along each side."""
_BISECTED = SIZE // 8
"""Cells of this size are small enough to bisect their sides (chosen): an eighth of a range."""
_CHECKED_SHARE = 0.1
"""Share of the points with which uniform cells are checked (chosen)."""
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Cell:
    """A square cell of the lattice: its lower corner and its size."""

    low: Place
    size: int

    @property
    def corners(self) -> tuple[Place, ...]:
        """The four corners."""
        (x, y), size = self.low, self.size
        return ((x, y), (x + size, y), (x, y + size), (x + size, y + size))

    @property
    def center(self) -> Place:
        """The centre; the centre of a cell of size 1 is not on the lattice."""
        return self.low[0] + self.size // 2, self.low[1] + self.size // 2

    @property
    def area(self) -> float:
        """The share of the whole square."""
        share = self.size / SIZE
        return share * share

    def halves(self) -> tuple["Cell", ...]:
        """Return the four cells that it splits into."""
        half = self.size // 2
        return tuple(Cell((self.low[0] + dx, self.low[1] + dy), half) for dx in (0, half) for dy in (0, half))


@dataclass
class BoundarySearch:
    """A search for the edges between labels. Call ``ask`` for points and ``tell`` their labels, until ``ask`` returns
    no points.

    ``budget``: the maximum number of points. ``ranks``: the priority of an edge, by its pair of labels (sorted); edges
    with lower ranks are refined first, and the default is 1. ``seed``: chooses which uniform cells are checked.
    """

    budget: int
    ranks: Mapping[tuple[str, str], int] = field(default_factory=dict)
    seed: int = 0
    labels: dict[Place, str] = field(default_factory=dict)
    _cells: list[Cell] = field(default_factory=list)
    _checked: dict[Cell, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin with the coarse grid."""
        step = SIZE // START
        self._cells = [Cell((x * step, y * step), step) for x in range(START) for y in range(START)]
        self._random = random.Random(self.seed)  # noqa: S311 - a choice of cells, no secret

    def ask(self) -> tuple[Place, ...]:
        """Return the next points to label; empty if the search has ended."""
        left = self.budget - len(self.labels)
        missing = self._missing(self._cells)
        if missing or left <= 0:
            return missing[: max(left, 0)]
        reserve = round(self.budget * _CHECKED_SHARE) - len(self._checked)
        smallest = _BISECTED
        while smallest >= 1 and left > reserve:
            found = self._halved_cells(smallest, left - reserve) or self._bisected(smallest, left - reserve)
            if found:
                return found
            smallest //= 2
        return self._next_check(min(left, reserve))

    def tell(self, labels: Mapping[Place, str]) -> None:
        """Set the labels of points."""
        self.labels.update(labels)
        for cell, was_uniform in list(self._checked.items()):
            if was_uniform and cell.center in self.labels:
                self._checked[cell] = self.labels[cell.center] == self.labels[cell.low]

    def _missing(self, cells: Iterable[Cell]) -> tuple[Place, ...]:
        places = dict.fromkeys(place for cell in cells for place in cell.corners)
        return tuple(place for place in places if place not in self.labels)

    def _halved_cells(self, smallest: int, most: int) -> tuple[Place, ...]:
        """Split the largest mixed cells above a size; return at most ``most`` new points that need labels."""
        while True:
            mixed = [cell for cell in self._cells if cell.size > smallest and self._is_mixed(cell)]
            if not mixed:
                return ()
            largest = max(cell.size for cell in mixed)
            wanted, split = dict[Place, None](), False
            for cell in sorted((one for one in mixed if one.size == largest), key=self._rank):
                more = dict.fromkeys(self._missing(cell.halves()))
                if len(wanted | more) > most:
                    continue
                place = self._cells.index(cell)
                self._cells[place : place + 1] = cell.halves()
                wanted, split = wanted | more, True
            if wanted or not split:
                return tuple(wanted)

    def _bisected(self, smallest: int, most: int) -> tuple[Place, ...]:
        """Return the midpoints of the longest gaps between differently labelled points on the sides of cells."""
        gaps: dict[Place, tuple[int, int]] = {}
        for cell in self._cells:
            if cell.size > smallest or not self._is_mixed(cell):
                continue
            for side in self.known_sides(cell):
                for one, other in pairwise(side):
                    length = abs(one[0] - other[0]) + abs(one[1] - other[1])
                    if length > 1 and self.labels[one] != self.labels[other]:
                        middle = (one[0] + other[0]) // 2, (one[1] + other[1]) // 2
                        pair = sorted((self.labels[one], self.labels[other]))
                        gaps[middle] = -length, self.ranks.get((pair[0], pair[1]), 1)
        order = sorted(gaps, key=lambda place: (gaps[place], place))
        first = gaps[order[0]][0] if order else 0
        return tuple(place for place in order if gaps[place][0] == first)[:most]

    def known_sides(self, cell: Cell) -> tuple[tuple[Place, ...], ...]:
        """Return the points with labels on each side of a cell, from corner to corner."""
        (x, y), size = cell.low, cell.size
        steps = range(size + 1)
        sides = (
            [(x + step, y) for step in steps],
            [(x + size, y + step) for step in steps],
            [(x + size - step, y + size) for step in steps],
            [(x, y + size - step) for step in steps],
        )
        return tuple(tuple(place for place in side if place in self.labels) for side in sides)

    def _next_check(self, most: int) -> tuple[Place, ...]:
        """Return the centres of some randomly chosen uniform cells; larger cells are more likely to be chosen."""
        cells = [cell for cell in self._cells if cell.size > 1 and not self._is_mixed(cell)]
        cells = [cell for cell in cells if cell not in self._checked]
        if most <= 0 or not cells:
            return ()
        weights = [cell.area for cell in cells]
        chosen = dict.fromkeys(self._random.choices(cells, weights=weights, k=min(most, START)))
        self._checked |= {cell: self.labels_of(cell) == {self.labels.get(cell.center)} for cell in chosen}
        fresh = tuple(cell.center for cell in chosen if cell.center not in self.labels)
        self._checked |= dict.fromkeys((cell for cell in chosen if cell.center in fresh), True)
        return fresh or self._next_check(most)

    def labels_of(self, cell: Cell) -> set[str]:
        """Return the labels of a cell's corners and centre."""
        places = (*cell.corners, cell.center)
        return {self.labels[place] for place in places if place in self.labels}

    def _is_mixed(self, cell: Cell) -> bool:
        return len(self.labels_of(cell)) > 1

    def _rank(self, cell: Cell) -> int:
        """Return the rank of the most important edge in a cell."""
        found = sorted(self.labels_of(cell))
        pairs = ((one, other) for at, one in enumerate(found) for other in found[at + 1 :])
        return min((self.ranks.get(pair, 1) for pair in pairs), default=1)

    @property
    def cells(self) -> tuple[Cell, ...]:
        """The current cells."""
        return tuple(self._cells)

    @property
    def checks(self) -> tuple[int, int]:
        """The number of uniform cells that were checked at their centres, and how many of them were not uniform."""
        return len(self._checked), sum(not uniform for uniform in self._checked.values())


@dataclass(frozen=True)
class Area:
    """The share of the square with a label, and its bounds.

    Inside a mixed cell, the edge is approximated by a chord between the points at which it crosses the cell's sides. If
    the edge is monotonic there, the error is at most half of the rectangle around the chord. For a cell that the edge
    crosses in any other way, the bounds are zero and the whole cell. Both bounds also allow for islands hidden in
    uniform cells: the upper end u of a 95 % Wilson interval of the share of checked cells that were not uniform, or 1
    if no cell was checked. The lower bound loses u times the area of the label's own uniform cells, and the upper bound
    gains u times the area of the others. All labels share u, so their bounds hold together: an upper bound and the
    lower bounds of all other labels never add up to more than 1.
    """

    share: float
    low: float
    high: float


ShareBelow = Callable[[float], float]
"""Returns the share of values along one parameter up to a place of the lattice, from 0 to 1."""


@dataclass(frozen=True)
class _Weights:
    """The weights of the square by the shares of values below a place, along both parameters."""

    below: tuple[ShareBelow, ShareBelow]

    def mass(self, low: _Spot, high: _Spot) -> float:
        """Return the weight of a rectangle."""
        return math.prod(below(end) - below(begin) for below, begin, end in zip(self.below, low, high, strict=True))

    def own(self, label: str, cell: Cell, search: BoundarySearch) -> float:
        """Return the weight of a label in a cell."""
        return sum(self.mass(low, high) for found, low, high in _samples_in(cell, search) if found == label)


def area_of(label: str, search: BoundarySearch, below: tuple[ShareBelow, ShareBelow] | None = None) -> Area:
    """Return the area of a label; a cell without any labelled point may belong to it.

    Args:
        label: the label.
        search: a finished search.
        below: how often values occur along both parameters, which are taken as independent; by default equally often.
            With them, the error inside a cell with one edge is at most the weight of the rectangle around the chord.
    """
    share = low = high = hidden = uniform = 0.0
    weights = None if below is None else _Weights(below)
    for cell in search.cells:
        (x, y), size = cell.low, cell.size
        area = cell.area if weights is None else weights.mass(cell.low, (x + size, y + size))
        known = {search.labels[place] for place in (*cell.corners, cell.center) if place in search.labels}
        if label not in known:
            if known:
                hidden += area if len(known) == 1 else 0.0
            else:
                high += area
            continue
        if weights is None or len(known) == 1:
            own = area * _share_in(label, cell, search)
        else:
            own = weights.own(label, cell, search)
        chord = _chord(cell, search)
        spread = area if len(known) > 1 else 0.0
        if chord is not None:
            (x1, y1), (x2, y2) = chord
            if weights is None:
                spread = abs((x2 - x1) * (y2 - y1)) / SIZE**2 / 2 + cell.size / SIZE**2
            else:
                spread = weights.mass((min(x1, x2), min(y1, y2)), (max(x1, x2), max(y1, y2))) + area / size
        share += own
        uniform += own if len(known) == 1 else 0.0
        low += max(own - spread, 0.0)
        high += min(own + spread, area)
    checked, odd = search.checks
    unseen = _upper_share(odd, checked) if checked else 1.0
    return Area(share, max(low - uniform * unseen, 0.0), min(high + hidden * unseen, 1.0))


_SAMPLES = 8
"""A mixed cell's area is measured on so many points along each side (chosen)."""


def _share_in(label: str, cell: Cell, search: BoundarySearch) -> float:
    if len({search.labels.get(place) for place in (*cell.corners, cell.center)} - {None}) == 1:
        return 1.0
    found = [known for known, _, _ in _samples_in(cell, search)]
    return found.count(label) / len(found)


def _samples_in(cell: Cell, search: BoundarySearch) -> Iterator[tuple[str | None, _Spot, _Spot]]:
    """Yield the label of each small square of a cell, by its centre, with the square's lower and upper corner."""
    side = cell.size / _SAMPLES
    for column in range(_SAMPLES):
        for row in range(_SAMPLES):
            low = cell.low[0] + column * side, cell.low[1] + row * side
            high = low[0] + side, low[1] + side
            yield _label_in(cell, (low[0] + side / 2, low[1] + side / 2), search), low, high


def _chord(cell: Cell, search: BoundarySearch) -> tuple[_Spot, _Spot] | None:
    """Return the two points where the edge between two labels crosses the sides of a cell; None for any other pattern
    of labels.
    """
    around = [place for side in search.known_sides(cell) for place in side[:-1]]
    labels = [search.labels[place] for place in around]
    if len(around) < len(cell.corners) or len(set(labels)) != 2:
        return None
    crossed = [index for index in range(len(around)) if labels[index] != labels[index - 1]]
    if len(crossed) != 2:
        return None
    spots = [
        ((around[index][0] + around[index - 1][0]) / 2, (around[index][1] + around[index - 1][1]) / 2)
        for index in crossed
    ]
    return spots[0], spots[1]


def _label_in(cell: Cell, place: _Spot, search: BoundarySearch) -> str | None:
    """Return the label at a place inside a cell: by the side of the chord or, without a chord, from the nearest
    labelled point.
    """
    sides = search.known_sides(cell)
    around = [one for side in sides for one in side]
    center = [cell.center] if cell.size > 1 and cell.center in search.labels else []
    chord = _chord(cell, search)
    if chord is not None and not center:
        own = _side_of(chord, place)
        same = [one for one in around if _side_of(chord, one) * own > 0]
        return _nearest(place, same or around, search.labels)
    return _nearest(place, [*around, *center], search.labels)


def _side_of(chord: tuple[_Spot, _Spot], place: _Spot) -> float:
    (x1, y1), (x2, y2) = chord
    return (x2 - x1) * (place[1] - y1) - (y2 - y1) * (place[0] - x1)


def _upper_share(count: int, of: int) -> float:
    """Return the upper end of the Wilson interval of a share."""
    z = NormalDist().inv_cdf(0.5 + _CONFIDENCE / 2)
    share = count / of
    middle, spread = share + z * z / (2 * of), z * math.sqrt((share * (1 - share) + z * z / (4 * of)) / of)
    return (middle + spread) / (1 + z * z / of)


def label_at(x: float, y: float, search: BoundarySearch) -> str | None:
    """Return the label of a point with coordinates from 0 to 1; None if no point of its cell has a label."""
    place = x * SIZE, y * SIZE
    for cell in search.cells:
        if all(low <= at <= low + cell.size for low, at in zip(cell.low, place, strict=True)):
            return _label_in(cell, place, search)
    return None


def _nearest(place: tuple[float, float], known: Sequence[Place], labels: Mapping[Place, str]) -> str | None:
    there = [one for one in known if one in labels]
    best = min(there, key=lambda one: ((one[0] - place[0]) ** 2 + (one[1] - place[1]) ** 2, one), default=None)
    return None if best is None else labels[best]


def counts_of(search: BoundarySearch) -> dict[str, int]:
    """Return the number of points of each label."""
    return dict(Counter(search.labels.values()))


def labels_on(
    labels: Mapping[Place, str], cells: Iterable[tuple[int, int, int]], pixels: int
) -> list[list[str | None]]:
    """Return the labels at the centres of pixels × pixels squares of a finished map, rows upwards.

    Args:
        labels: the labels of the map's points.
        cells: lower corner and size of each of its cells.
        pixels: the number of squares along each side.
    """
    search = BoundarySearch(0, labels=dict(labels))
    found: list[list[str | None]] = [[None] * pixels for _ in range(pixels)]
    for x, y, size in cells:
        cell = Cell((x, y), size)
        known = search.labels_of(cell)
        begin, end = x * pixels // SIZE, (x + size) * pixels // SIZE
        low, high = y * pixels // SIZE, (y + size) * pixels // SIZE
        only = next(iter(known)) if len(known) == 1 else None
        for row in range(low, high):
            for column in range(begin, end):
                place = (column + 0.5) * SIZE / pixels, (row + 0.5) * SIZE / pixels
                found[row][column] = only if only is not None or not known else _label_in(cell, place, search)
    return found
