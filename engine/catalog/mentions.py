"""Whether the user's own words name a condition: such a one was asked for, while others may be a model's guess.

The paper's models hardly miss a slot that was asked for; they add some that were not (Results, Slot-level extraction).
"""

import re

from plannerforge.engine.catalog.bm25 import words_of
from plannerforge.engine.catalog.constraints import Constraint

_STEM_LETTERS = 5
"""Words that begin alike count as one: trucks and truck, intersections and intersection."""


def is_mentioned(condition: Constraint, text: str) -> bool:
    """Whether all words of a name that the condition is about, or all numbers of a speed, stand in the text."""
    if condition.stage == "velocity":
        numbers = re.findall(r"\d+", condition.label)
        return bool(numbers) and set(numbers) <= set(re.findall(r"\d+", text))
    said = _stems(text)
    names = [word for _, word in condition.words] or [condition.subject]
    return any(_stems(name) <= said for name in names)


def _stems(text: str) -> set[str]:
    return {word[:_STEM_LETTERS] for word in words_of(text)}
