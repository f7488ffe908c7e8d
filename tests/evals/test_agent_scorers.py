"""Scorers of agents judge what was written: a wrong world fails, whatever the arguments say."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.answers.recording import Call, answer_to, opened
from plannerforge.evals.attempts import Attempt, EvalRequest, MadeCall
from plannerforge.evals.scoring.routing import classes_of
from plannerforge.evals.scoring.scores import score_attempt
from plannerforge.evals.spoiled import Scripted, SpoilRates

pytestmark = pytest.mark.anyio
MADE = {"place": "Fahrhausen", "scenario_type": "intersection", "duration_s": 8, "seed": 3, "vehicles": ["truck=1"]}


def attempt_of(*calls: MadeCall, ending: Any = "answered", answers: tuple[str, ...] = ("done",)) -> Attempt:
    return Attempt("one", tuple(calls), answers, ending)


async def carried_out(folder: Path, *calls: Call, **more: Any) -> list[MadeCall]:
    """Calls and their answers on a workspace with one generated scenario, which they name ``latest``."""
    made = []
    async with opened(folder / "workspace", (folder,), maps=folder) as client:
        for call in (Call("generate_scenarios", {**MADE, **more}), *calls):
            answer = await answer_to(client, call)
            made.append(MadeCall(call.tool, call.arguments, answer.text, answer.structured, answer.is_error, 0.1))
    return made


def request_of(task: Any, truth: dict[str, Any], expect: Any = "ok", corpus: str = "") -> EvalRequest:
    return EvalRequest("one", task, corpus or task, "do it", truth, expect, map_file="fahrhausen.osm")


@pytest.mark.usefixtures("warm_workers")
async def test_a_generation_is_done_if_the_file_matches_the_request(tmp_path: Path) -> None:
    made = await carried_out(tmp_path)
    truth = {
        "location": {"country": "ZAM", "city": "Fahrhausen", "place": None, "bbox": None},
        "scenario_type": "intersection",
        "vehicles": {"car": "present", "truck": 1},
        "count": 1,
        "defaults": ["density", "ego", "goal"],
    }
    good = score_attempt(request_of("generation", truth), attempt_of(*made), tmp_path / "workspace")
    assert good.done, good.misses
    for wrong in (
        {"vehicles": {"truck": 4}},
        {"scenario_type": "roundabout"},
        {"count": 2},
        {"location": {**truth["location"], "country": "DEU"}},  # type: ignore[dict-item]
        {"defaults": ["duration_s"]},
    ):
        score = score_attempt(request_of("generation", {**truth, **wrong}), attempt_of(*made), tmp_path / "workspace")
        assert not score.done
        assert score.misses
    refused = request_of("generation", truth, "refuse")
    assert not score_attempt(refused, attempt_of(*made), tmp_path / "workspace").done
    assert score_attempt(refused, attempt_of(ending="refused"), tmp_path / "workspace").done


@pytest.mark.usefixtures("warm_workers")
async def test_an_edit_is_judged_by_the_written_file(tmp_path: Path) -> None:
    edits = [{"op": "remove_vehicle", "vehicles": ["nearest:1"]}]
    made = await carried_out(
        tmp_path, Call("modify_scenario", {"scenario_id": "latest", "edits": edits}), goal="steps:20"
    )
    key = made[1].structured["edits"][0]["vehicles"][0]
    truth = {"edits": [{"op": "remove_vehicle", "selector": {"by": "ids", "ids": [key]}, "vehicle_ids": [key]}]}
    request = request_of("modification", truth, corpus="modification_P")
    assert score_attempt(request, attempt_of(*made), tmp_path / "workspace").done
    other = {"edits": [{**truth["edits"][0], "vehicle_ids": [key + 1]}]}
    wrong = request_of("modification", other, corpus="modification_P")
    assert not score_attempt(wrong, attempt_of(*made), tmp_path / "workspace").done
    kept = replace(made[1], structured={**made[1].structured, "scenario_id": made[1].structured["base_id"]})
    assert not score_attempt(request, attempt_of(kept), tmp_path / "workspace").done
    assert not score_attempt(request, attempt_of(made[0]), tmp_path / "workspace").done


@pytest.mark.usefixtures("warm_workers")
async def test_weights_come_from_the_stored_configuration(tmp_path: Path) -> None:
    configured = Call("configure_planner", {"weights": ["jerk=0.3"], "base": "frenetix:Default"})
    made = await carried_out(tmp_path, configured, goal="steps:20")
    weights = {
        "acceleration": 0,
        "jerk": 0.3,
        "lateral_jerk": 0.2,
        "longitudinal_jerk": 0.2,
        "orientation_offset": 0,
        "path_length": 0,
        "lane_center_offset": 0,
        "velocity_offset": 1,
        "velocity": 0,
        "distance_to_reference_path": 5,
        "distance_to_obstacles": 0,
        "prediction": 0.2,
        "responsibility": 0,
    }
    truth = {"planner": "frenetix", "preset": None, "weights": weights, "explicit": {"jerk": 0.3}}
    assert score_attempt(request_of("tuning", truth), attempt_of(*made), tmp_path / "workspace").done
    off = {**truth, "weights": {**weights, "jerk": 0.4}}
    assert not score_attempt(request_of("tuning", off), attempt_of(*made), tmp_path / "workspace").done
    up = {"planner": "frenetix", "preset": None, "weights": None, "direction": [{"any_of": ["jerk"], "sign": "up"}]}
    assert score_attempt(request_of("tuning", up), attempt_of(*made), tmp_path / "workspace").done
    down = {**up, "direction": [{"any_of": ["jerk"], "sign": "down"}]}
    assert not score_attempt(request_of("tuning", down), attempt_of(*made), tmp_path / "workspace").done


@pytest.mark.parametrize(
    ("calls", "classes"),
    [
        ([("describe_scenario", {}), ("modify_scenario", {"edits": [{"op": "set_goal"}, {"op": "reroute"}]})], "TG"),
        ([("run_planner", {}), ("analyze_results", {"results": ["latest_batch"]})], "batch_sim batch_analysis"),
        ([("analyze_results", {"results": ["run_1"]})], "analysis"),
        ([("describe_catalog", {})], "qa"),
        ([], "fail"),
    ],
)
def test_calls_belong_to_the_classes_of_the_paper(calls: list[tuple[str, dict[str, Any]]], classes: str) -> None:
    made = [MadeCall(tool, arguments, "", {}, False, 0.0) for tool, arguments in calls]
    found, letters = classes_of(attempt_of(*made, ending="answered" if made else "refused"))
    assert (letters or " ".join(found)) == classes


class Recorder:
    """A tool session that refuses names it does not know and remembers what it was sent."""

    def __init__(self) -> None:
        self.sent: list[dict[str, Any]] = []

    async def call(self, tool: str, arguments: Any, turn: int = 0) -> MadeCall:
        self.sent.append(json.loads(json.dumps(arguments)))
        wrong = [name for name in arguments if name not in ("scenario_id", "edits")]
        text = f"there is no argument '{wrong[0]}'" if wrong else "done"
        return MadeCall(tool, arguments, text, {}, bool(wrong), 0.0, turn)


async def test_spoiled_calls_are_corrected_from_their_refusal() -> None:
    truth = {"edits": [{"op": "remove_vehicle", "selector": {"by": "ids", "ids": [7]}, "vehicle_ids": [7]}]}
    request = replace(request_of("modification", truth, corpus="modification_P"), scenario="DEU_A-1_1_T-1.xml")
    never, recorder = SpoilRates(*[0.0] * 10), Recorder()
    await Scripted(0, never).attempt(request, recorder)
    assert recorder.sent == [{"scenario_id": "DEU_A-1_1_T-1", "edits": [{"op": "remove_vehicle", "vehicles": ["7"]}]}]
    always = Recorder()
    attempt = await Scripted(0, replace(never, extra_field=1.0, ids_as_numbers=1.0)).attempt(request, always)
    assert [call.is_error for call in attempt.calls] == [True, False]
    assert "reasoning" in always.sent[0]
    assert always.sent[1]["edits"] == [{"op": "remove_vehicle", "vehicles": [7]}]
    assert attempt == replace(
        await Scripted(0, replace(never, extra_field=1.0, ids_as_numbers=1.0)).attempt(request, Recorder()),
        duration_s=attempt.duration_s,
    )
