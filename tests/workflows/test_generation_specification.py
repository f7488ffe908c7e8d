"""A call for scenarios is read once, at the door: into typed values that keep the words of recipes."""

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any, get_args

import pytest
from support.tree import CHECKOUT

from plannerforge.engine.maps import MapMatch
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.schemas.errors.remedies import followed
from plannerforge.schemas.generation import (
    GenerateScenariosArguments,
    GenerationRequest,
    GenerationSpec,
    RequestedEgo,
    RequestedGoal,
    RequestedManoeuvre,
    ScenarioSpec,
    Turn,
)
from plannerforge.workflows.generation.making import recipe_of
from plannerforge.workflows.generation.map_choice import AssignedSite, request_for
from plannerforge.workflows.generation.specification import read_specification

MOST_MODULES, MOST_RETURNS = 10, 8
FAHRHAUSEN = next(MapMatch(entry) for entry in built_in_maps() if entry.facts.place == "Fahrhausen")


def read(**given: Any) -> GenerationSpec:
    return read_specification(GenerateScenariosArguments.model_validate(given))


@pytest.mark.parametrize(
    ("text", "goal"),
    [
        ("through", RequestedGoal("through")),
        *((f"through:{turn}", RequestedGoal(f"through:{turn}", turn=turn)) for turn in get_args(Turn)),
        ("steps:070", RequestedGoal("steps:070", steps=70)),
        ("distance_m:40.5", RequestedGoal("distance_m:40.5", distance_m=40.5)),
    ],
)
def test_a_goal_is_typed_and_keeps_its_words(text: str, goal: RequestedGoal) -> None:
    assert read(goal=text).goal == goal
    assert str(goal) == text
    assert goal.is_through is text.startswith("through")


def test_a_goal_on_a_lanelet_has_its_position_and_size() -> None:
    lanelet = read(goal="lanelet:7:0.5:8x3").goal.lanelet
    assert lanelet is not None
    assert (lanelet.lanelet_id, lanelet.position, lanelet.size_m) == (7, "0.5", (8.0, 3.0))


@pytest.mark.parametrize(
    ("text", "ego"),
    [
        ("first", RequestedEgo()),
        ("index:2", RequestedEgo("index:2", index=2)),
        ("lorry", RequestedEgo("type:truck", vehicle_class="truck")),
        ("type:bicycle", RequestedEgo("type:bicycle", other_class="bicycle")),
    ],
)
def test_an_ego_is_typed(text: str, ego: RequestedEgo) -> None:
    assert read(ego=text).ego == ego


def test_box_and_manoeuvre_are_typed() -> None:
    spec = read(bbox=[1, 2, 3, 4], conditions=["others=cut-in:lorry"])
    assert (spec.bbox, spec.others) == ((1.0, 2.0, 3.0, 4.0), RequestedManoeuvre("cut_in", "truck"))


def test_all_faults_of_a_generation_call_are_reported_at_once() -> None:
    with pytest.raises(InvalidRequest) as refusal:
        read(goal="nowhere", ego="second", bbox=[3, 2, 1, 4], vehicles=["spaceship"], conditions=["weather=sunny"])
    assert len(refusal.value.faults) == 5


def test_a_misspelt_country_is_refused_with_the_nearest_one_first() -> None:
    with pytest.raises(UnknownName) as refusal:
        read(place="Musterstadt", country="Germny")
    assert refusal.value.valid[0] == "Germany"
    assert refusal.value.remedies[0].changes[0].values == {"country": "Germany"}


def test_a_turn_that_no_ego_makes_at_a_type_is_refused_with_possible_turns() -> None:
    with pytest.raises(InvalidRequest) as refusal:
        read(goal="through:left", scenario_type="highway").check_turn()
    assert set(refusal.value.valid) == {"through:straight", "through:lane_change"}


@pytest.mark.parametrize(
    ("text", "proposed"),
    [("merge", "through:merge"), ("distance_m:99999", "distance_m:2000"), ("steps:3", "steps:10"), ("north", None)],
)
def test_an_invalid_goal_is_refused_with_the_nearest_one_before_it_is_dropped(text: str, proposed: str | None) -> None:
    with pytest.raises(InvalidRequest) as refusal:
        RequestedGoal.of(text)
    calls = [followed(remedy, "generate_scenarios", {"goal": text}) for remedy in refusal.value.remedies]
    assert [call and call.arguments.get("goal") for call in calls] == ([proposed, None] if proposed else [None])


@pytest.mark.parametrize("text", ["!truck", "no trucks", "without lorries", "truck=0"])
def test_a_class_that_is_excluded_has_no_vehicles(text: str) -> None:
    (demand,) = read(vehicles=[text]).vehicles
    assert (demand.vehicle_class, demand.least, demand.most) == ("truck", 0, 0)


def test_every_default_is_defined_in_one_place() -> None:
    assert read() == GenerationSpec()
    arguments, asked = GenerateScenariosArguments(), ScenarioSpec().model_dump(mode="json")
    shared = asked.keys() & arguments.model_dump().keys() - {"road_classes", "vehicles", "conditions"}
    assert {"goal", "ego", "density", "duration_s"} <= shared
    assert {name: asked[name] for name in shared} == {name: getattr(arguments, name) for name in shared}


def test_a_recipe_keeps_its_form_over_versions() -> None:
    request = request_for(read(place="Fahrhausen", ego="lorry", conditions=["others=cut_in"]), site(), 0)
    recorded = recipe_of(request).arguments
    assert [name for name in recorded if name != "map_content"] == [
        *("map_id", "place", "country", "attribution", "scenario_type", "streets", "bbox", "road_classes", "density"),
        *("vehicles", "duration_s", "ego", "goal", "index", "site_index", "site_step", "others"),
    ]
    assert (recorded["goal"], recorded["ego"], recorded["others"]) == ("through", "type:truck", "cut_in")
    assert recorded["vehicles"] == [{"vehicle_class": "truck", "least": None, "most": None, "share": 0.022}]


def site() -> AssignedSite:
    return AssignedSite(FAHRHAUSEN)


def test_all_that_makes_a_scenario_is_recorded() -> None:
    changes = {"most_sites": 1, "most_rounds": 1, "longer_streets": (("Mill Road",),)}
    request = request_for(read(conditions=["weather=fog", "others=cut_in"]), site(), 0).model_copy(update=changes)
    unrecorded = GenerationRequest.model_fields.keys() - recipe_of(request).arguments.keys()
    assert unrecorded == {"map_path", "folder", "benchmark_number", "seed", "longest_s"}


def test_a_request_is_the_same_behind_the_wire() -> None:
    request = request_for(read(goal="through:left", ego="type:bus", conditions=["others=cut_in:truck"]), site(), 0)
    assert GenerationRequest.model_validate_json(request.model_dump_json()) == request


@pytest.fixture(scope="module")
def counting() -> ModuleType:
    """The script that counts the modules which a request passes."""
    spec = importlib.util.spec_from_file_location("count_modules", CHECKOUT / "scripts" / "count_modules.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_request_passes_few_modules_and_seldom_returns(counting: ModuleType, tmp_path: Path) -> None:
    asked = GenerateScenariosArguments.model_validate(counting.USUAL)
    way = counting.count(asked, tmp_path)
    assert {"engine/generation/generator.py", "workflows/generation/specification.py"} <= way["entered"].keys()
    assert way["modules"] <= MOST_MODULES
    assert way["returns"] <= MOST_RETURNS


@pytest.mark.parametrize(
    ("vehicles", "instead"),
    [
        (["truck=900"], {"truck=900": "truck=300"}),
        (["bus=40", "truck=900"], {"truck=900": "truck=260"}),
        (["motorcycle=140%"], {"motorcycle=140%": "motorcycle=100%"}),
        (["car=50%"], {"car=50%": "car"}),
    ],
)
def test_too_many_vehicles_are_refused_with_as_many_as_may_be(vehicles: list[str], instead: dict[str, str]) -> None:
    with pytest.raises(InvalidRequest) as caught:
        read(vehicles=vehicles)
    assert [dict(remedy.changes[0].words) for remedy in caught.value.remedies] == [instead]


@pytest.mark.parametrize(
    ("vehicles", "instead"),
    [(["truck=60%", "bus=70%"], ["truck=46%", "bus=53%"]), (["truck=2", "bus=1", "truck=5"], ["truck=7", "bus=1"])],
)
def test_shares_over_the_whole_and_classes_named_twice_propose_a_call_that_is_valid(
    vehicles: list[str], instead: list[str]
) -> None:
    with pytest.raises(InvalidRequest) as refusal:
        read(vehicles=vehicles)
    proposed = refusal.value.remedies[0].changes[0].values["vehicles"]
    assert proposed == instead
    read(vehicles=proposed)
