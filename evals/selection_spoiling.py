"""Spoiling the slots of a request as language models do (paper, Results, Slot-level extraction): seeded.

One or two tags that nobody asked for; in half of the requests also a wrong road_net key; in a third the velocity of an
example of the prompt.
"""

import random
from collections.abc import Collection

from plannerforge.schemas.catalog import FindScenariosArguments
from plannerforge.schemas.vocabulary import SIGNS, TAGS

EXAMPLE_SPEEDS = ("50km/h", "10m/s", "30km/h")
WRONG_KEY_SHARE = 0.5
COPIED_SPEED_SHARE = 1 / 3


def spoiled(arguments: FindScenariosArguments, seed: str) -> FindScenariosArguments:
    """The arguments with over-predicted tags, and by chance a wrong key and a copied velocity."""
    chance = random.Random(seed)  # noqa: S311 - a reproducible choice, no secret
    unasked = sorted(set(TAGS) - set(arguments.tags))
    changes: dict[str, object] = {"tags": [*arguments.tags, *chance.sample(unasked, chance.randint(1, 2))]}
    if chance.random() < WRONG_KEY_SHARE:
        asked = " ".join(arguments.road_net)
        changes["road_net"] = [*arguments.road_net, chance.choice([key for key in sorted(SIGNS) if key not in asked])]
    if chance.random() < COPIED_SPEED_SHARE:
        changes["ego_speed"] = chance.choice(EXAMPLE_SPEEDS)
    return arguments.model_copy(update=changes)


def extract_score(truth: FindScenariosArguments, given: FindScenariosArguments) -> float:
    """The paper's *extract* of slots: the mean of five scores in [0, 1]; slots that are empty in both count as 1.

    Tags by the overlap of the sets (Jaccard) as in the paper; it leaves the rest open: the other slots are compared in
    the same way, condition by condition.
    """
    pairs = [
        ({truth.country, truth.city}, {given.country, given.city}),
        (truth.tags, given.tags),
        (truth.road_net, given.road_net),
        (truth.obstacles, given.obstacles),
        ({truth.ego_speed}, {given.ego_speed}),
    ]
    return sum(_overlap(one, other) for one, other in pairs) / len(pairs)


def _overlap(one: Collection[str | None], other: Collection[str | None]) -> float:
    together = set(one) | set(other)
    return len(set(one) & set(other)) / len(together) if together else 1.0
