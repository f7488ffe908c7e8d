"""The archive of a search: the failures that it found, sorted into cells; failures in different cells count as
different.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Item = TypeVar("Item")
HITS_TO_LEAVE = 3
"""Hits after which a search leaves a cell: further hits there repeat a known failure (chosen)."""


@dataclass(frozen=True)
class Hit(Generic[Item]):
    """A failure in a cell; ``number`` counts the evaluations of the search from 0, and a lower ``value`` is clearer."""

    number: int
    value: float
    item: Item


@dataclass
class Archive(Generic[Item]):
    """The failures of a search by cell, in the order in which the cells were found."""

    hits_to_leave: int = HITS_TO_LEAVE
    cells: dict[str, list[Hit[Item]]] = field(default_factory=dict)

    def add(self, cell: str, hit: Hit[Item]) -> bool:
        """Add a failure; return True if its cell is new."""
        hits = self.cells.setdefault(cell, [])
        hits.append(hit)
        return len(hits) == 1

    def is_exhausted(self, cell: str) -> bool:
        """Return True if the cell has been hit so often that the search stops exploring it."""
        return len(self.cells.get(cell, ())) >= self.hits_to_leave

    def best(self, cell: str) -> Hit[Item]:
        """Return the clearest failure of a cell; if several are equally clear, the earliest."""
        return min(self.cells[cell], key=lambda hit: (hit.value, hit.number))

    def elites(self) -> Iterator[tuple[str, Hit[Item]]]:
        """Yield each cell with its clearest failure."""
        for cell in self.cells:
            yield cell, self.best(cell)

    def __len__(self) -> int:
        return len(self.cells)
