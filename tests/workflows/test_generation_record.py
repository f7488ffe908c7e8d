"""describe_scenario tells how a generated scenario came out, and what its vehicles were generated as."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.server import Connect, KeptWorkers

from plannerforge.engine.execution import WorkerPool
from plannerforge.schemas.generation import SHARES_SOURCE
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.workflows.generation.record import REPORT

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]
WISH = {
    "place": "Musterstadt",
    "scenario_type": "urban",
    "vehicles": ["delivery=2", "moped=1", "truck=1"],
    "duration_s": 5,
    "goal": "steps:20",
}


@pytest.fixture(scope="module")
async def generated(
    anyio_backend: str, starter_workspace: Path, kept_workers: KeptWorkers, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Settings, dict[str, Any]]:
    """Settings of a workspace with the scenario, and the answer to the request for it."""
    folder = tmp_path_factory.mktemp("generated")
    own = Settings(workspace=folder / "workspace", roots=(folder,), workers=1, warm_up=False)
    shutil.copytree(starter_workspace, own.workspace)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WorkerPool, "open", kept_workers.lent)
        async with Client(create_server(own, start_folder=folder)) as client:
            made = (await client.call_tool("generate_scenarios", WISH)).structured_content
    assert made is not None
    return own, made


async def test_classes_without_a_commonroad_type_are_reported_for_every_vehicle(
    connect: Connect, generated: tuple[Settings, dict[str, Any]]
) -> None:
    async with connect(generated[0]) as client:
        answer = await client.call_tool("describe_scenario", {"detail": "vehicles", "radius_m": 2000})
        assert answer.structured_content is not None
        vehicles = answer.structured_content["description"]["vehicles"]
        classes = [(one["kind"], one["vehicle_class"]) for one in vehicles if one["kind"] != "car"]
        assert sorted(classes) == [("motorcycle", "moped"), ("truck", ""), ("truck", "delivery"), ("truck", "delivery")]
        assert str(answer.content).count(" truck (delivery): ") == 2
        assert str(answer.content).count(" motorcycle (moped): ") == 1


async def test_requested_and_realised_values_are_reported_with_the_checks(
    connect: Connect, generated: tuple[Settings, dict[str, Any]]
) -> None:
    own, made = generated
    async with connect(own) as client:
        answer = await client.call_tool("describe_scenario", {"detail": "checks"})
        assert answer.structured_content is not None
        told = answer.structured_content["generation"]
        assert told["site"]["latitude"] == made["scenarios"][0]["latitude"]
        assert told["classes_asked"] == {"truck": 1, "delivery": 2, "moped": 1}
        assert told["vehicles_realised"] == made["scenarios"][0]["vehicles_realised"]
        assert told["checks_failed"] == []
        assert "Generated: urban (requested: urban) at " in str(answer.content)
        assert "5 s recorded (requested: 5)" in str(answer.content)


async def test_notes_and_warnings_are_listed_in_full_if_the_detail_requests_them(
    connect: Connect, generated: tuple[Settings, dict[str, Any]], settings: Settings
) -> None:
    own, made = generated
    shutil.rmtree(settings.workspace)
    shutil.copytree(own.workspace, settings.workspace)
    async with connect() as client:
        path = settings.workspace / "scenarios" / made["scenarios"][0]["scenario_id"] / REPORT
        warnings = [f"edge {number} is odd" for number in range(40)]
        repair = "an earlier attempt failed: vehicles overlap"
        kept = json.loads(path.read_text()) | {"netconvert_warnings": warnings, "notes": [repair]}
        path.write_text(json.dumps(kept))
        brief = str((await client.call_tool("describe_scenario", {})).content)
        assert "Generated:" not in brief
        assert warnings[7] not in brief
        for detail in ("checks", "recipe"):
            text = str((await client.call_tool("describe_scenario", {"detail": detail})).content)
            assert all(f"netconvert: {warning}" in text for warning in warnings)
            assert f"Generation note: {repair}" in text


async def test_scenarios_of_other_origin_lack_this_part(connect: Connect) -> None:
    async with connect() as client:
        answer = await client.call_tool("describe_scenario", {})
        assert answer.structured_content is not None
        assert answer.structured_content["generation"] is None
        assert "Generated:" not in str(answer.content)


async def test_shares_of_traffic_are_reported_with_their_source(connect: Connect) -> None:
    async with connect() as client:
        vehicles = ["bus", "taxi", "truck=30%"]
        wish = {"place": "Musterstadt", "vehicles": vehicles, "duration_s": 5, "goal": "steps:20"}
        made = (await client.call_tool("generate_scenarios", wish)).structured_content
        assert made is not None
        bus, taxi, truck = made["scenarios"][0]["notes"][:3]
        assert bus.startswith("bus: 0.25% of all vehicles")
        assert SHARES_SOURCE in bus
        assert taxi.startswith("at least 1 taxi, ")
        realised = made["scenarios"][0]["classes_realised"]
        assert (realised["bus"], realised["taxi"]) == (1, 1)
        assert truck.startswith("truck: 30% of all vehicles requested, ")
        assert 0.2 < realised["truck"] / made["scenarios"][0]["vehicles_realised"] < 0.4


async def test_conditions_are_reported_and_the_scenario_is_found_by_them_after_an_edit_too(connect: Connect) -> None:
    async with connect() as client:
        conditions = ["time=night", "drivers=m25_gaps", "trips=fringe"]
        wish = {"place": "Musterstadt", "duration_s": 5, "goal": "steps:20", "conditions": conditions}
        made = (await client.call_tool("generate_scenarios", wish)).structured_content
        assert made is not None
        scenario_id = made["scenarios"][0]["scenario_id"]
        assert "quarter million pairs on the M25" in str(made["notes"])
        told = str((await client.call_tool("describe_scenario", {"detail": "recipe"})).content)
        assert all(word in told for word in ("time=02:30", "drivers=m25_gaps", "trips=fringe"))
        edit = {"edits": [{"op": "remove_vehicle", "vehicles": ["farthest"]}], "scenario_id": scenario_id}
        edited = (await client.call_tool("modify_scenario", edit)).structured_content
        found = (await client.call_tool("find_scenarios", {"tags": ["night"]})).structured_content
        assert found is not None
        assert edited is not None
        assert {one["scenario_id"] for one in found["matches"]} == {scenario_id, edited["scenario_id"]}
