"""The judge of answers finds statements that files do not bear out, statements that exclude one another, and gaps."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.answers.cases import faulty_calls, sheet_of_catalogue, sheet_of_scenario
from benchmarks.answers.judge import Told, judge, unanswered
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


async def answered(folder: Path, *calls: Call) -> tuple[Told, World]:
    """The last answer of some calls on a workspace with one scenario, and the world that it is judged by."""
    async with opened(folder / "workspace", (folder,), maps=folder) as client:
        for call in (MADE, *calls):
            answer = await answer_to(client, call)
            assert not answer.is_error, answer.text
    last = answer.call
    return Told(last.tool, last.arguments, answer.text, answer.structured, is_error=False), World(folder / "workspace")


def spoiled(told: Told, pattern: str) -> Told:
    """The answer with the first number of the pattern's group one larger, or its word another one."""

    def other(found: re.Match[str]) -> str:
        words = found[1]
        swapped = {"ahead": "behind", "behind": "ahead", "car": "bus"}.get(words)
        much = 1000 if "lanelet" in found[0] else 1
        number = swapped or f"{float(words) + much:.{len(words.partition('.')[2])}f}"
        begin, end = found.start(1) - found.start(), found.end(1) - found.start()
        return found[0][:begin] + number + found[0][end:]

    text = re.sub(pattern, other, told.text, count=1, flags=re.MULTILINE)
    assert text != told.text, f"{pattern} is not in {told.text}"
    return replace(told, text=text)


async def test_false_statements_of_a_description_are_found(place: Path) -> None:
    answer, world = await answered(place, Call("describe_scenario", {"detail": "vehicles"}))
    assert judge(answer, world).false_statements == []
    assert judge(answer, world).compared > 15
    for pattern in (
        r"(\d+) road users",
        r"\((\d+) cars",
        r"^Ego: ([\d.]+) m/s",
        r"^Ego: .* on lanelet (\d+)",
        r"(\d+) lanes? in its",
        r"Goal: .*at ([\d.]+)\.\.",
        r"region (\d+) m away",
        r"^- \d+ (car): ",
        r"^- \d+ car: .*?([\d.]+) m/s",
        r"^- \d+ car: .*gap .*lanelet (\d+)",
    ):
        assert judge(spoiled(answer, pattern), world).false_statements, pattern


async def test_false_statements_of_a_generation_are_found(place: Path) -> None:
    answer, world = await answered(place)
    assert judge(answer, world).false_statements == []
    for pattern in (
        r"(\d+) vehicles",
        r"the ego, (\d+) cars",
        r"at ([\d.]+) m/s; goal",
        r"within [\d.]+ to ([\d.]+) s",
    ):
        assert judge(spoiled(answer, pattern), world).false_statements, pattern


async def test_false_statements_of_an_edit_and_contradictions_are_found(place: Path) -> None:
    edits = [{"op": "remove_vehicle", "vehicles": ["nearest:1"]}]
    answer, world = await answered(place, Call("modify_scenario", {"scenario_id": "latest", "edits": edits}))
    verdict = judge(answer, world)
    assert (verdict.false_statements, verdict.contradictions) == ([], [])
    for pattern in (r"(\d+) vehicles exactly", r"removed 1: (\d+)", r"\(nearest:1: (\d+)"):
        assert judge(spoiled(answer, pattern), world).false_statements, pattern
    other = {**answer.structured, "scenario_id": "ZAM_Elsewhere-1_1_T-1"}
    assert judge(replace(answer, structured=other), world).contradictions
    both = answer.text + "\nNothing new for the ego: nearest 1.46 m → 0.2 m"
    assert judge(replace(answer, text=re.sub(r"(?m)^(?:New|Nothing new) for.*\n", "", both)), world).contradictions


async def test_false_statements_of_a_run_are_found(place: Path) -> None:
    calls = (Call("run_planner", {"scenarios": ["latest"]}), Call("analyze_results", {"results": ["latest_run"]}))
    answer, world = await answered(place, *calls)
    assert judge(answer, world).false_statements == []
    for pattern in (
        r"(?:goal|collision).* at ([\d.]+) s",
        r"Largest: \w+ ([\d.]+) m/s²",
        r"distance driven ([\d.]+) m",
    ):
        assert judge(spoiled(answer, pattern), world).false_statements, pattern
    unknown = answer.text.replace(answer.text.split()[0], "run_000000000000")
    assert "run_000000000000" in judge(replace(answer, text=unknown), world).false_statements[0]
    words = "reached the goal at" if "collision:" in answer.text else "collision: hit car 1 at"
    assert judge(
        replace(answer, text=re.sub(r": [^:]* at", f": {words}", answer.text, count=1)), world
    ).false_statements


async def test_a_search_that_counts_or_lists_wrongly_is_found(place: Path) -> None:
    answer, world = await answered(place, Call("find_scenarios", {"obstacles": ["car>=5"]}))
    assert judge(answer, world).false_statements == []
    for pattern in (r"^(\d+) of \d+ scenario", r"^\d+ of (\d+) scenario", r"(\d+) cars", r"ego ([\d.]+) m/s"):
        assert judge(spoiled(answer, pattern), world).false_statements, pattern
    assert judge(replace(answer, asked={"obstacles": ["car>=50"]}), world).false_statements


def test_what_an_answer_lacks_is_told() -> None:
    told = Told("run_planner", {}, "run_1: collision: hit car 3 at 2.0 s.", {}, is_error=False)
    assert list(unanswered(told, (r"collision: ", r"^Next: "))) == [r"^Next: "]


def test_there_are_cases_over_all_tools_and_calls_with_many_faults() -> None:
    cases = [*sheet_of_catalogue(), *sheet_of_scenario("ZAM_Zip-1_6_T-1")]
    assert len(sheet_of_catalogue()) + 12 * len(sheet_of_scenario("ZAM_Zip-1_6_T-1")) >= 120
    assert {case.tool for case in cases} >= {"describe_scenario", "modify_scenario", "run_planner", "compare_results"}
    faulty = faulty_calls()
    assert len(faulty) >= 40
    assert all(2 <= len(call.words) <= 4 for call in faulty)
