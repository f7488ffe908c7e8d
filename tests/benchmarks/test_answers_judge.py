"""The judge of answers finds statements that files do not bear out, statements that exclude one another, and gaps."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.answers.cases import faulty_calls, sheet_of_catalogue, sheet_of_scenario
from benchmarks.answers.judge import GivenAnswer, judge, unanswered
from benchmarks.answers.recording import Call, answer_to, opened
from plannerforge.evals.scoring.files import World

pytestmark = pytest.mark.anyio
MADE = Call(
    "generate_scenarios",
    {"place": "Fahrhausen", "scenario_type": "intersection", "density": "medium", "duration_s": 8, "seed": 3},
)


@pytest.fixture(scope="module")
async def made_once(anyio_backend: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with one scenario, all maps read: to be copied."""
    folder = tmp_path_factory.mktemp("judged")
    async with opened(folder / "workspace", (folder,), maps=folder) as client:
        answer = await answer_to(client, MADE)
        assert not answer.is_error, answer.text
    return folder / "workspace"


@pytest.fixture
def place(made_once: Path, tmp_path: Path) -> Path:
    """A folder with a workspace of the test's own that holds the scenario."""
    shutil.copytree(made_once, tmp_path / "workspace")
    return tmp_path


async def answered(folder: Path, *calls: Call) -> tuple[GivenAnswer, World]:
    """The last answer of some calls on a workspace with one scenario, and the world that it is judged by."""
    async with opened(folder / "workspace", (folder,), maps=folder) as client:
        for call in (MADE, *calls):
            answer = await answer_to(client, call)
            assert not answer.is_error, answer.text
    last = answer.call
    given = GivenAnswer(last.tool, last.arguments, answer.text, answer.structured, is_error=False)
    return given, World(folder / "workspace")


def spoiled(told: GivenAnswer, path: str) -> GivenAnswer:
    """The answer with the field at a path larger by one, or another word; of a list the first element."""
    fields = json.loads(json.dumps(told.structured))
    *way, last = path.split(".")
    found = fields
    for part in way:
        found = found[part]
        found = found[0] if isinstance(found, list) else found
    value = found[last]
    if isinstance(value, list):
        found[last] = [value[0] + 1000, *value[1:]]
    elif isinstance(value, str):
        found[last] = "bus" if value == "car" else "run_000000000000"
    else:
        found[last] = value + (1000 if "lanelet" in last else 1)
    return replace(told, structured=fields)


def is_found(told: GivenAnswer, world: World, *paths: str) -> list[str]:
    """The paths whose field can hold another value without being found; the answer as it is holds."""
    verdict = judge(told, world)
    assert (verdict.false_statements, verdict.contradictions, verdict.unknown_figures) == ([], [], [])
    return [path for path in paths if not judge(spoiled(told, path), world).false_statements]


async def test_false_fields_of_a_description_are_found(place: Path) -> None:
    answer, world = await answered(place, Call("describe_scenario", {"detail": "vehicles"}))
    assert judge(answer, world).compared > 15
    ego = ("speed_mps", "lanelets", "lanes", "goal_until_s", "goal_distance_m", "goal_lanelets")
    vehicle = ("vehicle_id", "kind", "speed_mps", "distance_m", "lanelet")
    paths = [*(f"description.ego.{name}" for name in ego), *(f"description.vehicles.{name}" for name in vehicle)]
    assert is_found(answer, world, "counts.car", "description.vehicles_total", *paths) == []


async def test_false_fields_of_a_generation_are_found(place: Path) -> None:
    answer, world = await answered(place)
    names = ("vehicles_realised", "classes_realised.car", "ego_speed_mps", "goal_time_s", "goal_lanelet", "scenario_id")
    assert is_found(answer, world, *(f"scenarios.{name}" for name in names)) == []


async def test_false_fields_of_an_edit_and_contradictions_are_found(place: Path) -> None:
    edits = [{"op": "remove_vehicle", "vehicles": ["nearest:1"]}]
    call = Call("modify_scenario", {"scenario_id": "latest", "edits": edits})
    answer, world = await answered(place, call)
    assert is_found(answer, world, "untouched", "removed", "edits.vehicles") == []
    other = {**answer.structured, "scenario_id": "ZAM_Elsewhere-1_1_T-1"}
    assert judge(replace(answer, structured=other), world).contradictions
    danger = {**answer.structured["ego_after"], "risk_score": 0, "minimum_distance_m": 2.0, "left_out": []}
    both = {**answer.structured, "ego_after": danger}
    assert judge(replace(answer, structured=both), world).contradictions


async def test_false_fields_of_a_run_and_false_ids_are_found(place: Path) -> None:
    calls = (Call("run_planner", {"scenarios": ["latest"]}), Call("analyze_results", {"results": ["latest_run"]}))
    answer, world = await answered(place, *calls)
    paths = ("rows.duration_s", "rows.outcome", "rows.scenario_id", "review.largest.value", "review.largest.time_s")
    assert is_found(answer, world, *paths) == []
    unknown = answer.text.replace(answer.text.split()[0], "run_000000000000")
    assert "run_000000000000" in judge(replace(answer, text=unknown), world).false_statements[0]


async def test_a_search_that_counts_or_lists_wrongly_is_found(place: Path) -> None:
    answer, world = await answered(place, Call("find_scenarios", {"obstacles": ["car>=5"]}))
    assert is_found(answer, world, "total", "catalogue", "matches.counts.car", "matches.ego_speed_mps") == []
    assert judge(replace(answer, asked={"obstacles": ["car>=50"]}), world).false_statements


async def test_a_figure_of_a_text_that_is_in_no_field_is_found(place: Path) -> None:
    answer, world = await answered(place)
    text = f"{answer.text}\nIt took 8,765 tries."
    assert len(judge(replace(answer, text=text), world).unknown_figures) == 1


def test_gaps_of_an_answer_are_reported() -> None:
    fields = {"runs": [{"run_id": "run_1", "duration_s": 2.04, "reason": ""}], "next_step": ""}
    told = GivenAnswer("run_planner", {}, "run_1: hit car 3 at 2.0 s.", fields, is_error=False)
    asks = ("runs.run_id", "runs.duration_s", "runs.reason|next_step", "runs.reason|runs.run_id", "batch_id")
    assert list(unanswered(told, asks)) == ["runs.reason|next_step", "batch_id"]
    assert list(unanswered(replace(told, text="at 2.1 s"), asks[:2])) == ["runs.run_id", "runs.duration_s"]


def test_there_are_cases_over_all_tools_and_calls_with_many_faults() -> None:
    cases = [*sheet_of_catalogue(), *sheet_of_scenario("ZAM_Zip-1_6_T-1")]
    assert len(sheet_of_catalogue()) + 12 * len(sheet_of_scenario("ZAM_Zip-1_6_T-1")) >= 120
    assert {case.tool for case in cases} >= {"describe_scenario", "modify_scenario", "run_planner", "compare_results"}
    faulty = faulty_calls()
    assert len(faulty) >= 40
    assert all(2 <= len(call.words) <= 4 for call in faulty)
