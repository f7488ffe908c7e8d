"""Almost correct words."""

import random
import string
from collections.abc import Callable
from typing import Any

from .world import World

Arguments = dict[str, Any]
Draw = Callable[[World, random.Random], Arguments | None]
"""Draws the arguments of a wrong call; None if the workspace has nothing for this kind."""


def misspelt(word: str, rng: random.Random) -> str:
    """Return a word with one letter omitted, doubled, swapped with the next or replaced."""
    place = rng.randrange(1, max(len(word) - 1, 2))
    letter = rng.choice(string.ascii_lowercase.replace(word[place].lower(), ""))
    changed = {
        "left_out": word[:place] + word[place + 1 :],
        "doubled": word[:place] + word[place] + word[place:],
        "swapped": word[: place - 1] + word[place] + word[place - 1] + word[place + 1 :],
        "other": word[:place] + letter + word[place + 1 :],
    }[rng.choice(["left_out", "doubled", "swapped", "other"])]
    return changed if changed != word else word + letter


def unknown_id(kind: str, rng: random.Random) -> str:
    """Return an id of a kind of artifact with random digits."""
    return f"{kind}_{rng.getrandbits(48):012x}"
