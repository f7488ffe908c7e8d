"""The stages of the demo, one function each; every one asks the server and reads the answer."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plannerforge.agent.demo_edits import one_edit_of_each_kind
from plannerforge.agent.demo_session import DemoSession

BASE_CONFIG, OTHER_PRESET = "frenetix:Default", "Safety-Conservative"
MOST_WAITS = 20


@dataclass(frozen=True)
class Results:
    """What the runs gave: batch, single runs, and the one worth an animation."""

    batch_id: str
    shown_run: str


async def begin(session: DemoSession, scenario: Path | None, map_file: Path | None) -> str:
    """Get a scenario: from the given file, from the given map, or from a built-in map. Gives its id."""
    if scenario is not None:
        session.console.stage("Import", f"Take in the CommonRoad file {scenario.name}.")
        step = await session.must("import_files", {"path": str(scenario.resolve())})
        return str(step.structured["items"][0]["artifact_id"])
    wanted: dict[str, Any] = {"scenario_type": "signalised_intersection", "density": "medium"}
    sentence = "Cut a signalised crossing out of a built-in map and fill it with traffic, two trucks among it."
    if map_file is not None:
        session.console.stage("Import", f"Take in the OpenStreetMap extract {map_file.name}.")
        step = await session.must("import_files", {"path": str(map_file.resolve())})
        wanted = {"place": step.structured["items"][0]["artifact_id"], "density": "medium"}
        sentence = "Find a site on that map and fill it with traffic, two trucks among it."
    session.console.stage("Generate", sentence)
    step = await session.must("generate_scenarios", {**wanted, "vehicles": ["truck=2"], "seed": 7})
    return str(step.structured["scenarios"][0]["scenario_id"])


async def choose(session: DemoSession) -> None:
    """Search the catalogue, by facts and by text."""
    session.console.stage(
        "Select", "Search the catalogue: at least one truck, best match first for a text (loads the embedding model)."
    )
    await session.ask("describe_catalog", {})
    await session.ask(
        "find_scenarios", {"obstacles": ["truck>=1"], "text": "busy crossing with traffic lights", "limit": 3}
    )


async def describe(session: DemoSession, scenario_id: str) -> dict[str, Any]:
    """Look at a scenario and give what was said about it."""
    session.console.stage("Describe", "What is in the scenario, in words and in ids that an edit can use?")
    step = await session.must("describe_scenario", {"scenario_id": scenario_id, "detail": "vehicles"})
    return step.structured


async def modify(session: DemoSession, described: dict[str, Any]) -> str | None:
    """Make one edit of each kind (trajectory, behaviour, population, goal); gives the new scenario's id."""
    session.console.stage(
        "Modify", "One edit of each kind: a new route, an aggressive driver, an added vehicle, another goal."
    )
    edits = await one_edit_of_each_kind(session, described)
    if not edits:
        session.console.says("No edit is possible here; the runs go on with the scenario as it is.")
        return None
    step = await session.ask("modify_scenario", {"scenario_id": described["scenario_id"], "edits": edits})
    return None if step.refused else str(step.structured["scenario_id"])


async def configure_and_run(session: DemoSession, scenarios: list[str]) -> Results:
    """Run two configurations on every scenario."""
    session.console.stage(
        "Run", f"Frenetix's default against its {OTHER_PRESET} preset, on {len(scenarios)} scenarios."
    )
    made = await session.must("configure_planner", {"preset": OTHER_PRESET})
    grid = {"scenarios": scenarios, "configs": [BASE_CONFIG, made.structured["config_id"]], "wait_s": 20}
    step = await session.must("run_planner", grid)
    for _ in range(MOST_WAITS):
        if step.structured["state"] != "running":
            break
        await session.ask("get_job", {"job_id": step.structured["job_id"], "wait_s": 20})
        step = await session.must("run_planner", {**grid, "wait_s": 0})
    runs = step.structured["runs"]
    failed = [run["run_id"] for run in runs if run["outcome"] not in ("goal_reached", "invalid")]
    return Results(str(step.structured["batch_id"]), str((failed or [run["run_id"] for run in runs])[0]))


async def compare(session: DemoSession, results: Results) -> None:
    """Ask what got better, and what the figures say."""
    session.console.stage("Compare and analyse", "What got better, what got worse, and what is the evidence?")
    await session.ask("compare_results", {"results": [results.batch_id]})
    await session.ask("analyze_results", {"results": [results.batch_id], "detail": "findings"})
    await session.ask("analyze_results", {"results": [results.shown_run], "detail": "timeline"})


async def draw_and_export(
    session: DemoSession, folder: Path, scenario_id: str, modified_id: str | None, results: Results
) -> None:
    """Draw the scenarios and a run, and write everything into the user's folder."""
    session.console.stage("Draw and report", f"Pictures, an animation, and a report, written to {folder}.")
    scenarios = [scenario_id, *([modified_id] if modified_id else [])]
    await session.ask("render", {"ids": scenarios})
    await session.ask("render", {"ids": [results.shown_run], "kind": "animation"})
    files = {"ids": scenarios, "formats": ["xml", "recipe", "png"], "folder": str(folder)}
    await session.ask("export_artifacts", files)
    await session.ask("export_artifacts", {"ids": [results.shown_run], "formats": ["gif"], "folder": str(folder)})
    await session.must(
        "export_artifacts", {"ids": [*scenarios, results.batch_id], "formats": ["html"], "folder": str(folder)}
    )
