"""Sets of catalogue entries as bits: a million entries take 125 kB, and a condition is one operation on them.

An entry's bit is its position in the alphabetical order of ids, so the first entries of a set are its lowest bits.
``Postings`` keeps the positions, and the sets that satisfy conditions, until the catalogue changes. The calls in all
threads of a server share them.
"""

import re
import sqlite3
import threading
from array import array
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, chain, islice

_GROUP_BITS = 10
"""An entry's number begins with that of its file's artifact; this many bits are its place in the file."""
_IN_GROUP = (1 << _GROUP_BITS) - 1
_KEPT_BYTES = 48 * 2**20
"""The size of all kept sets: 400 conditions of a million entries (chosen)."""
_KEPT_SETS = 2_000
"""The most kept sets, for a small catalogue (chosen)."""
_NOT_THERE = -1


class Entries:
    """An immutable view of a catalogue's entries, in the alphabetical order of their ids.

    ``numbers``: the number of the entry at each position.
    """

    def __init__(self, numbers: "array[int]") -> None:
        self.numbers = numbers
        highest = max(numbers, default=-1) >> _GROUP_BITS
        self._sizes = array("i", bytes(4 * (highest + 1)))
        for number in numbers:
            group, index = number >> _GROUP_BITS, number & _IN_GROUP
            if index >= self._sizes[group]:
                self._sizes[group] = index + 1
        self._begins = array("i", accumulate(self._sizes, initial=0))
        self._places = array("i", (_NOT_THERE,)) * self._begins[-1]
        for place, number in enumerate(numbers):
            self._places[self._begins[number >> _GROUP_BITS] + (number & _IN_GROUP)] = place

    @cached_property
    def all(self) -> "EntrySet":
        """Every entry."""
        return EntrySet(self, (1 << len(self.numbers)) - 1)

    def place(self, number: int) -> int | None:
        """Return the position of an entry, or None for a number that was not in the catalogue."""
        group, index = number >> _GROUP_BITS, number & _IN_GROUP
        if number < 0 or group >= len(self._sizes) or index >= self._sizes[group]:
            return None
        place = self._places[self._begins[group] + index]
        return None if place == _NOT_THERE else place

    def of(self, numbers: Iterable[int]) -> "EntrySet":
        """Return the set of the entries with these numbers; numbers that were not in the catalogue are left out."""
        sizes, begins, places, groups = self._sizes, self._begins, self._places, len(self._sizes)
        marks = bytearray((len(self.numbers) >> 3) + 1)
        for number in numbers:  # does what ``place`` does, without a million calls
            group, index = number >> _GROUP_BITS, number & _IN_GROUP
            if group < groups and index < sizes[group]:
                place = places[begins[group] + index]
                if place != _NOT_THERE:
                    marks[place >> 3] |= 1 << (place & 7)
        return EntrySet(self, int.from_bytes(marks, "little"))


@dataclass(frozen=True)
class EntrySet:
    """Some of the entries, iterated by their numbers in the alphabetical order of their ids."""

    entries: Entries
    bits: int

    def __len__(self) -> int:
        return self.bits.bit_count()

    def __bool__(self) -> bool:
        return self.bits != 0

    def __contains__(self, number: object) -> bool:
        place = self.entries.place(number) if isinstance(number, int) else None
        return place is not None and bool(self._bytes[place >> 3] >> (place & 7) & 1)

    def __iter__(self) -> Iterator[int]:
        numbers = self.entries.numbers
        return (numbers[place] for place in self.places())

    def __and__(self, other: "EntrySet") -> "EntrySet":
        return EntrySet(self.entries, self.bits & other.bits)

    def __or__(self, other: "EntrySet") -> "EntrySet":
        return EntrySet(self.entries, self.bits | other.bits)

    def __sub__(self, other: "EntrySet") -> "EntrySet":
        return EntrySet(self.entries, self.bits & ~other.bits)

    def __le__(self, other: "EntrySet") -> bool:
        return not self.bits & ~other.bits

    def places(self) -> Iterator[int]:
        """Yield the positions of the entries, ascending."""
        for found in re.finditer(rb"[^\0]", self._bytes, re.DOTALL):  # the library skips empty bytes
            begin, eight = found.start() << 3, found[0][0]
            for bit in range(8):
                if eight >> bit & 1:
                    yield begin + bit

    def first(self, count: int) -> list[int]:
        """Return the numbers of the first entries in order of their ids, at most ``count``."""
        return list(islice(self, count))

    @cached_property
    def _bytes(self) -> bytes:
        return self.bits.to_bytes((len(self.entries.numbers) >> 3) + 1, "little")


class Postings:
    """The entries that satisfy conditions, kept while the catalogue is unchanged; shared by all threads of a server."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._changes: int | None = None
        self._entries = Entries(array("q"))
        self._sets: OrderedDict[tuple[object, ...], EntrySet] = OrderedDict()
        self._columns: dict[str, array[float]] = {}
        self._bytes = 0

    def entries(self, connection: sqlite3.Connection) -> Entries:
        """Return the current entries of the catalogue, rebuilt if the catalogue has changed."""
        changes = int(connection.execute("SELECT changes FROM catalog_version").fetchone()[0])
        with self._lock:
            if changes != self._changes:
                query = "SELECT number FROM catalog_scenarios ORDER BY scenario_id"
                self._entries = Entries(array("q", column_of(connection, query)))
                self._changes = changes
                self._sets.clear()
                self._columns.clear()
                self._bytes = 0
            return self._entries

    def holding(
        self, connection: sqlite3.Connection, entries: Entries, query: str, values: Sequence[str | float]
    ) -> EntrySet:
        """Return the entries with the numbers that the query selects."""
        key = (query, *values)
        with self._lock:
            kept = self._sets.get(key)
            if kept is not None and kept.entries is entries:
                self._sets.move_to_end(key)
                return kept
        found = entries.of(column_of(connection, query, values))
        with self._lock:
            if entries is self._entries and key not in self._sets:
                self._sets[key] = found
                self._bytes += found.bits.bit_length() >> 3
                while self._bytes > _KEPT_BYTES or len(self._sets) > _KEPT_SETS:
                    self._bytes -= self._sets.popitem(last=False)[1].bits.bit_length() >> 3
        return found

    def column(self, connection: sqlite3.Connection, entries: Entries, name: str) -> "array[float]":
        """Return a column of numbers, ordered by the entries' positions; NaN for an entry without a number."""
        with self._lock:
            if entries is self._entries and name in self._columns:
                return self._columns[name]
        query = f"SELECT ifnull({name}, 'nan'), number FROM catalog_scenarios"  # noqa: S608 - fixed names
        values = array("d", (float("nan"),)) * len(entries.numbers)
        for value, number in plain_rows(connection, query):
            place = entries.place(number)
            if place is not None:
                values[place] = float(value)
        with self._lock:
            if entries is self._entries:
                self._columns[name] = values
        return values


def plain_rows(connection: sqlite3.Connection, query: str, values: Sequence[str | float] = ()) -> sqlite3.Cursor:
    """Return the rows of a query as plain tuples, which are faster for a million rows."""
    cursor = connection.cursor()
    cursor.row_factory = None
    return cursor.execute(query, values)


def column_of(connection: sqlite3.Connection, query: str, values: Sequence[str | float] = ()) -> Iterator[int]:
    """Return the values of a query's only column."""
    return chain.from_iterable(plain_rows(connection, query, values))
