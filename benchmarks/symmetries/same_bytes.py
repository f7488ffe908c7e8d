"""``make bench-same-bytes``: digests of the results of a fixed list of requests, for comparison with a changed program.

``record FILE`` requests scenarios from maps, edits of each kind, planner runs and descriptions through an MCP client,
and writes a digest of every file and every answer. ``compare BEFORE AFTER`` lists the differences. It only calls tools,
so the same list runs on any version of the program. With make: ``make bench-same-bytes RECORD=before.json``, then,
after the change, ``make bench-same-bytes RECORD=after.json BEFORE=before.json``.
"""

import argparse
import hashlib
import json
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
from mcp import Client
from mcp.types import CallToolResult

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.server.tool_calls import answer_text

from ..harness import shared_folder

_WRITTEN_AT = re.compile(r"\b\d{4}-\d\d-\d\dT[\d:.+Z-]+")
_UNSTEADY = ("_ms", "elapsed_s", "wall_s", "computing_s", "created", "run_time_s", "planning_s")
"""Endings of fields with a duration or time of this execution."""
_TIMING = "timing.json"
"""The durations of a run, which differ between executions."""
_Arguments = dict[str, Any]


@dataclass
class _Digests:
    """The results: a digest per file (below the workspace), and the text of every answer by its request."""

    workspace: Path
    answers: dict[str, str] = field(default_factory=dict)

    def note(self, name: str, result: CallToolResult) -> None:
        """Keep an answer or a refusal: its text, and its structure if it has one."""
        structure = "" if result.structured_content is None else json.dumps(_steady(result.structured_content))
        self.answers[name] = self._plain(f"{answer_text(result)}\n{structure}")

    def files(self) -> dict[str, str]:
        """Return a digest of each file of each artifact, with JSON stripped of its durations."""
        kept = (self.workspace / kind for kind in ("scenarios", "runs", "configs", "batches", "maps"))
        files = sorted(path for folder in kept for path in folder.rglob("*") if path.is_file())
        return {str(path.relative_to(self.workspace)): self._digest(path) for path in files if path.name != _TIMING}

    def _digest(self, path: Path) -> str:
        content = path.read_bytes()
        if path.suffix == ".json":
            content = json.dumps(_steady(json.loads(content))).encode()
        return hashlib.sha256(content).hexdigest()

    def _plain(self, text: str) -> str:
        return _WRITTEN_AT.sub("WHEN", text.replace(str(self.workspace), "WORKSPACE"))


def _steady(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _steady(item) for key, item in value.items() if not str(key).endswith(_UNSTEADY)}
    return [_steady(item) for item in value] if isinstance(value, list) else value


def _edits_of(description: dict[str, Any]) -> Iterator[tuple[str, list[_Arguments]]]:
    """Return one attempt of each kind of edit for a described scenario, by its content; a refusal is also an answer."""
    ids = [str(vehicle["vehicle_id"]) for vehicle in description["vehicles"]]
    goal = (description["ego"] or {}).get("goal_lanelets") or []
    near, other, *_ = [*ids, "999998", "999999"]
    yield "reroute-left", [{"op": "reroute", "vehicles": [near], "turn": "left"}]
    yield "reroute-right", [{"op": "reroute", "vehicles": [other], "turn": "right"}]
    yield "change_lane", [{"op": "change_lane", "vehicles": ["nearest:2"], "lane": "left"}]
    yield "set_speed", [{"op": "set_speed", "vehicles": [near], "speed": "5m/s", "time_s": 1}]
    yield "shift_time", [{"op": "shift_time", "vehicles": [near], "time_s": 1.0}]
    yield "set_behaviour", [{"op": "set_behaviour", "vehicles": ["all"], "preset": "aggressive"}]
    yield "add_truck", [{"op": "add_vehicle", "vehicle_class": "truck", "at": "ego", "offset_m": 25}]
    two = {"op": "add_vehicle", "vehicle_class": "car", "count": 2}
    yield "add_cars", [{**two, "at": f"vehicle:{near}", "offset_m": -15}]
    yield "add_pedestrian", [{"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "ego", "offset_m": 30}]
    yield "remove", [{"op": "remove_vehicle", "vehicles": ["nearest:2"]}]
    if goal:
        yield "set_goal", [{"op": "set_goal", "to": [str(goal[0])], "position": "middle"}]
    yield "set_ego", [{"op": "set_ego", "vehicles": [near], "former_ego": "traffic"}]
    yield (
        "composite",
        [
            {"op": "set_behaviour", "vehicles": ["nearest:3"], "preset": "cautious", "params": ["tau=1.5"]},
            {"op": "remove_vehicle", "vehicles": ["farthest"]},
            {"op": "set_speed", "vehicles": ["lead"], "speed": "20km/h"},
        ],
    )


async def _record_scenario(client: Client, digests: _Digests, path: Path) -> None:
    name = path.stem
    digests.note(f"{name} import", await client.call_tool("import_files", {"path": str(path)}))
    for detail in ("brief", "vehicles", "lanelets", "checks"):
        result = await client.call_tool("describe_scenario", {"scenario_id": name, "detail": detail})
        digests.note(f"{name} describe {detail}", result)
        if detail == "brief":
            description = (result.structured_content or {}).get("description")
    if description is None:
        return
    for kind, edits in _edits_of(description):
        for traffic in ("recorded", "reactive") if kind == "composite" else ("recorded",):
            arguments: _Arguments = {"scenario_id": name, "edits": edits, "traffic": traffic}
            digests.note(f"{name} edit {kind} {traffic}", await client.call_tool("modify_scenario", arguments))
    for planner, traffic, prediction in (
        ("frenetix:Default", "recorded", "constant_velocity"),
        ("frenetix:Safety", "reactive", "lane"),
        ("idm", "recorded", "ground_truth"),
    ):
        arguments = {"scenarios": [name], "configs": [planner], "traffic": traffic, "prediction": prediction}
        result = await client.call_tool("run_planner", arguments)
        digests.note(f"{name} run {planner} {traffic}", result)


async def _record_map(client: Client, digests: _Digests, path: Path) -> None:
    result = await client.call_tool("import_files", {"path": str(path)})
    digests.note(f"map {path.name} import", result)
    map_id = re.search(r"map_[0-9a-z]+", json.dumps(result.structured_content))
    if map_id is None:
        return
    for density, vehicles in (("low", ["truck=1"]), ("medium", ["bicycle=1", "bus=1"])):
        asked = {"place": map_id[0], "density": density, "vehicles": vehicles, "count": 2, "seed": 3}
        arguments = {**asked, "goal": "steps:50"}  # the default of earlier versions
        digests.note(f"map {path.name} {density}", await client.call_tool("generate_scenarios", arguments))


async def _record_results(client: Client, digests: _Digests) -> None:
    for name, tool, arguments in (
        ("find", "find_scenarios", {"road_net": ["lanes>=2"], "obstacles": ["car>=2"], "limit": 20}),
        ("find text", "find_scenarios", {"text": "roundabout with a truck", "limit": 20}),
        ("catalog", "describe_catalog", {}),
        ("batch", "run_planner", {"scenarios": ["preset:6"], "configs": ["frenetix:Default", "frenetix:Sporty"]}),
        ("analyse", "analyze_results", {"results": ["latest"]}),
        ("compare", "compare_results", {"results": ["latest"]}),
    ):
        digests.note(f"results {name}", await client.call_tool(tool, arguments))


async def _record(data: Path, output: Path, every: int, maps: int) -> None:
    """Ask for everything and write the digests: every n-th scenario by name, and the smallest maps."""
    scenarios = sorted((data / "commonroad").glob("*.xml"))[::every]
    extracts = sorted((data / "osm").glob("*.osm"), key=lambda path: path.stat().st_size)[:maps]
    workspace = Path(tempfile.gettempdir()) / f"same-bytes-{os.getpid()}"
    settings = Settings(workspace=workspace, roots=(data,), warm_up=False, maps_online="offline", journal=False)
    digests = _Digests(workspace)
    async with Client(create_server(settings)) as client:
        for number, path in enumerate(scenarios):
            sys.stderr.write(f"{number + 1} of {len(scenarios)}: {path.stem}\n")
            await _record_scenario(client, digests, path)
        for path in extracts:
            sys.stderr.write(f"map {path.name}\n")
            await _record_map(client, digests, path)
        await _record_results(client, digests)
    output.write_text(json.dumps({"answers": digests.answers, "files": digests.files()}, indent=1), encoding="utf-8")


def _compare(before: Path, after: Path, *, subset: bool) -> int:
    """Print the differences and return their number. ``subset``: the later record made fewer requests."""
    old, new = (json.loads(path.read_text(encoding="utf-8")) for path in (before, after))
    differences = 0
    for part in ("files", "answers"):
        names = sorted({*old[part]} & {*new[part]} if subset else {*old[part], *new[part]})
        names = [name for name in names if not (subset and name.startswith("results "))]
        changed = [name for name in names if old[part].get(name) != new[part].get(name)]
        sys.stdout.write(f"{part}: {len(names) - len(changed)} of {len(names)} the same\n")
        for name in changed:
            sys.stdout.write(f"  {name}\n")
        differences += len(changed)
    return differences


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("output", type=Path)
    recording.add_argument("--data", type=Path, default=shared_folder() / "data")
    recording.add_argument("--every", type=int, default=4, help="4 takes 49 of the 195 shared scenarios")
    recording.add_argument("--maps", type=int, default=24)
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--subset", action="store_true")
    given = parser.parse_args()
    if given.command == "record":
        anyio.run(_record, given.data, given.output, given.every, given.maps)
    else:
        sys.exit(min(_compare(given.before, given.after, subset=given.subset), 1))
