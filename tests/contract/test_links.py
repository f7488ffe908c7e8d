"""Each tool's answer links what its call made, with type, title and size, and each link can be read."""

from typing import Any

import pytest
from mcp import Client
from mcp.types import ResourceLink, TextResourceContents
from support.contract import Prepared, filled

from plannerforge.engine.workspace import Artifact, Workspace
from plannerforge.server.assembly import create_server
from plannerforge.server.tool_calls import MOST_LINKS
from plannerforge.tools.registry import TOOLS

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("warm_workers")]
QUICK = {"scenarios": ["<scenario>"], "seed": 7}
"""A planner that is asked for it runs anew with each seed."""
MAKING: tuple[tuple[str, dict[str, Any]], ...] = (
    ("generate_scenarios", {"duration_s": 5, "goal": "steps:20", "seed": 4141}),
    ("find_scenarios", {"obstacles": ["bus=0"], "limit": 1}),
    ("import_files", {"path": "linked.xml"}),
    ("import_files", {"path": "linked.yaml"}),
    (
        "modify_scenario",
        {
            "scenario_id": "<scenario>",
            "edits": [{"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": "cautious"}],
        },
    ),
    ("configure_planner", {"preset": "Comfort", "weights": ["jerk=0.61"]}),
    ("run_planner", {**QUICK, "configs": ["idm"]}),
    ("run_planner", {**QUICK, "configs": ["idm", "idm:Sporty"], "prediction": "ground_truth"}),
    (
        "find_failures",
        {"scenario_id": "<scenario>", "config": "keep_lane", "runs": 16, "until_first": True, "wait_s": 50},
    ),
    (
        "optimize_planner",
        {
            "scenarios": ["preset:4"],
            "base": "idm",
            "vary": ["time_headway_s"],
            "max_trials": 2,
            "seed": 5,
            "wait_s": 50,
        },
    ),
    (
        "explore_boundary",
        {"scenario": "cut_in", "configs": ["keep_lane"], "points": 30, "references": False, "seed": 5, "wait_s": 50},
    ),
)
MAKES_NOTHING_TO_LINK = {"cancel_job", "export_artifacts"}
"""The one stops what is being made, the other copies what is there."""


def test_every_tool_that_makes_something_is_called() -> None:
    called = {tool for tool, _ in MAKING}
    assert called | MAKES_NOTHING_TO_LINK == {spec.name for spec in TOOLS if not spec.read_only}


@pytest.mark.parametrize(("tool", "arguments"), MAKING, ids=[f"{i}-{case[0]}" for i, case in enumerate(MAKING)])
async def test_each_new_artifact_of_a_call_is_linked_and_readable(
    tool: str, arguments: dict[str, Any], prepared: Prepared
) -> None:
    """Itself, by the record of what is linked (the runs of a batch, the configurations of a study, by which its runs
    are listed), or as what the linked one was made from (the base of a configuration).
    """
    write_files(prepared)
    before = stored(prepared)
    async with Client(create_server(prepared.settings, prepared.folder)) as client:
        answer = await client.call_tool(tool, filled(arguments, prepared))
        assert not answer.is_error, answer.content
        links = [block for block in answer.content if isinstance(block, ResourceLink)]
        told = " ".join([await content(client, link) for link in links])
    made = {key: one for key, one in stored(prepared).items() if key not in before}
    linked = {link.name for link in links}
    sources = {parent for key, one in made.items() if key in linked for parent in one.recipe.parents}
    by_study = any(one.kind == "study" for one in made.values())
    left = {
        key
        for key, one in made.items()
        if key not in linked | sources
        and key not in told
        and not (by_study and one.kind == "run" and any(parent in told for parent in one.recipe.parents[1:]))
    }
    assert made
    assert left == set()
    assert set(made) & linked
    assert len(links) <= MOST_LINKS


def write_files(prepared: Prepared) -> None:
    """A scenario and a configuration that the workspace does not hold."""
    own = (prepared.folder / f"{prepared.scenario_id}.xml").read_text(encoding="utf-8")
    own_id = prepared.scenario_id.replace("_T-1", "_T-78")
    (prepared.folder / "linked.xml").write_text(own.replace(prepared.scenario_id, own_id), encoding="utf-8")
    (prepared.folder / "linked.yaml").write_text("cost_weights:\n  jerk: 0.37\n", encoding="utf-8")


def stored(prepared: Prepared) -> dict[str, Artifact]:
    """What the workspace holds, by ids."""
    workspace = Workspace(prepared.settings.workspace)
    try:
        return {one.artifact_id: one for one in workspace.newest(limit=10_000)}
    finally:
        workspace.close()


async def content(client: Client, link: ResourceLink) -> str:
    """What is behind a link, which says truly what and how large it is."""
    (found,) = (await client.read_resource(link.uri)).contents
    assert isinstance(found, TextResourceContents)
    assert (link.mime_type, bool(link.title)) == (found.mime_type, True)
    if not link.uri.startswith("plannerforge://job/"):  # what goes on has no size
        assert link.size == len(found.text.encode())
    return found.text
