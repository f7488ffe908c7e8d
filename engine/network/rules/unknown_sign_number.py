"""A sign number that CommonRoad does not know in this country."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

GERMAN_SPEED_LIMIT = "274"
"""The reader takes this number for a speed limit in every country."""


def _find(document: RoadDocument) -> Iterator[Defect]:
    from commonroad.scenario.traffic_sign import SupportedTrafficSignCountry, TrafficSignIDCountries

    countries = {country.value for country in SupportedTrafficSignCountry}
    country = document.country if document.country in countries else SupportedTrafficSignCountry.ZAMUNDA.value
    known = {sign.value for sign in TrafficSignIDCountries[country]} | {GERMAN_SPEED_LIMIT}
    for sign in document.signs:
        for number, _ in sign.plates:
            if number not in known:
                yield Defect(f"{country} has no sign {number!r}", (sign.sign_id,), sign.position)


RULE = Rule(
    rule_id="unknown_sign_number",
    severity="warning",
    meaning="The number of a sign is not among those that CommonRoad knows for the country of the benchmark id.",
    why="The reader takes it for an unknown sign: a limit or a right of way is lost.",
    find=_find,
)
