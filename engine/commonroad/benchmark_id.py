"""Benchmark ids: names of scenarios in CommonRoad's scheme ``COUNTRY_Map-1_2_T-3``.

The last number distinguishes predictions of the same initial state: an edited scenario gets a prediction number from
its recipe. This module does not use commonroad-io's ``ScenarioID.from_benchmark_id``, which fails on countries outside
ISO 3166 and drops everything that does not match its pattern. Older files have leading zeros and letters other than S,
T, P and I.
"""

import re

from ...schemas.errors import UnsafeInput
from ...schemas.text import cited

_VALID_ID = re.compile(r"(C-)?[A-Z]{3}_[a-zA-Z0-9]+-[1-9]\d*_[1-9]\d*_[STPI](-[1-9]\d*)+")
_USUAL_ID = re.compile(r"^(?P<head>(C-)?[A-Z]{3}_[A-Za-z0-9]+-\d+)(_(?P<config>\d+)(_(?P<kind>[A-Z])-[\d-]+)?)?$")
_READABLE_ID = re.compile(r"(?:C-)?([A-Z]{3})_([A-Za-z0-9][A-Za-z0-9_]{0,60}?)(?:-[A-Za-z0-9_,]{1,30}){0,3}")
"""Ids with a readable country and place: more than the scheme allows."""
_SAFE_ID = re.compile(
    r"(?:C-)?(?:(?P<country>[A-Z]{3})[_-](?=[A-Za-z0-9]))?(?P<place>[A-Za-z0-9]{0,40})[A-Za-z0-9_.\-]{0,60}"
)
"""Ids that are accepted as they are: only those that are file names."""
_ARTIFICIAL = "ZAM"
_DIGITS = 9
"""Chosen: among a thousand derived scenarios, two share a number once in about 2,000 times."""


def is_benchmark_id(text: str) -> bool:
    """Return whether a text is a scenario id as documented for format 2020a (``C-``: cooperative)."""
    return _VALID_ID.fullmatch(text) is not None


def derived_benchmark_id(base_id: str, digest: str) -> str:
    """Return the base's id with a prediction number derived from the recipe's hexadecimal digest.

    The same recipe gives the same id. An id that does not follow the scheme is used as the map's name.
    """
    number = 10 ** (_DIGITS - 1) + int(digest, 16) % (9 * 10 ** (_DIGITS - 1))
    match = _USUAL_ID.match(base_id)
    if match is None:
        name = re.sub(r"[^A-Za-z0-9]", "", base_id) or "Scenario"
        return f"ZAM_{name}-1_1_T-{number}"
    return f"{match['head']}_{match['config'] or 1}_{match['kind'] or 'T'}-{number}"


def without_blanks(benchmark_id: str) -> str:
    """Return an id as a file name: blanks, which are allowed only by CommonRoad's schema, become ``_``."""
    return re.sub(r"\s+", "_", benchmark_id.strip())


def follows_naming(benchmark_id: str) -> bool:
    """Return whether an id has a readable country and place in CommonRoad's naming, COUNTRY_Place-…"""
    return _READABLE_ID.fullmatch(benchmark_id) is not None


def parse_benchmark_id(benchmark_id: str) -> tuple[str, str]:
    """Return the country and place of a CommonRoad benchmark id, without the cooperative prefix ``C-``.

    An id that does not follow the naming is read where possible; the country is ``ZAM`` if there is none.

    Raises:
        UnsafeInput: the id cannot be a file name, as every id must.
    """
    match = _READABLE_ID.fullmatch(benchmark_id)
    if match is not None:
        return match[1], match[2]
    safe = _SAFE_ID.fullmatch(benchmark_id)
    if safe is None or not safe["place"]:
        raise UnsafeInput(
            f"the benchmark id {cited(benchmark_id, 80)} does not follow CommonRoad's naming and cannot name a file",
            valid=["COUNTRY_Place-1_1_T-1", "letters, digits, _ - and . (at most 100)"],
            next_step="correct benchmarkID in the file's root element",
        )
    return safe["country"] or _ARTIFICIAL, safe["place"]
