"""Where SUMO lets two collide because it knows lanes and not bodies, one of them waits."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.builders import Vehicle, crossing, driving
from support.edits import apply_to

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.cosimulation.handover import HandoverTrack
from plannerforge.engine.cosimulation.manoeuvres import Halt
from plannerforge.engine.cosimulation.plans import Cause, DrivePlan, recorded_plan
from plannerforge.engine.cosimulation.replay import ROUTES_FILE
from plannerforge.engine.edits.edited_scene import Overlap
from plannerforge.engine.edits.simulation import plans_giving_way
from plannerforge.engine.scene.scene import Scene

EAST = driving(31, (-50, 0), 10.0, 101)
"""Reaches the middle of the crossing at step 50."""

GIVING_WAY = "plannerforge.engine.edits.simulation.plans_giving_way"
SPEEDS_UP = {"op": "set_behaviour", "vehicles": ["20026"], "preset": "speeder"}


def north(behind_m: float, speed_mps: float = 10.0) -> Vehicle:
    """Vehicle 32 on the other road, so far before the crossing."""
    return driving(32, (0, -behind_m), speed_mps, 101, heading_rad=math.pi / 2)


def told(folder: Path, first: Vehicle, second: Vehicle, causes: tuple[Cause, Cause], hit: int) -> dict[int, DrivePlan]:
    """The plans that change where both drive as recorded and meet at a step."""
    scene = Scene.of(read_scenario(crossing().with_vehicles(first, second).write(folder / "base.xml")))
    plans = {
        key: recorded_plan(scene, key, cause, scene.tracks[key].first_step)
        for key, cause in zip((31, 32), causes, strict=True)
    }
    tracks = {key: as_driven(track) for key, track in scene.tracks.items()}
    return plans_giving_way(plans, tracks, scene.tracks, [Overlap(31, 32, hit)])


def as_driven(track: Track) -> HandoverTrack:
    """A motion like the recording."""
    return HandoverTrack(**vars(track), accelerations_mps2=track.speeds_mps * 0.0, leaves=False, lanes=())


def test_a_handed_over_vehicle_waits_for_an_edited_one_until_the_road_is_free(tmp_path: Path) -> None:
    (plan,) = told(tmp_path, EAST, north(49.0), ("handed_over", "edited"), 48).values()
    assert plan.start.obstacle_id == 31
    (halt,) = plan.halts
    front_m = -50.0 + halt.rolled_m + EAST.length_m / 2
    assert -3.0 < front_m < -0.9
    north_is_clear = round((49.0 + north(0).length_m / 2 + EAST.width_m / 2) / 10.0 / 0.1)
    assert north_is_clear <= halt.until_step <= north_is_clear + 5


@pytest.mark.parametrize(("behind_m", "later"), [(48.0, 31), (52.0, 32)])
def test_of_two_handed_over_vehicles_the_later_one_waits(tmp_path: Path, behind_m: float, later: int) -> None:
    assert set(told(tmp_path, EAST, north(behind_m), ("handed_over", "handed_over"), 50)) == {later}


def test_a_vehicle_too_fast_to_stop_does_not_wait(tmp_path: Path) -> None:
    rushing = replace(EAST, poses=tuple((x + 42.0, y, heading, 12.0) for x, y, heading, _ in EAST.poses))
    near = north(8.0)
    assert set(told(tmp_path, rushing, north(11.0), ("handed_over", "edited"), 8)) == {32}
    assert told(tmp_path, rushing, replace(near, poses=near.poses[2:]), ("handed_over", "edited"), 5) == {}


def test_no_vehicle_brakes_for_another_that_has_not_entered_yet(tmp_path: Path) -> None:
    entering = replace(north(4.0, 1.0), first_step=44)
    assert told(tmp_path, EAST, entering, ("handed_over", "added"), 46) == {}
    (plan,) = told(tmp_path, EAST, replace(entering, first_step=36), ("handed_over", "added"), 48).values()
    assert plan.halts[0].from_step == 36


@pytest.mark.parametrize(
    ("name", "edit"),
    [
        ("DEU_Arnstadt-46_1_T-1", SPEEDS_UP),
        ("BEL_Brussels-51_2_T-1", {"op": "reroute", "vehicles": ["30199"], "to": ["649"]}),
    ],
)
def test_no_two_vehicles_collide_if_one_can_wait(
    shared_data: Path, tmp_path: Path, name: str, edit: dict[str, Any]
) -> None:
    base = shared_data / "data" / "commonroad" / f"{name}.xml"
    outcome = apply_to(base, tmp_path, edit, detail="checks").outcome
    assert outcome.collisions == ()
    assert len(outcome.handed_over) == 1
    assert all(one.feasible for one in outcome.touched)


def test_a_useless_halt_leaves_the_motion_unchanged(
    shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = shared_data / "data" / "commonroad" / "DEU_Arnstadt-46_1_T-1.xml"
    monkeypatch.setattr(GIVING_WAY, lambda *_: {})
    without = apply_to(base, tmp_path / "without", SPEEDS_UP, keep_simulation=True)
    assert len(without.outcome.collisions) == 1

    def halt_too_late(plans: dict[int, DrivePlan], *_: Any) -> dict[int, DrivePlan]:
        halt = Halt(0, 100, 10.0)
        return {key: replace(plan, halts=(*plan.halts, halt), gives_way=True) for key, plan in plans.items()}

    monkeypatch.setattr(GIVING_WAY, halt_too_late)
    applied = apply_to(base, tmp_path / "with", SPEEDS_UP, keep_simulation=True)
    assert applied.xml.read_bytes() == without.xml.read_bytes()
    kept = [(tmp_path / name / ROUTES_FILE).read_text(encoding="utf-8") for name in ("with", "without")]
    assert kept[0].partition("<routes")[2] == kept[1].partition("<routes")[2]
