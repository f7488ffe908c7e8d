"""The requests that the generator is measured with."""

from benchmarks.generation.__main__ import _spread
from plannerforge.evals.ground_truth.generation import left_over_requests, missing_requests, seeded_requests


def shown(place: str, *kinds: str) -> dict[str, object]:
    lights = {"signalised_crossings": {"count": 0}}
    return {"places": [place], "country": "DEU", "scenario_types": list(kinds), "contains": lights}


PLACES = {"a.osm": shown("Town", "urban"), "b.osm": shown("Town", "roundabout"), "c.osm": shown("Village", "rural")}


def test_a_feature_on_another_map_of_the_place_is_not_requested_as_missing() -> None:
    asked = {
        (r.name.rpartition("-")[2], r.given["scenario_type"]) for r in missing_requests(PLACES, frozenset(PLACES), 99)
    }
    assert ("a.osm", "roundabout") not in asked
    assert ("c.osm", "roundabout") in asked
    assert ("a.osm", "ramp") in asked


def test_types_are_requested_in_road_classes_without_them() -> None:
    listed = {"a.osm": shown("Town", "urban", "highway", "intersection"), "b.osm": shown("Village", "urban")}
    asked = left_over_requests(listed, frozenset(listed))
    assert [(r.given["place"], r.given["scenario_type"], r.given["road_classes"]) for r in asked] == [
        ("Town", "urban", ["motorway"]),
        ("Town", "intersection", ["motorway"]),
        ("Town", "highway", ["residential"]),
    ]


def test_a_village_is_not_requested_a_town_that_its_list_leaves_out() -> None:
    listed = {"krautsand.osm": shown("Krautsand", "rural"), "c.osm": shown("Moor", "rural")}
    missing = {r.name for r in missing_requests(listed, frozenset(listed), 99) if r.given["scenario_type"] == "urban"}
    assert missing == {"missing-urban-c.osm"}


def test_seeded_requests_are_reproducible_and_satisfiable() -> None:
    first, again = (seeded_requests(PLACES, frozenset(PLACES), 12) for _ in range(2))
    assert first == again
    assert all(r.arguments.scenario_type in PLACES[str(r.map_name)]["scenario_types"] for r in first)  # type: ignore[operator]


def test_samples_with_all_offsets_contain_every_request_once() -> None:
    found = list(range(60))
    samples = [_spread(found, 15, offset) for offset in range(4)]
    assert sorted(number for sample in samples for number in sample) == found
