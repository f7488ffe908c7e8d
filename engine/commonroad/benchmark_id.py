"""Benchmark ids: names of scenarios by CommonRoad's scheme ``COUNTRY_Map-1_2_T-3``.

The last number tells predictions of the same initial state apart: an edited scenario gets one made of its recipe.
commonroad-io's ``ScenarioID.from_benchmark_id`` is not used: it fails on countries that ISO 3166 does not have, and
drops whatever does not fit its pattern (older files have leading zeros and other letters than S, T, P and I).
"""

import re

_VALID_ID = re.compile(r"[A-Z]{3}_[a-zA-Z0-9]+-[1-9]\d*_[1-9]\d*_[STPI](-[1-9]\d*)+")
_USUAL_ID = re.compile(r"^(?P<head>(C-)?[A-Z]{3}_[A-Za-z0-9]+-\d+)(_(?P<config>\d+)(_(?P<kind>[A-Z])-[\d-]+)?)?$")
_DIGITS = 9
"""Chosen: of a thousand derived scenarios two have the same number once in about 2,000 times."""


def is_benchmark_id(text: str) -> bool:
    """Whether a text is the id of a scenario as the documentation of format 2020a has it, without cooperation."""
    return _VALID_ID.fullmatch(text) is not None


def derived_benchmark_id(base_id: str, digest: str) -> str:
    """The base's id with a prediction number made of the recipe's digest (hexadecimal): same recipe, same id.

    Ids that do not follow the scheme keep their text as the map's name.
    """
    number = 10 ** (_DIGITS - 1) + int(digest, 16) % (9 * 10 ** (_DIGITS - 1))
    match = _USUAL_ID.match(base_id)
    if match is None:
        name = re.sub(r"[^A-Za-z0-9]", "", base_id) or "Scenario"
        return f"ZAM_{name}-1_1_T-{number}"
    return f"{match['head']}_{match['config'] or 1}_{match['kind'] or 'T'}-{number}"
