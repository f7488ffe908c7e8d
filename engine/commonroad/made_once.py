"""What is derived from a scenario and made once, as long as the scenario is in memory."""

import weakref
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

_Value = TypeVar("_Value")
_MOST_MADE = 8
"""Values that are kept (chosen): those of a few starts, some MB each."""


@dataclass(eq=False)
class MadeOnce:
    """Values by key, each made at its first use. If there are too many, the one that was not used longest is dropped.

    A value must not change after it was made, and its key must contain everything that it depends on. If a key contains
    the ``id`` of an object, ``holds`` must contain that object, so that no other object gets the same id.
    """

    most: int = _MOST_MADE
    _values: dict[Hashable, tuple[Any, tuple[object, ...]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Free the values at the end of the process, because native libraries report objects that outlive it."""
        weakref.finalize(self, self._values.clear)

    def __reduce__(self) -> "tuple[type[MadeOnce], tuple[int]]":
        """Leave the values out of copies and of pickles: what native libraries made cannot be copied."""
        return MadeOnce, (self.most,)

    def get(self, key: Hashable, make: Callable[[], _Value], *holds: object) -> _Value:
        """Return the value of a key; ``make`` makes it if there is none."""
        found = self._values.pop(key, None)
        if found is None:
            found = make(), holds
            if len(self._values) >= self.most:
                del self._values[next(iter(self._values))]
        self._values[key] = found
        return cast("_Value", found[0])
