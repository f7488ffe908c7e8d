"""The decisive moments of a run: contacts, the closest moment, the largest motions, limits of comfort."""

import math
from pathlib import Path
from typing import Any

import pytest
from support.builders import town_road
from support.runs import metrics, record

from plannerforge.engine.analysis.moments import review
from plannerforge.engine.analysis.run_set import RunSet
from plannerforge.schemas.reviews import COLLISION_CAUSES, Contact, RunReview
from plannerforge.schemas.runs import CollisionRecord, DrivenObstacle, RunSource, RunSteps, ScenarioSource
from plannerforge.schemas.worlds import Perceived, Sighting

STEPS = 41
Place = tuple[float, float, float, float]
"""Position, heading and speed at the contact."""


def moving(place: Place, *, sideways: float = 0.0, length_m: float = 4.5, key: int = 7) -> DrivenObstacle:
    """Straight to a place, reached at step 40; ``sideways``: metres across that it came in the last second."""
    x, y, heading, speed = place
    back = [(40 - step) * 0.1 for step in range(STEPS)]
    across = [sideways * min(seconds, 1.0) for seconds in back]
    return DrivenObstacle(
        obstacle_id=key,
        kind="car",
        length_m=length_m,
        width_m=1.8,
        first_step=0,
        x_m=tuple(x - speed * s * math.cos(heading) + a * math.sin(heading) for s, a in zip(back, across, strict=True)),
        y_m=tuple(y - speed * s * math.sin(heading) - a * math.cos(heading) for s, a in zip(back, across, strict=True)),
        heading_rad=(heading,) * STEPS,
        speed_mps=(speed,) * STEPS,
    )


def reviewed(ego: DrivenObstacle, *others: DrivenObstacle, folder: Path, **changes: Any) -> RunReview:
    """The review of a run that collides with obstacle 7 at step 40, or of one with these changes."""
    steps = RunSteps(
        first_step=0,
        x_m=ego.x_m,
        y_m=ego.y_m,
        heading_rad=ego.heading_rad,
        speed_mps=ego.speed_mps,
        acceleration_mps2=changes.pop("acceleration_mps2", (0.0,) * STEPS),
        plan_steps=(),
        costs={},
        others=others,
        perceived=changes.pop("perceived", None),
    )
    scenarios = (changes.pop("scenario"),) if "scenario" in changes else ()
    hit = CollisionRecord(obstacle_id=7, kind="car", step=40, time_s=4.0)
    run = record(outcome="collision").model_copy(update={"collision": hit, **changes})
    path = folder / "steps.json"
    path.write_text(steps.model_dump_json(), encoding="utf-8")
    return review(RunSet((RunSource(record=run, steps_path=str(path)),), scenarios=scenarios), run)


def contact(ego: DrivenObstacle, *others: DrivenObstacle, folder: Path) -> Contact:
    found = reviewed(ego, *others, folder=folder).contact
    assert found is not None
    return found


EAST, NORTH, WEST = 0.0, math.pi / 2, math.pi
CASES: dict[str, tuple[Place, Place, str, str | None, str | None]] = {
    "a faster follower": ((0, 0, EAST, 5), (-4.4, 0, EAST, 12), "rear_end_by_other", "rear", "front"),
    "a slower vehicle ahead": ((0, 0, EAST, 12), (4.4, 0, EAST, 5), "rear_end_by_ego", "front", "rear"),
    "across from the right": ((0, 0, EAST, 10), (3.0, -0.2, NORTH, 8), "crossing", "front", "left"),
    "an oncoming one": ((0, 0, EAST, 10), (4.3, 0.5, WEST, 9), "oncoming", "front", "front"),
    "alongside": ((0, 0, EAST, 10), (0.5, 1.6, EAST - 0.05, 10), "side", "left", "right"),
    "a merging one from the left": ((0, 0, EAST, 10), (-4.3, 2.7, EAST - 0.5, 12), "side", "left", "front"),
    "into the side of a merging one": ((0, 0, EAST, 12), (4.0, -1.2, EAST + 0.6, 9), "side", "front", "left"),
    "a standing one": ((0, 0, EAST, 10), (4.3, 0, EAST, 0), "into_standing", "front", "rear"),
    "onto the standing ego": ((0, 0, EAST, 0), (-4.3, 0, EAST, 9), "onto_standing_ego", "rear", "front"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_contact_is_classed_by_headings_sides_and_speeds(name: str, tmp_path: Path) -> None:
    ego, other, kind, ego_side, other_side = CASES[name]
    found = contact(moving(ego, key=0), moving(other), folder=tmp_path)
    assert (found.kind, found.ego_side, found.other_side) == (kind, ego_side, other_side)
    assert (found.ego_speed_mps, found.other_speed_mps) == (ego[3], other[3])


@pytest.mark.parametrize("turn", [0.3, 1.7, -2.6])
@pytest.mark.parametrize("name", CASES)
def test_a_turned_world_gives_the_same_contact(name: str, turn: float, tmp_path: Path) -> None:
    def turned(place: Place) -> Place:
        x, y, heading, speed = place
        c, s = math.cos(turn), math.sin(turn)
        return x * c - y * s, x * s + y * c, heading + turn, speed

    ego, other, kind, ego_side, other_side = CASES[name]
    found = contact(moving(turned(ego), key=0), moving(turned(other)), folder=tmp_path)
    assert (found.kind, found.ego_side, found.other_side) == (kind, ego_side, other_side)


def test_a_vehicle_that_crosses_into_the_ego_s_path_cuts_in(tmp_path: Path) -> None:
    ego, other = (0.0, 0.0, EAST, 12.0), (4.4, 0.0, EAST, 8.0)
    found = contact(moving(ego, key=0), moving(other, sideways=3.5), folder=tmp_path)
    assert found.kind == "cut_in"
    assert found.came_in_s == pytest.approx(3.5, abs=0.11)
    assert "ran into car 7, which had cut in at 3.6 s," in found.in_words()
    by_ego = contact(moving((0, 0, EAST, 8), sideways=3.5, key=0), moving((-4.4, 0, EAST, 12)), folder=tmp_path)
    assert by_ego.kind == "cut_in_by_ego"


def test_a_follower_that_changes_lanes_into_the_rear_is_not_a_cut_in(tmp_path: Path) -> None:
    found = contact(moving((0, 0, EAST, 12), sideways=3.5, key=0), moving((4.4, 0, EAST, 5)), folder=tmp_path)
    assert found.kind == "rear_end_by_ego"


def test_the_text_states_the_time_the_speeds_and_the_events_before(tmp_path: Path) -> None:
    ego, other = moving((0, 0, EAST, 0), key=0), moving((-4.3, 0, EAST, 9))
    hit = contact(ego, other, folder=tmp_path)
    assert hit.prevention is not None
    assert hit.in_words() == (
        "was hit by car 7 from behind while stationary at 4.0 s (ego 0.0 m/s, standing since 0.0 s; car 7: 9.0 m/s); "
        f"attributed to the recording, in which car 7 cannot react; {hit.prevention.in_words()}"
    )
    braking = (0.0,) * 31 + (-3.0,) * 10
    ego, other = moving((0, 0, EAST, 12), key=0), moving((4.4, 0, EAST, 5))
    found = reviewed(ego, other, folder=tmp_path, acceleration_mps2=braking).contact
    assert found is not None
    assert (found.braked_since_s, found.closing_mps) == (3.0, pytest.approx(7.0))
    assert "at 4.0 s (ego 12.0 m/s, braking since 3.0 s; car 7: 5.0 m/s); " in found.in_words()


def test_all_that_are_touched_at_once_are_named(tmp_path: Path) -> None:
    ego, other = moving((0, 0, EAST, 5), key=0), moving((-4.4, 0, EAST, 12))
    third = moving((4.3, 0, EAST, 5), key=9)
    assert contact(ego, other, third, folder=tmp_path).also_touched == (9,)


def test_a_road_boundary_has_no_partner(tmp_path: Path) -> None:
    edge = CollisionRecord(obstacle_id=None, kind="road_boundary", step=40, time_s=4.0)
    found = reviewed(moving((0, 0, EAST, 5), key=0), folder=tmp_path, collision=edge, outcome="off_road")
    assert found.contact is not None
    assert (found.contact.kind, found.contact.other_speed_mps) == ("road_boundary", None)
    assert found.contact.in_words() == "left the road at 4.0 s, at 5.0 m/s, not braking"


def success(ego: DrivenObstacle, *others: DrivenObstacle, folder: Path, **changes: Any) -> RunReview:
    values = {"outcome": "goal_reached", "collision": None} | changes
    return reviewed(ego, *others, folder=folder, **values)


def test_the_closest_moment_of_a_success_has_partner_time_and_gap(tmp_path: Path) -> None:
    # The other stands 3 m left of the ego's way; the ego's centre passes it at step 20.
    ego, other = moving((20.0, 0.0, EAST, 10.0), key=0), moving((0.0, 3.0, EAST, 0.0))
    gap = 3.0 - (1.61 + 1.8) / 2
    figures = metrics(minimum_distance_m=gap)
    found = success(ego, other, folder=tmp_path, metrics=figures)
    assert found.closest is not None
    assert (found.closest.obstacle_id, found.closest.side) == (7, "left")
    assert found.closest.gap_m == pytest.approx(gap)
    assert found.closest.time_s == pytest.approx(1.6, abs=0.1)
    assert "Closest: 1.29 m to car 7 on the left at 1.6 s" in found.nearness_in_words()
    assert "never on a collision course." in found.nearness_in_words()


@pytest.mark.parametrize(
    ("facing", "speed", "course"),
    [(WEST, 0.0, "standing"), (NORTH, 0.0, "standing"), (EAST, 0.0, "same"), (WEST, 1.0, "oncoming")],
)
def test_a_parked_vehicle_is_not_oncoming_in_either_direction(
    facing: float, speed: float, course: str, tmp_path: Path
) -> None:
    ego, other = moving((20.0, 0.0, EAST, 10.0), key=0), moving((0.0, 6.0, facing, speed))
    gap = 6.0 - 1.61 / 2 - (4.5 if facing == NORTH else 1.8) / 2
    found = success(ego, other, folder=tmp_path, metrics=metrics(minimum_distance_m=gap))
    assert found.closest is not None
    assert found.closest.direction == course
    assert ("oncoming" in found.nearness_in_words()) == (course == "oncoming")


def test_a_gap_that_the_tracks_do_not_show_is_not_reported(tmp_path: Path) -> None:
    ego, other = moving((20.0, 0.0, EAST, 10.0), key=0), moving((0.0, 3.0, EAST, 0.0))
    assert success(ego, other, folder=tmp_path, metrics=metrics(minimum_distance_m=0.4)).closest is None


def test_times_in_which_the_planner_did_not_get_a_road_user_are_listed_nearest_first(tmp_path: Path) -> None:
    ego = moving((20.0, 0.0, EAST, 10.0), key=0)
    others = (
        moving((0.0, 3.0, EAST, 0.0)),
        moving((60.0, 3.0, EAST, 0.0), key=8),
        moving((20.0, 9.0, EAST, 0.0), key=9),
    )
    entries = [
        (7, 0, "out_of_range", None),
        (7, 5, "seen", None),
        (7, 10, "occluded", 9),
        (7, 20, "unconfirmed", None),
        (7, 22, "seen", None),
        (8, 0, "out_of_range", None),
        (8, 20, "seen", None),
        (9, 0, "missed", None),
    ]
    sightings = tuple(Sighting(obstacle_id=key, step=step, code=code, by=by) for key, step, code, by in entries)  # type: ignore[arg-type]
    found = success(ego, *others, folder=tmp_path, perceived=Perceived(sightings=sightings))
    times = [(one.obstacle_id, one.code, one.by, one.from_s, one.until_s) for one in found.unseen]
    assert times == [(7, "occluded", 9, 1.0, 2.2), (9, "missed", None, 0.0, None)]
    assert found.unseen_times == 2
    assert "car 9" in found.unseen_in_words()


def test_a_planner_that_got_everyone_is_not_reported_to_have_missed_one(tmp_path: Path) -> None:
    ego, other = moving((20.0, 0.0, EAST, 10.0), key=0), moving((0.0, 3.0, EAST, 0.0))
    seen = Perceived(
        sightings=(Sighting(obstacle_id=7, step=0, code="seen"), Sighting(obstacle_id=7, step=9, code="kept"))
    )
    for perceived in (None, seen):
        assert success(ego, other, folder=tmp_path, perceived=perceived).unseen == ()


def test_an_empty_scene_is_reported_to_have_no_closest_moment(tmp_path: Path) -> None:
    found = success(moving((20.0, 0.0, EAST, 10.0), key=0), folder=tmp_path)
    assert found.nearness_in_words() == "Closest: no other road user within 60 m."


def test_the_largest_motions_have_their_times(tmp_path: Path) -> None:
    felt = (9.0, *(0.0,) * 9, 1.5, *(0.0,) * 9, -4.0, *(0.0,) * 20)
    found = success(moving((20, 0, EAST, 10), key=0), folder=tmp_path, acceleration_mps2=felt)
    largest = {one.name: (one.value, one.time_s) for one in found.largest}
    assert largest == {"acceleration": (1.5, 1.0), "braking": (4.0, 2.0), "jerk": (pytest.approx(90.0), 0.1)}


@pytest.mark.parametrize(("speed", "braking", "limit"), [(3.0, 5.2, 5.0), (25.0, 3.6, 3.5), (12.5, 4.4, 4.25)])
def test_braking_is_compared_with_the_limit_at_its_speed(
    speed: float, braking: float, limit: float, tmp_path: Path
) -> None:
    felt = (*(0.0,) * 10, *(-braking,) * 31)
    found = success(moving((20, 0, EAST, speed), key=0), folder=tmp_path, acceleration_mps2=felt)
    excess = next(one for one in found.uncomfortable if one.name == "braking")
    assert (excess.value, excess.limit) == (pytest.approx(braking), pytest.approx(limit))
    assert (excess.window_s, excess.source) == (2.0, "ISO 15622:2018")
    gentle = tuple(value * (limit - 0.1) / braking for value in felt)
    calm = success(moving((20, 0, EAST, speed), key=0), folder=tmp_path, acceleration_mps2=gentle)
    assert "braking" not in {one.name for one in calm.uncomfortable}


def test_a_peak_shorter_than_the_window_does_not_exceed_the_limit(tmp_path: Path) -> None:
    felt = (*(0.0,) * 20, *(-6.0,) * 5, *(0.0,) * 16)
    found = success(moving((20, 0, EAST, 3.0), key=0), folder=tmp_path, acceleration_mps2=felt)
    assert "braking" not in {one.name for one in found.uncomfortable}


def test_a_tight_fast_turn_exceeds_the_lateral_limits(tmp_path: Path) -> None:
    ego = moving((20, 0, EAST, 10), key=0)
    heading = tuple(0.0 if step < 20 else 0.04 * (step - 20) for step in range(STEPS))
    found = success(ego.model_copy(update={"heading_rad": heading}), folder=tmp_path)
    excesses = {one.name: (one.value, one.limit, one.source) for one in found.uncomfortable}
    assert excesses["lateral acceleration"] == (pytest.approx(4.0), 3.0, "ISO 11270:2014")
    assert excesses["lateral jerk"] == (pytest.approx(8.0), 5.0, "UN R79")
    assert "lateral acceleration 4.0 m/s² at 2.1 s (limit 3, ISO 11270:2014)" in {
        one.in_words() for one in found.uncomfortable
    }


FOLLOWER, LEADER = (-4.4, 0.0, EAST, 14.0), (4.4, 0.0, EAST, 2.0)


@pytest.mark.parametrize(
    ("other", "changes", "laid_to"),
    [
        (FOLLOWER, {}, "recording"),
        (FOLLOWER, {"traffic": "reactive"}, "neither"),
        (LEADER, {"prediction": "ground_truth"}, "planning"),
        (LEADER, {}, None),
    ],
    ids=["recorded follower", "reactive follower", "known beforehand", "prediction unknown without the scenario"],
)
def test_a_collision_is_attributed_to_the_decisive_cause(
    other: Place, changes: dict[str, str], laid_to: str | None, tmp_path: Path
) -> None:
    found = reviewed(moving((0, 0, EAST, 10), key=0), moving(other), folder=tmp_path, **changes).contact
    assert found is not None
    assert found.laid_to == laid_to


@pytest.mark.parametrize(("braking_mps2", "laid_to"), [(0.0, "planning"), (9.0, "prediction")])
def test_predictions_are_compared_with_the_recording(braking_mps2: float, laid_to: str, tmp_path: Path) -> None:
    """A leader that drives on as predicted, and one that brakes hard in the last second."""
    ego, leader = moving((100, 0, EAST, 14), key=0), moving((104.4, 0, EAST, 10))
    late = [max(0.1 * step - 3.0, 0.0) for step in range(STEPS)]
    x = tuple(x + braking_mps2 * (0.5 - s**2 / 2) for x, s in zip(leader.x_m, late, strict=True))
    speeds = tuple(10.0 - braking_mps2 * s for s in late)
    leader = leader.model_copy(update={"x_m": x, "speed_mps": speeds})
    scenario = ScenarioSource(
        scenario_id="ZAM_Town-1_1_T-1", path=str(town_road().with_vehicles().write(tmp_path / "road.xml"))
    )
    found = reviewed(ego, leader, folder=tmp_path, scenario=scenario).contact
    assert found is not None
    assert found.laid_to == laid_to
    assert f"; attributed to {COLLISION_CAUSES[found.laid_to]};" in found.in_words()


def test_a_planner_that_ignores_others_is_not_excused_by_its_prediction(tmp_path: Path) -> None:
    found = reviewed(moving((0, 0, EAST, 10), key=0), moving(LEADER), folder=tmp_path, planner="keep_lane").contact
    assert found is not None
    assert found.laid_to == "planning"
