"""Shared helpers of the modification bench's tests: apply ground truth, and alter the result."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from lxml import etree

from benchmarks.modification.judges import checks_of
from benchmarks.modification.written import Written
from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.edits.apply import apply_edits
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scene.scene import Scene
from plannerforge.evals.ground_truth.modification import edit_of
from plannerforge.schemas.modification import ModificationRequest

GOAL_TIME = {"start_s": 2.0, "end_s": 7.5}
TRUTHS: dict[str, dict[str, Any]] = {
    "T": {"op": "reroute", "vehicle_id": 31, "target_lanelets": [12]},
    "B": {
        "op": "set_behaviour",
        "selector": {"by": "ids", "ids": [31]},
        "vehicle_ids": [31],
        "preset": "eco",
        "expected_params": {"tau": 1.8, "accel": 1.2},
    },
    "P": {
        "op": "add_vehicle",
        "class": "truck",
        "count": 1,
        "where": {"lanelet": 2, "position": "middle"},
        "speed_mps": 6.0,
        "depart_s": 1.0,
        "destination_lanelet": 21,
    },
    "R": {"op": "remove_vehicle", "selector": {"by": "ids", "ids": [33, 34]}, "vehicle_ids": [33, 34]},
    "G": {
        "op": "set_goal",
        "lanelet": 1,
        "position": "middle",
        "rectangle": {"length_m": 7.0, "width_m": 3.0},
        "time": GOAL_TIME,
    },
}
"""One right edit of each kind for the town road, in the corpus's form."""


def carried_out(base: Path, *truths: dict[str, Any]) -> Written:
    """Return the result of edits in the corpus's form on a file."""
    request = ModificationRequest(
        xml=base,
        edits=tuple(edit_of(truth) for truth in truths),
        benchmark_id="ZAM_Bench-1_1_T-1",
        output=base.parent / "out",
        keep_simulation=True,
    )
    return Written.of(base, Scene.of(read_scenario(base)), truths, apply_edits(request, silent))


def verdicts(written: Written) -> dict[str, bool]:
    """Return the checks of all edits together."""
    found: dict[str, bool] = {}
    for index in range(len(written.truths)):
        for name, passed in checks_of(written, index).items():
            found[name] = found.get(name, True) and passed
    return found


def asked(written: Written, **truth: Any) -> Written:
    """Return the same file for another request."""
    return replace(written, truths=({**written.truths[0], **truth},))


def told(written: Written, **edit: Any) -> Written:
    """Return the same file with another report of its first edit."""
    reports = (written.outcome.edits[0].model_copy(update=edit), *written.outcome.edits[1:])
    return replace(written, outcome=written.outcome.model_copy(update={"edits": reports}))


def without(written: Written, key: int) -> Written:
    """Return the same file as if a road user had been lost."""
    return replace(written, new={other: track for other, track in written.new.items() if other != key})


def moving(written: Written, key: int, change: Callable[[Track], Track]) -> Written:
    """Return the same file with another motion of a road user."""
    return replace(written, new={**written.new, key: change(written.new[key])})


def typed(written: Written, key: int, **attributes: str) -> Written:
    """Return the same file as if SUMO had driven a vehicle by another type."""
    return replace(
        written,
        sumo=replace(written.sumo, types={**written.sumo.types, key: {**written.sumo.types[key], **attributes}}),
    )


def respelt(written: Written, path: str, value: str) -> Written:
    """Return the same file with another text at a path, in a copy next to it."""
    tree = etree.parse(written.xml)
    tree.getroot().find(path).text = value
    copy = written.xml.with_name("respelt.xml")
    tree.write(copy)
    return replace(written, xml=copy, loaded=read_scenario(copy))


def later_by(written: Written, obstacle_id: int, steps: int) -> Written:
    """Return the same file with all states of an obstacle delayed, in a copy next to it."""
    tree = etree.parse(written.xml)
    for time in tree.getroot().iterfind(f"dynamicObstacle[@id='{obstacle_id}']//time/exact"):
        time.text = str(int(time.text) + steps)
    copy = written.xml.with_name("later.xml")
    tree.write(copy)
    return replace(written, xml=copy, loaded=read_scenario(copy))
