"""The workspace in which refusals are drawn: scenarios of a folder and generated ones, runs and batches."""

import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcp import Client

from ..written_tracks import WrittenFile

_PLACES = ("Musterstadt", "Fahrhausen", "Kreiselheim", "Neuland", "Quadratstadt", "Landmoor")
"""Names of the maps that come with the package."""


@dataclass(frozen=True)
class Stage:
    """A scenario by its id, and the content of its file."""

    scenario_id: str
    file: WrittenFile

    @property
    def last_time_s(self) -> float:
        """When its last state is."""
        return max((user.last for user in self.file.users.values()), default=0) * self.file.step_s

    @property
    def ego_ids(self) -> set[str]:
        """Ids of the planning problems, by which people name an ego."""
        return {key for key, element in self.file.elements.items() if element.startswith(b"<planningProblem")}

    def driving(self) -> list[int]:
        """Return ids of the vehicles that are recorded."""
        people = ("pedestrian", "bicycle")
        return [key for key, user in self.file.users.items() if not user.is_static and user.kind not in people]


@dataclass
class World:
    """The content of a workspace; ``folder``: for files to read and write."""

    folder: Path
    stages: list[Stage] = field(default_factory=list)
    runs: list[str] = field(default_factory=list)
    batches: list[str] = field(default_factory=list)
    configs: list[str] = field(default_factory=list)
    searches: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    places: tuple[str, ...] = _PLACES

    def stage(self, rng: random.Random) -> Stage:
        """Return one of the scenarios."""
        return rng.choice(self.stages)


async def make_world(client: Client, folder: Path, files: list[Path], seed: int) -> World:
    """Import files, generate and modify a scenario, and run planners, so that refusals of all tools can be drawn."""
    world = World(folder)
    for path in files:
        copied = folder / path.name
        copied.write_bytes(path.read_bytes())
        answer = await _answer(client, "import_files", path=str(copied))
        items = answer.get("items", [])
        if not items:
            continue
        world.files.append(copied)
        world.stages.append(Stage(items[0]["artifact_id"], WrittenFile.read(copied)))
    rng = random.Random(seed)  # noqa: S311 - a draw, no secret
    for place in rng.sample(_PLACES, 2):
        answer = await _answer(client, "generate_scenarios", place=place, duration_s=8, seed=seed)
        made = [one["scenario_id"] for one in answer.get("scenarios", [])]
        await _take(client, world, made)
    for stage in world.stages[:2]:
        edits = [{"op": "remove_vehicle", "vehicles": ["nearest:1"]}]
        answer = await _answer(client, "modify_scenario", scenario_id=stage.scenario_id, edits=edits)
        await _take(client, world, [answer["scenario_id"]] if answer.get("scenario_id") else [])
    runnable = [stage.scenario_id for stage in world.stages if stage.file.ego is not None][:3]
    for scenario_id in runnable[:2]:
        answer = await _answer(client, "run_planner", scenarios=[scenario_id], configs=["idm"])
        world.runs += [one["run_id"] for one in answer.get("runs", [])]
    answer = await _answer(client, "run_planner", scenarios=runnable, configs=["idm", "keep_lane"])
    world.batches += [answer["batch_id"]] if answer.get("batch_id") else []
    answer = await _answer(client, "configure_planner", weights=["jerk=0.4"])
    world.configs.append(str(answer["config_id"]))
    answer = await _answer(client, "find_scenarios", obstacles=["car>=1"])
    world.searches.append(str(answer["search_id"]))
    return world


async def _take(client: Client, world: World, made: list[str]) -> None:
    for scenario_id in made:
        folder = world.folder / f"files-{scenario_id}"
        await _answer(client, "export_artifacts", ids=[scenario_id], folder=str(folder), formats=["xml"])
        written = next(iter(sorted(folder.rglob("*.xml"))), None)
        if written is not None:
            world.stages.append(Stage(scenario_id, WrittenFile.read(written)))


async def _answer(client: Client, tool: str, **arguments: Any) -> Mapping[str, Any]:
    result = await client.call_tool(tool, arguments)
    return {} if result.is_error else (result.structured_content or {})
