"""list_planners, configure_planner and run_planner through a real client session."""

from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import Lane, Problem, ScenarioBuilder, line, town_road

from plannerforge.engine.planners import PLANNERS
from plannerforge.engine.tuning import tuning_of
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
Call = Callable[..., Awaitable[Any]]


@pytest.fixture
async def call(settings: Settings, warm_workers: None, tmp_path: Path) -> AsyncIterator[Call]:
    """Calls a tool of a workspace with two scenarios; gives the structured answer, or the text of an error."""
    folder = tmp_path / "files"
    folder.mkdir()
    near = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))
    replace(town_road(), problems=(near,)).write(folder / "one.xml")
    problems = (near, replace(near, problem_id=200, start=(40.0, 3.5, 0.0, 8.0), goal=(70.0, 3.5, 8.0, 3.0)))
    replace(town_road().with_vehicles(), problems=problems, benchmark_id="ZAM_Builder-2_1_T-1").write(
        folder / "two.xml"
    )
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:

        async def ask(tool: str, **arguments: Any) -> Any:
            result = await client.call_tool(tool, arguments)
            return result.content[0].text if result.is_error else result.structured_content  # type: ignore[union-attr]

        assert (await ask("import_files", path=str(folder)))["added"] == 2
        yield ask


async def test_available_settings(call: Call) -> None:
    found = await call("list_planners")
    assert [item["name"] for item in found["planners"]] == list(PLANNERS)
    assert found["config_name"] == "frenetix:Default"
    tuning = tuning_of("frenetix")
    assert [item["name"] for item in found["weights"]] == [*tuning.weights, *tuning.external]
    assert [item["name"] for item in found["weights"] if not item["acts"]] == ["occ_pm", "occ_um", "occ_ve"]
    made = await call("configure_planner", preset="Safety", weights=["jerk=0.3"])
    found = await call("list_planners", planner="Frenetix")
    assert found["config_id"] == made["config_id"]
    assert {item["name"]: item["value"] for item in found["weights"]}["jerk"] == 0.3
    assert [entry["config_id"] for entry in found["configurations"]] == [made["config_id"]]


async def test_the_answer_to_one_run_says_that_the_ego_ran_a_red_light(
    settings: Settings, warm_workers: None, tmp_path: Path
) -> None:
    lanes = (
        Lane(1, line((0.0, 0.0), (50.0, 0.0)), successors=(2,)),
        Lane(2, line((50.0, 0.0), (150.0, 0.0)), predecessors=(1,)),
    )
    path = ScenarioBuilder(lanes, problems=(Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 80)),)).write(
        tmp_path / "one.xml"
    )
    async with Client(create_server(settings.model_copy(update={"starter": False}), start_folder=tmp_path)) as client:
        await client.call_tool("import_files", {"path": str(path)})
        broken = {}
        for colour in ("red", "green"):
            edit = {"op": "set_light", "to": ["1"], "params": [f"{colour}=100"]}
            await client.call_tool("modify_scenario", {"scenario_id": "ZAM_Builder-1_1_T-1", "edits": [edit]})
            for _ in range(2):  # a stored run says it too
                result = await client.call_tool("run_planner", {"scenarios": ["latest"], "configs": ["idm"]})
                (run,) = result.structured_content["runs"]  # type: ignore[index]
                assert run["outcome"] == "goal_reached"
                broken.setdefault(colour, []).append([rule["rule"] for rule in run.get("broken_rules", ())])
        assert broken == {"red": [["R_IN2"]] * 2, "green": [[]] * 2}


async def test_full_disk_while_a_configuration_is_written_is_named(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, *arguments: Any, **options: Any) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", refuse)
        assert "[resource_failure] the configuration cfg_" in await call("configure_planner", weights=["prediction*2"])
    assert (await call("configure_planner", weights=["prediction*2"]))["changes"]


async def test_a_chain_of_configurations(call: Call) -> None:
    first = await call("configure_planner", weights=["prediction*2"])
    assert [(c["name"], c["before"], c["after"]) for c in first["changes"]] == [("prediction", 0.2, 0.4)]
    second = await call("configure_planner", weights=["prediction*2"])
    assert second["base"] == first["config_id"]
    assert second["changes"][0]["after"] == 0.8
    again = await call("configure_planner", base="frenetix:Default", weights=["prediction=0.4"])
    assert again["config_id"] == first["config_id"]
    assert again["reused"]
    assert (await call("list_planners"))["config_id"] == first["config_id"] != second["config_id"]
    exported = await call("export_artifacts", ids=[first["config_id"]], formats=["yaml"], folder="out")
    written = Path(exported["files"][0]["path"])
    assert "prediction: 0.4" in written.read_text(encoding="utf-8")
    written.write_text(
        written.read_text(encoding="utf-8").replace("prediction: 0.4", "prediction: 0.7"), encoding="utf-8"
    )
    imported = (await call("import_files", path=str(written)))["items"][0]["artifact_id"]
    back = await call("export_artifacts", ids=[imported], formats=["yaml"], folder="back")
    assert "prediction: 0.7" in Path(back["files"][0]["path"]).read_text(encoding="utf-8")
    assert (await call("list_planners"))["config_id"] == imported


async def test_the_baseline_and_settings_go_the_whole_way(call: Call) -> None:
    listed = await call("list_planners", planner="idm")
    assert (listed["config_name"], len(listed["weights"])) == ("idm:Default", 5)
    assert "sampling_level" not in [item["name"] for item in listed["settings"]]
    made = await call("configure_planner", planner="idm", preset="Sporty", settings=["vehicle=1", "replan_steps=1"])
    assert made["against"] == "idm:Sporty"
    assert {c["name"] for c in made["changes"]} >= {"vehicle", "length_m", "replan_steps"}
    assert "time_headway_s" not in {c["name"] for c in made["changes"]}
    scenario = "ZAM_Builder-1_1_T-1"
    configs = ["idm", made["config_id"], "frenetix"]
    grid = await call("run_planner", scenarios=[scenario], configs=configs, wait_s=50)
    assert [run["outcome"] for run in grid["runs"]].count("invalid") == 0
    runs = {run["config_id"]: run["run_id"] for run in grid["runs"]}
    compared = await call("compare_results", results=[grid["batch_id"]])
    changed = [{change["weight"] for change in pair["weights"]} for pair in compared["comparisons"]]
    assert {"time_headway_s", "vehicle", "replan_steps"} <= changed[0]
    assert {"time_headway_s", "prediction"} <= changed[1]
    analysis = await call("analyze_results", results=[grid["batch_id"]])
    assert not isinstance(analysis, str), analysis
    assert not isinstance(await call("render", ids=[runs[made["config_id"]]]), str)
    assert "no cost terms were recorded" in await call("render", ids=[runs[listed["config_id"]]], kind="costs")
    exported = await call("export_artifacts", ids=[made["config_id"]], formats=["yaml"], folder="out")
    again = await call("import_files", path=exported["files"][0]["path"])
    assert again["items"][0]["artifact_id"] == made["config_id"]


REFUSED: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("configure_planner", {"weights": ["jerk=0.5", "lateral_jrk=1"]}, "lateral_jerk"),
    ("configure_planner", {"weights": ["jerk=-1"]}, "from 0 to"),
    ("configure_planner", {"planner": "idm", "weights": ["jerk=1"]}, "frenetix and fiss do"),
    ("configure_planner", {"settings": ["vehicle=9"]}, "vehicle from 1 to 4"),
    ("configure_planner", {"weights": ["horizon_s=4"]}, "pass it in settings"),
    ("configure_planner", {"preset": "fast"}, "Efficiency-Sporty"),
    ("configure_planner", {"base": "cfg_000000000000"}, "frenetix:Default"),
    ("list_planners", {"planner": "apollo"}, "frenetix"),
    ("run_planner", {"scenarios": ["ZAM_Bilder-1_1_T-1"]}, "ZAM_Builder-1_1_T-1"),
    ("run_planner", {"scenarios": ["ZAM_Builder-2_1_T-1#7"]}, "100, 200"),
    ("run_planner", {"scenarios": ["preset:many"]}, "preset:10"),
    ("run_planner", {"scenarios": ["preset:2"], "configs": ["frenetix:Fast"]}, "Efficiency-Sporty"),
)


async def test_a_refusal_names_the_valid_values_and_leaves_no_artifacts(call: Call) -> None:
    for tool, arguments, says in REFUSED:
        text = await call(tool, **arguments)
        assert isinstance(text, str), arguments
        assert says in text
    assert (await call("list_artifacts", kind="config"))["artifacts"] == []


async def test_runs_are_stored_once_and_grids_become_batches(call: Call) -> None:
    one = await call("run_planner", scenarios=["ZAM_Builder-1_1_T-1"])
    assert (one["finished"], one["reused"], one["batch_id"]) == (1, 0, None)
    run_id = one["runs"][0]["run_id"]
    assert one["runs"][0]["outcome"] == "goal_reached"
    scenarios = ["ZAM_Builder-1_1_T-1", "ZAM_Builder-2_1_T-1#200"]
    grid = await call("run_planner", scenarios=scenarios, configs=["frenetix", "frenetix:Safety"], wait_s=50)
    assert (grid["state"], grid["finished"], grid["reused"]) == ("done", 4, 1)
    assert run_id in [run["run_id"] for run in grid["runs"]]
    assert {run["problem_id"] for run in grid["runs"]} == {100, 200}
    assert [entry["config_name"] for entry in grid["summary"]] == ["frenetix:Default", "frenetix:Safety-Conservative"]
    again = await call("run_planner", scenarios=scenarios, configs=["frenetix", "frenetix:Safety"])
    assert again["batch_id"] == grid["batch_id"]
    assert again["reused"] == 4
    truth = await call("run_planner", scenarios=["ZAM_Builder-1_1_T-1"], prediction="ground_truth")
    assert truth["runs"][0]["run_id"] != run_id


async def test_a_job_continues_after_the_call(call: Call) -> None:
    started = await call("run_planner", scenarios=["preset:10"], wait_s=0)
    assert started["state"] == "running"
    assert "only 2 scenarios" in started["notes"][0]
    job = await call("get_job", job_id=started["job_id"], wait_s=50)
    assert job["state"] == "done"
    assert job["results"][-1].startswith("batch_")


async def test_the_first_run_against_the_second_after_an_edit_is_a_pair(call: Call) -> None:
    first = await call("run_planner", scenarios=["ZAM_Builder-1_1_T-1"])
    edited = await call(
        "modify_scenario", scenario_id="ZAM_Builder-1_1_T-1", edits=[{"op": "remove_vehicle", "vehicles": ["all"]}]
    )
    second = await call("run_planner", scenarios=[edited["scenario_id"]])
    compared = await call("compare_results")
    assert compared["notes"] == [
        "there is no batch, so the two newest runs are compared, the older one as the baseline"
    ]
    found = compared["comparisons"][0]
    assert found["edited"][0]["done"] == ["remove_vehicle all"]
    assert (found["edited"][0]["before"], found["edited"][0]["after"]) == ("ZAM_Builder-1_1_T-1", edited["scenario_id"])
    runs = [side["run_ids"][0] for side in compared["sides"]]
    assert runs == [first["runs"][0]["run_id"], second["runs"][0]["run_id"]]


async def test_a_finished_grid_is_reported_by_its_batch(call: Call) -> None:
    grid = await call("run_planner", scenarios=["ZAM_Builder-1_1_T-1"], configs=["frenetix", "idm"], wait_s=50)
    job = await call("get_job")
    assert job["next_step"] == f"analyze_results or compare_results with results ['{grid['batch_id']}']"
    assert job["results"][-1] == grid["batch_id"]


async def test_a_sample_of_the_catalogue_is_the_same_after_edits(call: Call) -> None:
    before = await call("run_planner", scenarios=["preset:2"], configs=["idm"], wait_s=50)
    for vehicles in (["all"], ["31"]):
        edits = [{"op": "remove_vehicle", "vehicles": vehicles}]
        await call("modify_scenario", scenario_id="ZAM_Builder-1_1_T-1", edits=edits)
    after = await call("run_planner", scenarios=["preset:2"], configs=["idm"], wait_s=50)
    assert (after["batch_id"], after["reused"]) == (before["batch_id"], 2)
    larger = await call("run_planner", scenarios=["preset:10"], configs=["idm"], wait_s=50)
    assert larger["batch_id"] == before["batch_id"]
    assert "left out" in larger["notes"][0]


async def test_the_study_of_a_job_is_found_although_the_sample_has_changed(call: Call, tmp_path: Path) -> None:
    wish = {"base": "idm", "vary": ["time_headway_s"], "max_trials": 2}
    started = await call("optimize_planner", scenarios=["preset:10"], **wish, wait_s=0)
    job = await call("get_job", job_id=started["job_id"], wait_s=50)
    assert job["state"] == "done"
    (tmp_path / "more").mkdir()
    replace(town_road(), benchmark_id="ZAM_Builder-3_1_T-1").write(tmp_path / "more" / "three.xml")
    assert (await call("import_files", path=str(tmp_path / "more")))["added"] == 1
    named = f"scenarios ['{started['job_id']}']"
    assert named in started["next_step"]
    assert named in job["next_step"]
    study = await call("optimize_planner", scenarios=[started["job_id"]], **wish, wait_s=0)
    assert (study["state"], study["study"]["study_id"]) == ("done", job["results"][-1])
    again = await call("optimize_planner", scenarios=["preset:10"], **wish, wait_s=50)
    assert again["study"]["study_id"] != study["study"]["study_id"]
