"""What becomes of a scenario that cannot be made where it was ordered."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.server import Connect

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation import generator as generating
from plannerforge.engine.generation.site_network import SiteNetwork, prepare_site
from plannerforge.engine.generation.sites import fitting_sites
from plannerforge.engine.maps.index import MapMatch, built_in_maps
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerateScenariosArguments, GenerationRequest
from plannerforge.workflows.context import WorkflowContext
from plannerforge.workflows.generation.map_choice import AssignedSite, request_for, share_sites
from plannerforge.workflows.generation.specification import read_specification
from plannerforge.workflows.operations import GENERATE_SCENARIO

MAPS = {entry.facts.place: MapMatch(entry) for entry in built_in_maps()}
OVER_THREE_MAPS = [54.602, 5.195, 54.634, 5.2434]
"""A corner of Fahrhausen without a site, the upper rim of Musterstadt, and Kreiselheim."""


def test_maps_take_turns_and_a_replacement_site_is_not_another_scenario_s_own() -> None:
    orders = share_sites([MAPS["Fahrhausen"], MAPS["Landmoor"], MAPS["Neuland"]], [4, 0, 1], 4)
    assert [(o.match.entry.facts.place, o.site_index) for o in orders] == [
        ("Fahrhausen", 0),
        ("Neuland", 0),
        ("Fahrhausen", 1),
        ("Fahrhausen", 2),
    ]
    ways = [set(range(o.site_index, 100, o.site_step)) for o in orders if o.match is MAPS["Fahrhausen"]]
    assert sum(map(len, ways)) == len(set.union(*ways))


def test_a_site_that_fails_is_replaced_by_an_unused_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = GenerateScenariosArguments.model_validate(
        {"place": "Fahrhausen", "scenario_type": "intersection", "duration_s": 5, "goal": "steps:20", "count": 3}
    )
    order = share_sites([MAPS["Fahrhausen"]], [4], arguments.count)[0]
    request = request_for(read_specification(arguments), order, 0)
    asked: list[tuple[float, float]] = []

    def fails_once(*given: object) -> SiteNetwork:
        asked.append((given[2].latitude, given[2].longitude))  # type: ignore[attr-defined]
        if len(asked) == 1:
            raise NotPossible("this site is flooded")
        return prepare_site(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(generating, "prepare_site", fails_once)
    made = generating.generate_scenario(request.model_copy(update={"folder": str(tmp_path)}), silent)
    sites = fitting_sites(generating.read_map_file(Path(request.map_path)), request)
    assert asked == [(site.latitude, site.longitude) for site in (sites[0], sites[3])]
    assert any("this site is flooded" in note for note in made.notes)


@pytest.mark.parametrize("spelled", ["GBR", "gbr", "United Kingdom"])
def test_a_country_named_for_a_map_without_one_reaches_the_engine_as_its_code(spelled: str) -> None:
    entry = MAPS["Fahrhausen"].entry
    nowhere = replace(entry, facts=entry.facts.model_copy(update={"country": None}))
    arguments = GenerateScenariosArguments.model_validate({"country": spelled})
    assert request_for(read_specification(arguments), AssignedSite(MapMatch(nowhere)), 0).country == "GBR"


@pytest.mark.parametrize(
    ("wish", "demands"),
    [
        ({"vehicles": ["truck"]}, [{"vehicle_class": "truck", "least": None, "most": None, "share": 0.022}]),
        ({"vehicles": ["taxi"]}, [{"vehicle_class": "taxi", "least": None, "most": None, "share": 0.0}]),
        ({"vehicles": ["taxi = 30%"]}, [{"vehicle_class": "taxi", "least": None, "most": None, "share": 0.3}]),
        ({"ego": "type:bus"}, [{"vehicle_class": "bus", "least": None, "most": None, "share": 0.0025}]),
        ({"vehicles": ["bus=2"], "ego": "type:bus"}, [{"vehicle_class": "bus", "least": 2, "most": None}]),
        ({"vehicles": ["car"]}, [{"vehicle_class": "car", "least": None, "most": None}]),
    ],
)
def test_a_class_without_a_number_is_requested_by_its_share(wish: dict[str, object], demands: list[object]) -> None:
    arguments = GenerateScenariosArguments.model_validate(wish)
    request = request_for(read_specification(arguments), AssignedSite(MAPS["Fahrhausen"]), 0)
    assert request.model_dump(mode="json")["vehicles"] == demands


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
async def test_the_orders_of_a_call_reach_the_engine_with_their_step(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[GenerationRequest] = []
    run = WorkflowContext.run

    async def only_listen(call: WorkflowContext, operation: Any, request: Any, **options: Any) -> Any:
        if operation is not GENERATE_SCENARIO:
            return await run(call, operation, request, **options)
        asked.append(request)
        raise NotPossible("nothing is made here")

    monkeypatch.setattr(WorkflowContext, "run", only_listen)
    async with connect() as client:
        wish = {"place": "Fahrhausen", "scenario_type": "intersection", "count": 3}
        assert (await client.call_tool("generate_scenarios", wish)).is_error
    assert [(request.site_index, request.site_step) for request in asked] == [(0, 3), (1, 3), (2, 3)]


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
async def test_a_box_over_two_maps_is_served_by_the_map_with_a_site_in_it(connect: Connect) -> None:
    async with connect() as client:
        wish = {"bbox": OVER_THREE_MAPS, "scenario_type": "intersection", "duration_s": 5, "goal": "steps:20"}
        answer = (await client.call_tool("generate_scenarios", wish)).structured_content
        assert answer is not None
        made = answer["scenarios"][0]
        assert made["place"] != "Fahrhausen"
        assert any(note.startswith("another map was used: “Fahrhausen”") for note in answer["notes"])


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
async def test_finished_scenarios_are_reported_even_if_another_fails(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = WorkflowContext.run

    async def not_the_second(call: WorkflowContext, operation: Any, request: Any, **options: Any) -> Any:
        if operation is GENERATE_SCENARIO and request.index == 1:
            raise NotPossible("no truck found room at this site")
        return await run(call, operation, request, **options)

    monkeypatch.setattr(WorkflowContext, "run", not_the_second)
    async with connect() as client:
        near = {"duration_s": 5, "goal": "steps:20"}
        wish = {"place": "Fahrhausen", "scenario_type": "intersection", "count": 3, **near}
        answer = (await client.call_tool("generate_scenarios", wish)).structured_content
        assert answer is not None
        assert len(answer["scenarios"]) == 2
        assert "scenario 2 was not generated: no truck found room at this site" in answer["notes"]
