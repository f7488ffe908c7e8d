"""A sample of requests with known answers: what can be done is done, the rest is refused for the right reason."""

import json
from pathlib import Path
from typing import Any

import pytest
from support.edits import apply_to

from plannerforge.evals.ground_truth.modification import edit_of
from plannerforge.schemas.errors import InvalidRequest

TASKS = ("T", "B", "P", "G", "composite")
EVERY = 26

REFUSED: list[tuple[str, dict[str, Any], str]] = [
    ("modB-d041", {"op": "set_behaviour", "vehicles": ["317"], "preset": "drunk"}, "no behaviour preset 'drunk'"),
    ("modB-d045", {"op": "set_behaviour", "vehicles": ["class:truck"], "preset": "cautious"}, "has no truck"),
    ("modB-d046", {"op": "set_behaviour", "vehicles": ["338"], "params": ["tau=-1"]}, "tau=-1 is out of range"),
    ("modB-d048", {"op": "set_behaviour", "vehicles": ["ego"], "preset": "cautious"}, "drives the ego"),
    ("modG-d041", {"op": "set_goal", "to": ["400"]}, "400 is not a lanelet"),
    ("modG-d045", {"op": "set_goal", "to": ["1245"], "position": "beginning"}, "1245 cannot be reached by the ego"),
    ("modG-d047", {"op": "set_goal", "to": ["35"], "rectangle_m": [6.0, 0.0]}, "not a goal region"),
    ("modP-d043", {"op": "remove_vehicle", "vehicles": ["class:bus"]}, "has no bus"),
    ("modP-d044", {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "4"}, "pedestrian is not allowed"),
    ("modP-d047", {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "lane": "left"}, "no lane in its direc"),
    ("modP-d048", {"op": "add_vehicle", "vehicle_class": "car", "at": "vehicle:20026"}, "by vehicle 20026"),
    ("modP-d050", {"op": "remove_vehicle", "vehicles": ["one:car"]}, "there are"),
    ("modT-d041", {"op": "reroute", "vehicles": ["495"], "to": ["40"]}, "no vehicle 495"),
    ("modT-d046", {"op": "reroute", "vehicles": ["30736"], "to": ["430"]}, "430 cannot be reached by vehicle 30736"),
    ("modT-d048", {"op": "reroute", "vehicles": ["ego"], "to": ["290"]}, "drives the ego"),
    ("modT-d049", {"op": "reroute", "vehicles": ["30749"]}, "either 'to' or 'turn'"),
]


def requests(shared_data: Path, task: str) -> list[dict[str, Any]]:
    lines = (shared_data / "corpora" / "dev" / f"modification_{task}.jsonl").read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]


@pytest.mark.parametrize("task", TASKS)
def test_possible_edits_are_carried_out(shared_data: Path, tmp_path: Path, task: str) -> None:
    for asked in [one for one in requests(shared_data, task) if one["expect"] == "ok"][::EVERY]:
        edits = [edit_of(truth).model_dump(exclude_defaults=True) for truth in asked["truth"]["edits"]]
        applied = apply_to(shared_data / "data" / "commonroad" / asked["scenario"], tmp_path, *edits)
        assert all(report.done for report in applied.outcome.edits), asked["id"]


@pytest.mark.parametrize(("key", "edit", "reason"), REFUSED, ids=[key for key, _, _ in REFUSED])
def test_impossible_edits_are_refused_and_leave_no_scenario(
    shared_data: Path, tmp_path: Path, key: str, edit: dict[str, Any], reason: str
) -> None:
    task = key[3]
    asked = next(one for one in requests(shared_data, task) if one["id"] == key)
    with pytest.raises(InvalidRequest, match=reason):
        apply_to(shared_data / "data" / "commonroad" / asked["scenario"], tmp_path / "out", edit)
    assert not (tmp_path / "out").exists()
