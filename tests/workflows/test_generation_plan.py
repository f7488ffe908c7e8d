"""From arguments to maps, where what several cannot meet is told of all; and how rows of a plan take their sites."""

from typing import Any, cast

import pytest

from plannerforge.engine.generation import Hopeless
from plannerforge.engine.maps import MapMatch
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerateScenariosArguments, GenerationRequest, PlaceArea, SiteCount
from plannerforge.workflows.context import WorkflowContext
from plannerforge.workflows.generation.coverage import Spot
from plannerforge.workflows.generation.map_choice import GenerationPlan, plan_maps, widen_empty
from plannerforge.workflows.generation.specification import read_specification

MATCHES = [MapMatch(entry) for entry in built_in_maps()[:3]]
IDS = [match.entry.facts.map_id for match in MATCHES]


def test_a_type_that_no_map_of_a_box_has_is_refused_with_the_types_of_all_of_them() -> None:
    entries = [entry for entry in built_in_maps() if "roundabout" not in entry.facts.sites]
    arguments = GenerateScenariosArguments(scenario_type="roundabout", country="ZAM", bbox=[-80.0, -170.0, 80.0, 170.0])
    with pytest.raises(NotPossible, match=f"no roundabout site on any of the {len(entries)} matching maps") as caught:
        plan_maps(read_specification(arguments), entries)
    assert set(caught.value.valid) == {kind for entry in entries for kind in entry.facts.sites}


def test_a_single_map_states_itself_what_it_lacks() -> None:
    arguments = GenerateScenariosArguments(scenario_type="ramp", place="Landmoor")
    assert [match.entry.facts.place for match in plan_maps(read_specification(arguments), built_in_maps()).matches] == [
        "Landmoor"
    ]


def taken(spot: Spot, turns: dict[str, int], hopeless: Hopeless, levels: tuple[int, ...] = (0, 1)) -> list[str]:
    """The turns of one row: the numbers of map and site, ``-`` before those that it passes over."""
    return [
        f"{'-' * (state == 'passed')}{IDS.index(match.entry.facts.map_id)}.{site}"
        for match, site, _, state in spot.turns(turns, levels, hopeless, seed=7)
    ]


def test_rows_take_all_sites_in_turn_and_then_another_seed() -> None:
    spot, turns = Spot("ramp", ((MATCHES[0], 2), (MATCHES[1], 1))), dict[str, int]()
    assert [taken(spot, turns, frozenset()) for _ in range(4)] == [["0.0"], ["1.0"], ["0.1"], ["0.0"]]
    assert [seed for _, _, seed, _ in spot.turns(turns, (0, 1), frozenset(), seed=7)] == [8]
    assert turns == {"ramp": 5}


def test_a_row_passes_over_the_sites_of_a_map_that_does_not_suit_it() -> None:
    spot, turns = Spot("ramp", ((MATCHES[0], 3), (MATCHES[1], 1))), dict[str, int]()
    hopeless: Hopeless = frozenset({("ramp", IDS[0], 1, 1), ("rural", IDS[1], 1, 1), ("ramp", IDS[1], 1, 0)})
    assert taken(spot, turns, hopeless) == ["-0.0", "1.0"]
    assert taken(spot, turns, hopeless, (0, 2)) == ["0.1"]
    assert taken(spot, turns, hopeless) == ["-0.2", "-0.0", "1.0"]


def test_a_row_takes_any_map_if_suitable_ones_are_missing_or_far() -> None:
    none: Hopeless = frozenset(("ramp", key, 1, 1) for key in IDS)
    assert taken(Spot("ramp", tuple((match, 1) for match in MATCHES)), {}, none) == ["0.0"]
    first: Hopeless = frozenset({("ramp", IDS[0], 1, 1)})
    far = Spot("ramp", ((MATCHES[0], 9), (MATCHES[1], 1)))
    assert taken(far, {"ramp": 2}, first) == ["-0.1", "-0.2", "-0.3", "-0.4", "0.5"]


class SitesAt:
    """A context in which a map holds sites on the latitudes from ``south``, and nowhere if that is None."""

    def __init__(self, south: float | None) -> None:
        self._south = south

    async def run(self, _operation: object, request: GenerationRequest, **_: Any) -> SiteCount:
        if self._south is None or (request.bbox is not None and request.bbox[2] < self._south):
            raise NotPossible("there is no such site", reason="no_such_site")
        return SiteCount(count=1)


@pytest.mark.anyio
@pytest.mark.parametrize(("south", "is_whole"), [(60.0, True), (50.0, False), (None, False)])
async def test_streets_outside_the_circle_of_their_town_are_looked_for_on_the_whole_map(
    south: float | None, is_whole: bool
) -> None:
    town = PlaceArea(name="Renton", kind="town", latitude=54.6, longitude=5.25, radius_m=300)
    taken = "the town “Renton”, 0.3 km around its centre (54.6000, 5.2500)"
    match = MapMatch(built_in_maps()[0], (("Main Street",),), area=town, understood=(taken,))
    spec = read_specification(GenerateScenariosArguments(place="Main Street, Renton"))
    context = cast("WorkflowContext", SitesAt(south))
    plan = await widen_empty(spec, context, GenerationPlan((match,), (taken,)))
    assert (plan.matches[0].box is None) is is_whole
    assert (taken in plan.notes) is not is_whole
    assert any("whole map was searched" in note for note in plan.notes) is is_whole
