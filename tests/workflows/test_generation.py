from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import town_road
from support.server import Connect

from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]
NEAR = {"duration_s": 5, "goal": "steps:20"}
"""Short recordings with a near goal take one simulation; a way through a site takes up to ten."""
WISH = {"place": "Musterstadt", "vehicles": ["truck", "bicycle=2"], "count": 2, "seed": 4, **NEAR}


async def test_scenarios_are_stored_and_the_same_request_gives_the_stored_ones(connect: Connect) -> None:
    async with connect() as client:
        first = (await client.call_tool("generate_scenarios", WISH)).structured_content
        assert first is not None
        assert len({made["scenario_id"] for made in first["scenarios"]}) == 2
        for made in first["scenarios"]:
            assert made["checks_failed"] == []
            assert made["classes_realised"]["bicycle"] >= 2
            described = await client.call_tool("describe_scenario", {"scenario_id": made["scenario_id"]})
            assert not described.is_error
        again = (await client.call_tool("generate_scenarios", WISH)).structured_content
        assert again is not None
        assert all(made["reused"] for made in again["scenarios"])
        assert [made | {"reused": False} for made in again["scenarios"]] == first["scenarios"]


async def test_no_site_is_used_twice_and_too_few_sites_give_fewer_scenarios(connect: Connect) -> None:
    async with connect() as client:
        wish = {"place": "Ostallee", "scenario_type": "intersection", "count": 9, **NEAR}
        answer = (await client.call_tool("generate_scenarios", wish)).structured_content
        assert answer is not None
        made = answer["scenarios"]
        assert 0 < len(made) < 9
        assert len({(one["latitude"], one["longitude"]) for one in made}) == len(made)
        assert all("Ostallee" in one["site"] for one in made)
        assert any(f"only {len(made)} distinct site" in note for note in answer["notes"])


@pytest.mark.parametrize(
    ("wish", "valid"),
    [
        ({"place": "Atlantis"}, "Musterstadt"),
        ({"place": "Landmoor", "scenario_type": "ramp"}, "rural"),
        ({"place": "Landmoor", "scenario_type": "ramp", "count": 2}, "no ramp site"),
        ({"vehicles": ["trukc"]}, "truck"),
        ({"vehicles": ["car>many"]}, "car"),
        ({"bbox": [5, 4, 3, 2]}, "south"),
        ({"bbox": [54.6, 5.2, 54.6, 5.2]}, "is not a box"),
        ({"bbox": [36.0, -9.0, 44.0, 4.0]}, "Musterstadt"),
        ({"vehicles": ["car=10000"]}, "at most 300"),
        ({"vehicles": ["truck=5", "truck=2"]}, "contains truck more than once"),
        ({"vehicles": ["bicycle=0"], "ego": "type:bicycle"}, "vehicles excludes it"),
        ({"vehicles": ["taxi=70%", "bus=40%"]}, "add up to 110%"),
        ({"vehicles": ["car=50%"]}, "make up the rest"),
        ({"duration_s": 0}, "duration_s"),
        ({"road_classes": ["motorwy"]}, "motorway"),
        ({"goal": "tomorrow"}, "steps:N"),
    ],
)
async def test_an_impossible_request_is_refused_with_possible_ones(
    connect: Connect, wish: dict[str, object], valid: str
) -> None:
    async with connect() as client:
        answer = await client.call_tool("generate_scenarios", wish)
        assert answer.is_error
        assert valid in str(answer.content)


async def test_a_proposed_place_always_has_a_site_of_the_requested_type(connect: Connect) -> None:
    async with connect() as client:
        for kind, is_proposed in (("ramp", False), ("rural", True)):
            wish = {"place": "Nirgendwo Allee, Landmoor", "scenario_type": kind}
            answer = await client.call_tool("generate_scenarios", wish)
            assert answer.is_error
            assert ('call again with {"place": "Landmoor"' in answer.content[0].text) is is_proposed  # type: ignore[union-attr]


async def test_a_trial_run_reports_the_default_planner_s_result_on_a_scenario(connect: Connect) -> None:
    async with connect() as client:
        wish = {"place": "Landmoor", "scenario_type": "rural", "duration_s": 8, "trial_run": True}
        answer = await client.call_tool("generate_scenarios", wish)
        assert answer.structured_content is not None
        made = answer.structured_content["scenarios"][0]
        assert "planner can run" in made["checks_passed"]
        assert made["trial_run"].startswith("run_")
        assert "(frenetix:Default)" in made["trial_run"]
        assert made["trial_run"] in str(answer.content)
        ran = await client.call_tool(
            "run_planner", {"scenarios": [made["scenario_id"]], "configs": ["frenetix:Default"]}
        )
        assert ran.structured_content is not None
        assert ran.structured_content["runs"][0]["run_id"] in made["trial_run"]
        assert ran.structured_content["reused"] == 1


async def test_no_planner_runs_unless_requested(connect: Connect) -> None:
    async with connect() as client:
        answer = await client.call_tool("generate_scenarios", {"place": "Landmoor", **NEAR})
        assert answer.structured_content is not None
        assert answer.structured_content["scenarios"][0]["trial_run"] == ""


async def test_a_scenario_with_a_used_id_gets_a_new_one(connect: Connect, settings: Settings, tmp_path: Path) -> None:
    wish = {"place": "Landmoor", "seed": 8, **NEAR}
    async with connect() as client:
        first = (await client.call_tool("generate_scenarios", wish)).structured_content or {}
        usual = first["scenarios"][0]["scenario_id"]
    replace(town_road().cut(4), benchmark_id=usual).write(tmp_path / "taken.xml")
    fresh = settings.model_copy(update={"workspace": tmp_path / "fresh", "starter": False})
    async with connect(fresh) as client:
        imported = await client.call_tool("import_files", {"path": str(tmp_path / "taken.xml")})
        assert not imported.is_error
        answer = (await client.call_tool("generate_scenarios", wish)).structured_content or {}
        made = answer["scenarios"][0]
        assert made["scenario_id"] != usual
        assert made["vehicles_realised"] == first["scenarios"][0]["vehicles_realised"]
        again = (await client.call_tool("generate_scenarios", wish)).structured_content or {}
        assert (again["scenarios"][0]["scenario_id"], again["scenarios"][0]["reused"]) == (made["scenario_id"], True)
