"""Answers of map services are read by their documented form."""

from typing import Any

import pytest

from plannerforge.engine.maps.online.messages import NotReadable, read_findings, read_map_data

FINDING: dict[str, Any] = {
    "lat": "54.6",
    "lon": 5.2,
    "boundingbox": ["54.5", "54.7", "5.1", "5.3"],
    "display_name": "Town, Land",
    "importance": 0.5,
}
NODE: dict[str, Any] = {"type": "node", "id": 7, "lat": 54.6, "lon": 5.2}


def test_numbers_may_be_text_as_nominatim_writes_them() -> None:
    (finding,) = read_findings([FINDING])
    assert (finding["lat"], finding["lon"]) == (54.6, 5.2)


@pytest.mark.parametrize(
    "changed", [{"lat": True}, {"lon": False}, {"boundingbox": ["54.5", True, "5.1", "5.3"]}, {"importance": True}]
)
def test_a_boolean_is_not_a_number_of_a_finding(changed: dict[str, Any]) -> None:
    with pytest.raises(NotReadable):
        read_findings([FINDING | changed])


@pytest.mark.parametrize("changed", [{"lat": True}, {"id": True}])
def test_a_boolean_is_not_a_number_of_map_data(changed: dict[str, Any]) -> None:
    assert read_map_data({"elements": [NODE]})["elements"]
    with pytest.raises(NotReadable):
        read_map_data({"elements": [NODE | changed]})
