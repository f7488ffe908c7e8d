"""Names of scenarios that edits make, by CommonRoad's scheme ``COUNTRY_Map-1_2_T-3``.

The last number tells predictions of the same initial state apart: an edited scenario gets one made of its recipe.
"""

import re

from ...schemas.modification import Edit

_BENCHMARK_ID = re.compile(r"^(?P<head>(C-)?[A-Z]{3}_[A-Za-z0-9]+-\d+)(_(?P<config>\d+)(_(?P<kind>[A-Z])-[\d-]+)?)?$")
DIGITS = 9


def derived_benchmark_id(base_id: str, digest: str) -> str:
    """The base's id with a prediction number made of the recipe's digest (hexadecimal): same recipe, same id.

    Ids that do not follow the scheme keep their text as the map's name.
    """
    number = 10 ** (DIGITS - 1) + int(digest, 16) % (9 * 10 ** (DIGITS - 1))
    match = _BENCHMARK_ID.match(base_id)
    if match is None:
        name = re.sub(r"[^A-Za-z0-9]", "", base_id) or "Scenario"
        return f"ZAM_{name}-1_1_T-{number}"
    return f"{match['head']}_{match['config'] or 1}_{match['kind'] or 'T'}-{number}"


def numbered_after(edits: "list[Edit] | tuple[Edit, ...]", earlier: int) -> tuple[Edit, ...]:
    """The edits with every ``new:K`` counted from the beginning of the whole list that they are appended to."""
    return tuple(
        edit.model_copy(
            update={
                "vehicles": [_moved(text, earlier) for text in edit.vehicles],
                "to": [_moved(text, earlier) for text in edit.to],
                "via": [_moved(text, earlier) for text in edit.via],
                "at": None if edit.at is None else _moved(edit.at, earlier),
            }
        )
        for edit in edits
    )


def _moved(text: str, earlier: int) -> str:
    return re.sub(r"\bnew:(\d+)", lambda found: f"new:{int(found[1]) + earlier}", text)
