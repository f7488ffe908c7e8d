"""The report's lanelets are those that the written motion gets onto, not those whose line SUMO's bumper is over."""

from pathlib import Path

import numpy as np
import pytest
from support.builders import Lane, ScenarioBuilder, crossing, driving, line

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.cosimulation.handover import HandoverTrack
from plannerforge.engine.cosimulation.plans import recorded_plan
from plannerforge.engine.edits.changes import Changes, EditStep
from plannerforge.engine.edits.edited_scene import EditedScene, SimulationResult
from plannerforge.engine.edits.explanations import DrivenVehicle, vehicle_route
from plannerforge.engine.scene.scene import Scene
from plannerforge.schemas.modification import VehicleRoute

STEPS, LINE_STEP = 101, 60
OVER_THE_LINE = ("e1_0",) * LINE_STEP + (":n1_0_0",) * (STEPS - LINE_STEP)
"""SUMO's bumper is in lanelet 2, inside the crossing, from a step on."""


def scene_of(builder: ScenarioBuilder, folder: Path) -> Scene:
    return Scene.of(read_scenario(builder.with_vehicles(driving(31, (-50, 0), 10.0, STEPS)).write(folder / "base.xml")))


def halting(front_m: float, lanes: tuple[str, ...] = OVER_THE_LINE) -> HandoverTrack:
    """Vehicle 31, eastbound, which halts with its front at some x."""
    x_m = np.minimum(-50.0 + np.arange(STEPS), front_m - 4.5 / 2)
    positions = np.stack([x_m, np.zeros(STEPS)], axis=1)
    speeds = np.gradient(x_m, 0.1)
    return HandoverTrack(31, "car", 4.5, 1.8, 0, positions, speeds * 0, speeds, speeds * 0, leaves=False, lanes=lanes)


def route_of(scene: Scene, step: EditStep, track: HandoverTrack) -> VehicleRoute:
    """The route that is reported where vehicle 31 is the only one."""
    result = SimulationResult(step.changes.driven, {31: track}, (), ())
    return vehicle_route(EditedScene(scene, step.changes, result), step, 31)


@pytest.mark.parametrize(
    ("over_m", "expected"), [(-0.2, (1,)), (0.02, (1,)), (0.4, (1,)), (0.6, (1, 2)), (4.0, (1, 2))]
)
def test_a_lanelet_reached_only_by_the_bumper_is_not_driven(
    tmp_path: Path, over_m: float, expected: tuple[int, ...]
) -> None:
    scene = scene_of(crossing(), tmp_path)
    vehicle = DrivenVehicle(scene, recorded_plan(scene, 31, "edited", 0), halting(-10 + over_m), {})
    assert vehicle.lanelets == expected
    assert vehicle.gets_to(frozenset({2}), LINE_STEP - 5) == (2 in expected)


def test_half_of_a_shorter_lanelet_is_enough(tmp_path: Path) -> None:
    lanes = (Lane(1, line((-60, 0), (-10, 0)), successors=(2,)), Lane(2, line((-10, 0), (-9.4, 0)), predecessors=(1,)))
    scene = scene_of(ScenarioBuilder(lanes), tmp_path)
    plan, over = recorded_plan(scene, 31, "edited", 0), ("e1_0",) * LINE_STEP + ("e2_0",) * (STEPS - LINE_STEP)
    assert DrivenVehicle(scene, plan, halting(-9.65, over), {}).lanelets == (1, 2)
    assert DrivenVehicle(scene, plan, halting(-9.75, over), {}).lanelets == (1,)


def test_a_bumper_over_the_line_is_not_an_arrival_but_a_wait_at_the_junction(tmp_path: Path) -> None:
    scene = scene_of(crossing(), tmp_path)
    plan = recorded_plan(scene, 31, "edited", 0)
    step = EditStep(Changes(next_id=100, driven={31: plan}), (31,), "", aims={31: (frozenset({2}),)})
    route = route_of(scene, step, halting(-9.98))
    assert route.arrives is False
    assert route.reason.startswith("it stands on lanelet 1 when the scenario ends")
    assert route.reason.endswith(" s waiting at the junction after lanelet 1")
    assert route_of(scene, step, halting(-9.0)).arrives


def test_a_vehicle_still_steering_to_its_target_is_on_its_way_and_had_room(tmp_path: Path) -> None:
    lanes = (Lane(1, line((-60, 0), (60, 0)), left=(2, True)), Lane(2, line((-60, 3.5), (60, 3.5)), right=(1, True)))
    scene = scene_of(ScenarioBuilder(lanes), tmp_path)
    plan = recorded_plan(scene, 31, "edited", 0)
    step = EditStep(Changes(next_id=100, driven={31: plan}), (31,), "", aims={31: (frozenset({2}),)})
    rolling = halting(55.0, ("e1_0",) * 95 + ("e1_1",) * 6)
    route = route_of(scene, step, rolling)
    assert route.arrives is False
    assert route.reason == "the scenario ends at 10.0 s on the way to lanelet 2"


def test_a_lanelet_passed_with_the_body_still_next_to_it_is_not_reached(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((-60, 0), (0, 0)), successors=(3,), left=(2, True)),
        Lane(2, line((-60, 3.5), (0, 3.5)), successors=(4,), right=(1, True)),
        Lane(3, line((0, 0), (8, 0)), predecessors=(1,), successors=(5,), left=(4, True)),
        Lane(4, line((0, 3.5), (8, 3.5)), predecessors=(2,), successors=(6,), right=(3, True)),
        Lane(5, line((8, 0), (60, 0)), predecessors=(3,), left=(6, True)),
        Lane(6, line((8, 3.5), (60, 3.5)), predecessors=(4,), right=(5, True)),
    )
    scene = scene_of(ScenarioBuilder(lanes), tmp_path)
    plan = recorded_plan(scene, 31, "edited", 0)
    step = EditStep(Changes(next_id=100, driven={31: plan}), (31,), "", aims={31: (frozenset({4}),)})
    lanes_driven = ("e1_0",) * 50 + ("e3_1",) * 8 + ("e5_0",) * (STEPS - 58)
    assert set(lanes_driven) <= set(scene.layout.lanelets_of_lane)
    assert route_of(scene, step, halting(50.0, lanes_driven)).arrives is False
