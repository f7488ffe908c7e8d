"""The calls of every tool in the contract tests, and the workspace for them.

The tools themselves fill the workspace. A tool's case has one good call, and bad ones with the required content of the
refusal. Words in angle brackets are ids of the prepared workspace.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings


@dataclass(frozen=True)
class Prepared:
    """Settings of a filled workspace, and its ids."""

    settings: Settings
    folder: Path
    scenario_id: str
    config_id: str
    batch_id: str
    run_ids: tuple[str, ...]
    search_id: str


def prepare(folder: Path) -> Prepared:
    """Fill a workspace below a folder."""
    settings = Settings(workspace=folder / "workspace", roots=(folder,), workers=1, warm_up=False)
    with ThreadPoolExecutor(1) as thread:  # where another library has marked this one as the event loop's
        return thread.submit(anyio.run, _prepare, settings, folder).result()


async def _prepare(settings: Settings, folder: Path) -> Prepared:
    async with Client(create_server(settings, start_folder=folder)) as client:

        async def made(tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
            result = await client.call_tool(tool, arguments)
            assert not result.is_error, result.content[0].text  # type: ignore[union-attr]
            assert result.structured_content is not None
            return result.structured_content

        search = await made("find_scenarios", {"obstacles": ["car=1..6"], "limit": 1})  # a small one
        scenario_id = search["matches"][0]["scenario_id"]
        config = await made("configure_planner", {"preset": "Safety-Conservative", "weights": ["jerk=0.3"]})
        grid = {"scenarios": [scenario_id], "configs": ["frenetix:Default", config["config_id"]], "wait_s": 50}
        runs = await made("run_planner", grid)
        exported = {"ids": [scenario_id], "formats": ["xml"], "folder": str(folder)}
        await made("export_artifacts", exported)
        content = (folder / f"{scenario_id}.xml").read_text(encoding="utf-8")
        own_id = scenario_id.replace("_T-1", "_T-77")
        (folder / "own.xml").write_text(content.replace(scenario_id, own_id), encoding="utf-8")
        (folder / "hostile.xml").write_text('<!DOCTYPE a [<!ENTITY b "c">]><commonRoad/>', encoding="utf-8")
        return Prepared(
            settings=settings,
            folder=folder,
            scenario_id=scenario_id,
            config_id=config["config_id"],
            batch_id=runs["batch_id"],
            run_ids=tuple(run["run_id"] for run in runs["runs"]),
            search_id=search["search_id"],
        )


def filled(value: Any, prepared: Prepared) -> Any:
    """Return the arguments of a case with the ids of the prepared workspace."""
    if isinstance(value, dict):
        return {key: filled(part, prepared) for key, part in value.items()}
    if isinstance(value, list):
        return [filled(part, prepared) for part in value]
    if isinstance(value, str):
        for word, meaning in _meanings(prepared).items():
            value = value.replace(word, meaning)
    return value


def _meanings(prepared: Prepared) -> dict[str, str]:
    return {
        "<scenario>": prepared.scenario_id,
        "<config>": prepared.config_id,
        "<batch>": prepared.batch_id,
        "<run>": prepared.run_ids[0],
        "<search>": prepared.search_id,
        "<folder>": str(prepared.folder),
        "<file>": str(prepared.folder / "own.xml"),
        "<hostile>": str(prepared.folder / "hostile.xml"),
    }


@dataclass(frozen=True)
class Bad:
    """A call that must be refused; ``names`` is the required content of the refusal."""

    arguments: dict[str, Any]
    names: tuple[str, ...]


@dataclass(frozen=True)
class Case:
    """The calls of one tool."""

    good: dict[str, Any]
    bad: tuple[Bad, ...]
    files: dict[str, str] = field(default_factory=dict)


CASES: dict[str, Case] = {
    "describe_catalog": Case(
        {},
        (
            Bad({"facet": "tag"}, ("facet", "'tag'", "tags")),
            Bad({"within": "search_0000"}, ("search_0000", "<search>")),
            Bad({"facets": "tags"}, ("facets", "facet")),
        ),
    ),
    "generate_scenarios": Case(
        {"scenario_type": "roundabout", "duration_s": 6, "vehicles": ["truck"], "goal": "steps:20", "seed": 1},
        (
            Bad({"place": "Atlantis"}, ("Atlantis", "Musterstadt")),
            Bad({"scenario_type": "roundabaut"}, ("roundabaut", "roundabout")),
            Bad({"vehicles": ["tank=2"]}, ("tank", "truck")),
            Bad({"duration_s": 1e9}, ("duration_s", "120")),
            Bad({"vehicles": ["car=10000"]}, ("10,000", "300")),
            Bad({"bbox": [1, 2, 3]}, ("bbox",)),
            Bad({"ego": "third"}, ("third", "index:")),
            Bad({"road_classes": ["motorways"]}, ("motorways",)),
        ),
    ),
    "find_scenarios": Case(
        {"obstacles": ["truck>=1"], "text": "busy crossing"},
        (
            Bad({"tags": ["roundabuot"]}, ("roundabuot", "roundabout")),
            Bad({"obstacles": ["tank>=1"]}, ("tank", "truck")),
            Bad({"road_net": ["stopp"]}, ("stopp", "stop")),
            Bad({"ego_speed": "fast"}, ("fast", "km/h")),
            Bad({"limit": 0}, ("limit", "from 1")),
            Bad({"like": "<scenario>x"}, ("<scenario>",)),
        ),
    ),
    "import_files": Case(
        {"path": "<file>"},
        (
            Bad({}, ("path", "missing")),
            Bad({"path": "/etc/passwd"}, ("/etc/passwd", "PLANNERFORGE_ROOTS")),
            Bad({"path": "nothing.xml"}, ("nothing.xml", "does not exist")),
            Bad({"path": "<hostile>"}, ("document type",)),
        ),
    ),
    "describe_scenario": Case(
        {"scenario_id": "<scenario>", "detail": "lanelets"},
        (
            Bad({"scenario_id": "<scenario>x"}, ("<scenario>",)),
            Bad({"detail": "everything"}, ("everything", "vehicles")),
            Bad({"scenario_id": "<scenario>", "focus": "nearest:many"}, ("nearest:many",)),
            Bad({"radius_m": -1}, ("radius_m",)),
        ),
    ),
    "modify_scenario": Case(
        {
            "scenario_id": "<scenario>",
            "edits": [{"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": "aggressive"}],
        },
        (
            Bad({"scenario_id": "<scenario>", "edits": []}, ("edits",)),
            Bad({"scenario_id": "<scenario>", "edits": [{"op": "teleport"}]}, ("teleport", "reroute")),
            Bad(
                {
                    "scenario_id": "<scenario>",
                    "edits": [{"op": "set_behaviour", "vehicles": ["all"], "preset": "wild"}],
                },
                ("wild", "aggressive"),
            ),
            Bad(
                {"scenario_id": "<scenario>", "edits": [{"op": "remove_vehicle", "vehicles": ["999999"]}]}, ("999999",)
            ),
            Bad(
                {"scenario_id": "<scenario>", "edits": [{"op": "remove_vehicle", "vehicles": ["all"], "turn": "left"}]},
                ("turn", "vehicles"),
            ),
            Bad({"scenario_id": "<scenario>", "edits": [{"op": "set_goal", "to": ["999999"]}]}, ("999999",)),
        ),
    ),
    "list_planners": Case(
        {},
        (
            Bad({"planner": "frenetics"}, ("frenetics", "frenetix")),
            Bad({"config_id": "cfg_000000000000"}, ("cfg_000000000000", "<config>")),
            Bad({"presets": True}, ("presets",)),
        ),
    ),
    "configure_planner": Case(
        {"preset": "Comfort", "weights": ["jerk*2"]},
        (
            Bad({"preset": "Comfy"}, ("Comfy", "Comfort")),
            Bad({"weights": ["jerks=1"]}, ("jerks", "jerk")),
            Bad({"weights": ["jerk=-1"]}, ("jerk", "-1")),
            Bad({"weights": ["jerk=nan"]}, ("nan",)),
            Bad({"planner": "idm", "weights": ["jerk=1"]}, ("jerk", "frenetix")),
            Bad({"settings": ["horizon_s=60"]}, ("horizon_s", "1.5 to 6")),
            Bad({"settings": ["lenght_m=5"]}, ("lenght_m", "length_m")),
            Bad({"base": "cfg_000000000000"}, ("cfg_000000000000",)),
        ),
    ),
    "run_planner": Case(
        {"scenarios": ["<scenario>"], "configs": ["frenetix:Comfort"]},
        (
            Bad({"scenarios": ["<scenario>x"]}, ("<scenario>",)),
            Bad({"scenarios": ["<scenario>"], "configs": ["frenetix:Sportive"]}, ("Sportive", "Sporty")),
            Bad({"scenarios": ["<scenario>"], "prediction": "oracle"}, ("oracle", "ground_truth")),
            Bad({"scenarios": ["<scenario>#77"]}, ("77",)),
            Bad({"scenarios": ["<scenario>"], "wait_s": 600}, ("wait_s", "50")),
        ),
    ),
    "get_job": Case(
        {"wait_s": 0},
        (
            Bad({"job_id": "job_000000000000"}, ("job_000000000000", "job_")),
            Bad({"wait_s": 51}, ("wait_s", "50")),
            Bad({"jbo_id": "latest"}, ("'jbo_id'", "job_id")),
        ),
    ),
    "cancel_job": Case(
        {"job_id": "latest"},
        (
            Bad({}, ("job_id", "missing")),
            Bad({"job_id": "job_000000000000"}, ("job_000000000000", "job_")),
            Bad({"job_id": "latest", "force": True}, ("force",)),
        ),
    ),
    "analyze_results": Case(
        {"results": ["<batch>"], "detail": "findings"},
        (
            Bad({"results": ["batch_000000000000"]}, ("batch_000000000000",)),
            Bad({"results": ["<scenario>"]}, ("<scenario>", "run")),
            Bad({"results": ["<batch>"], "where": ["outcom=collision"]}, ("outcom", "outcome")),
            Bad({"results": ["<batch>"], "detail": "all"}, ("'all'", "findings")),
        ),
    ),
    "find_failures": Case(
        {"scenario_id": "<scenario>", "config": "idm", "runs": 2},
        (
            Bad({"scenario_id": "<scenario>x"}, ("<scenario>",)),
            Bad({"scenario_id": "<scenario>", "config": "idn"}, ("idn", "idm")),
            Bad({"scenario_id": "<scenario>", "runs": 0}, ("runs", "from 1")),
            Bad({"scenario_id": "<scenario>", "horizon_s": 600}, ("horizon_s", "30")),
            Bad({"scenario_id": "<scenario>", "world": "lidarr"}, ("lidarr", "lidar")),
        ),
    ),
    "optimize_planner": Case(
        {"scenarios": ["preset:4"], "base": "idm", "vary": ["time_headway_s"], "max_trials": 2},
        (
            Bad({"objective": ["sucess"]}, ("sucess", "success")),
            Bad({"constraints": ["success>=best"]}, ("success>=best", "success>=base")),
            Bad({"base": "frenetix", "vary": ["prediktion"]}, ("prediktion", "prediction")),
            Bad({"base": "frenetix", "vary": ["horizon_s=1..9"]}, ("horizon_s", "1.5..6")),
            Bad({"scenarios": ["<scenario>"]}, ("one map", "preset:100")),
            Bad({"pareto": True, "method": "cmaes", "objective": ["success", "time"]}, ("method=tpe", "pareto=false")),
        ),
    ),
    "explore_boundary": Case(
        {"scenario": "cut_in", "configs": ["keep_lane"], "points": 30, "references": False},
        (
            Bad({"scenario": "cut_inn"}, ("cut_inn", "cut_in")),
            Bad({"scenario": "nhtsa:8"}, ("backing up", "nhtsa:3")),
            Bad({"scenario": "cut_in", "over": ["gap=1..2"]}, ("'gap'", "gap_m")),
            Bad({"scenario": "cut_in", "over": ["gap_m=9..3"]}, ("gap_m",)),
            Bad(
                {"scenario": "cut_in", "over": ["gap_m=5", "closing_mps=2", "lateral_mps=1"]},
                ("two parameters", "gap_m=4..60"),
            ),
            Bad({"configs": ["frenetiks"]}, ("frenetiks", "frenetix")),
            Bad({"base": "DEU_Nowhere-1_1_T-1"}, ("DEU_Nowhere-1_1_T-1",)),
        ),
    ),
    "compare_results": Case(
        {"results": ["<batch>"]},
        (
            Bad({"results": ["<run>"]}, ("compared",)),
            Bad({"results": ["<batch>"], "metrics": ["speed"]}, ("speed", "mean_speed_mps")),
            Bad({"results": ["run_000000000000", "<run>"]}, ("run_000000000000",)),
        ),
    ),
    "render": Case(
        {"ids": ["<scenario>"]},
        (
            Bad({"ids": ["<scenario>x"]}, ("<scenario>",)),
            Bad({"ids": ["<config>"]}, ("<config>", "scenario")),
            Bad({"ids": ["<scenario>"], "kind": "photo"}, ("photo", "picture")),
            Bad({"ids": ["<scenario>"], "time_s": 1e6}, ("time_s", "ends at")),
            Bad({"ids": ["<scenario>"], "kind": "outcomes"}, ("run",)),
        ),
    ),
    "list_artifacts": Case(
        {"kind": "scenario"},
        (
            Bad({"kind": "scenarios"}, ("'scenarios'", "scenario")),
            Bad({"limit": 1000}, ("limit", "50")),
            Bad({"offset": -1}, ("offset",)),
        ),
    ),
    "export_artifacts": Case(
        {"ids": ["<scenario>", "<batch>"], "folder": "<folder>/exported", "overwrite": True},
        (
            Bad({"ids": ["<scenario>"], "folder": "/etc"}, ("/etc", "plannerforge-export")),
            Bad({"ids": ["<scenario>x"], "folder": "<folder>/no"}, ("<scenario>",)),
            Bad({"ids": ["<scenario>"], "folder": "<folder>/no", "formats": ["yaml"]}, ("yaml", "xml")),
            Bad({"ids": [], "folder": "<folder>/no"}, ("ids",)),
            Bad({"ids": ["<scenario>"], "folder": "<folder>/../../../etc"}, ("plannerforge-export",)),
        ),
    ),
}


def hold_page(page: Path, mark: str, sections: list[str], *, update: bool) -> None:
    """Compare the text below a page's mark with the new recording, or write it there."""
    head, found, _ = page.read_text(encoding="utf-8").partition(mark)
    assert found
    recorded = head + mark + "\n" + "\n".join(sections)
    if update:
        page.write_text(recorded, encoding="utf-8")
    assert recorded == page.read_text(encoding="utf-8"), "run pytest tests/contract --update-snapshots and look"
