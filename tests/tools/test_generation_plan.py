"""From the arguments to maps: what several maps cannot meet is told of all of them."""

import pytest

from plannerforge.engine.maps.index import built_in_maps
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerateScenariosArguments
from plannerforge.tools.generation.requests import plan_maps


def test_a_type_that_no_map_of_a_box_holds_is_refused_with_what_all_of_them_hold() -> None:
    entries = [entry for entry in built_in_maps() if "roundabout" not in entry.facts.sites]
    arguments = GenerateScenariosArguments(scenario_type="roundabout", country="ZAM", bbox=[-80.0, -170.0, 80.0, 170.0])
    with pytest.raises(NotPossible, match=f"none of {len(entries)} maps holds any roundabout site") as caught:
        plan_maps(arguments, entries)
    assert set(caught.value.valid) == {kind for entry in entries for kind in entry.facts.sites}


def test_a_single_map_is_left_to_say_itself_what_it_lacks() -> None:
    arguments = GenerateScenariosArguments(scenario_type="ramp", place="Landmoor")
    assert [match.entry.facts.place for match in plan_maps(arguments, built_in_maps()).matches] == ["Landmoor"]
