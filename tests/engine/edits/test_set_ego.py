"""Edit G: set_ego."""

from dataclasses import replace

import numpy as np
import pytest
from support.builders import Problem, town_road
from support.edits import Applied, Apply, schema_errors

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.modification import ModifyScenarioResult

SHORT = town_road().cut(61)


def problem(applied: Applied) -> object:
    return read_scenario(applied.xml).problem(100)


def test_a_recorded_car_becomes_the_ego_and_leaves_the_traffic(apply: Apply) -> None:
    applied = apply({"op": "set_ego", "vehicles": ["35"]}, builder=SHORT)
    state = problem(applied).initial_state  # type: ignore[attr-defined]
    assert state.position == pytest.approx((165.0, 0.0))
    assert (state.velocity, state.orientation) == pytest.approx((8.0, 0.0))
    assert 35 not in applied.tracks()
    assert applied.outcome.removed == (35,)
    assert applied.changed_elements() == {"35", "100"}


def test_its_goal_is_where_its_recording_ends(apply: Apply) -> None:
    applied = apply({"op": "set_ego", "vehicles": ["35"]}, builder=SHORT)
    goal = problem(applied).goal.state_list[0]  # type: ignore[attr-defined]
    assert goal.position.center == pytest.approx((165.0 + 8.0 * 6.0, 0.0))
    assert goal.time_step.start <= 60 <= goal.time_step.end
    assert "lanelet 11" in applied.outcome.edits[0].what


def test_a_later_goal_applies(apply: Apply) -> None:
    goal = {"op": "set_goal", "to": ["13"], "goal_time": "<=15s"}
    applied = apply({"op": "set_ego", "vehicles": ["35"]}, goal, builder=SHORT)
    assert problem(applied).goal.state_list[0].position.center == pytest.approx((220.0, -99.99))  # type: ignore[attr-defined]


@pytest.mark.parametrize("former", ["vanish", None])
def test_the_former_ego_vanishes_unless_requested_otherwise(apply: Apply, former: str | None) -> None:
    applied = apply({"op": "set_ego", "vehicles": ["35"], "former_ego": former}, builder=SHORT)
    assert max(applied.tracks()) < 100


def test_the_former_ego_becomes_a_car_that_starts_where_it_stood(apply: Apply) -> None:
    applied = apply({"op": "set_ego", "vehicles": ["35"], "former_ego": "traffic"}, builder=SHORT)
    track = applied.tracks()[101]
    assert track.positions[0] == pytest.approx((40.0, 0.0))
    assert track.speeds_mps[0] == pytest.approx(10.0)
    assert track.positions[-1][0] > 80.0
    assert applied.outcome.edits[0].vehicles == (101,)


@pytest.mark.parametrize("who", ["nearest:1", "lead", "fastest"])
def test_the_former_ego_becomes_traffic_when_a_description_names_the_new_one(apply: Apply, who: str) -> None:
    applied = apply({"op": "set_ego", "vehicles": [who], "former_ego": "traffic"}, builder=SHORT)
    assert applied.outcome.edits[0].vehicles == (101,)
    assert len(applied.outcome.removed) == 1


def test_the_former_ego_can_be_edited_as_new(apply: Apply) -> None:
    swap = {"op": "set_ego", "vehicles": ["35"], "former_ego": "traffic"}
    tracks = apply(swap, {"op": "set_speed", "vehicles": ["new:0"], "speed": "2m/s"}, builder=SHORT).tracks()
    assert tracks[101].speeds_mps[-1] == pytest.approx(2.0, abs=0.2)


def test_another_start_keeps_goal_and_traffic(apply: Apply) -> None:
    applied = apply({"op": "set_ego", "at": "2", "position": "80m", "speed": "36km/h"}, builder=SHORT)
    state = problem(applied).initial_state  # type: ignore[attr-defined]
    assert state.position == pytest.approx((80.0, 3.5))
    assert state.velocity == pytest.approx(10.0)
    assert applied.changed_elements() == {"100"}
    assert schema_errors(applied.xml) <= schema_errors(applied.base)


def test_words_about_the_ego_are_about_the_new_one(apply: Apply) -> None:
    swap = {"op": "set_ego", "vehicles": ["31"]}
    applied = apply(swap, {"op": "remove_vehicle", "vehicles": ["lead"]}, builder=SHORT)
    assert applied.outcome.edits[1].vehicles == (35,)


def test_a_start_from_which_the_goal_cannot_be_reached_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="goal on lanelet 1 cannot be reached"):
        apply({"op": "set_ego", "at": "3", "position": "middle"}, builder=SHORT)
    goal = {"op": "set_goal", "to": ["3"]}
    assert apply({"op": "set_ego", "at": "3", "position": "middle"}, goal, builder=SHORT).outcome.edits[1].done


def test_an_occupied_start_is_refused_with_a_free_one(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="occupied by vehicle 31") as caught:
        apply({"op": "set_ego", "at": "1", "position": "70m"}, builder=SHORT)
    assert caught.value.valid[0].startswith("at=1 position=")


def test_the_former_ego_is_in_the_way_only_if_it_stays_as_traffic(apply: Apply) -> None:
    a_little_on = {"op": "set_ego", "at": "1", "position": "41m"}
    assert problem(apply(a_little_on, builder=SHORT)).initial_state.position == pytest.approx((41.0, 0.0))  # type: ignore[attr-defined]
    with pytest.raises(NotPossible, match="occupied by the ego"):
        apply(a_little_on | {"former_ego": "traffic"}, builder=SHORT)


def test_only_one_recorded_vehicle_can_be_the_ego(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="cannot become the ego") as caught:
        apply({"op": "set_ego", "vehicles": ["31", "35"]}, builder=SHORT)
    assert caught.value.valid == ("31", "32", "33", "34", "35")


def ego_class(applied: Applied) -> str:
    return read_scenario(applied.xml).ego_class(100)


def test_a_class_alone_leaves_the_start_as_it_is(apply: Apply) -> None:
    applied = apply({"op": "set_ego", "vehicle_class": "lorry"}, builder=SHORT)
    assert ego_class(applied) == "truck"
    assert applied.changed_elements() == {"100"}
    before, after = (path.read_text(encoding="utf-8") for path in (applied.base, applied.xml))
    written = '<?plannerforge ego-class="truck"?>'
    assert written in after
    assert [line for line in after.splitlines() if written not in line][2:] == before.splitlines()[2:]
    assert schema_errors(applied.xml) <= schema_errors(applied.base)


def test_the_ego_keeps_its_class_until_it_gets_another(apply: Apply) -> None:
    bus = {"op": "set_ego", "vehicle_class": "bus"}
    assert ego_class(apply(bus, {"op": "set_ego", "speed": "5m/s"}, builder=SHORT)) == "bus"
    assert ego_class(apply(bus, {"op": "set_ego", "vehicle_class": "car"}, builder=SHORT)) == "car"
    assert ego_class(apply(bus, {"op": "set_ego", "vehicles": ["31"]}, builder=SHORT)) == "car"


def test_an_ego_in_a_truck_s_place_is_a_truck(apply: Apply) -> None:
    applied = apply({"op": "set_ego", "vehicles": ["33"]}, builder=SHORT)
    assert ego_class(applied) == "truck"
    assert "truck, 7.1 × 2.4 m" in applied.outcome.edits[0].what
    other = apply({"op": "set_ego", "vehicles": ["33"], "vehicle_class": "motorcycle"}, builder=SHORT)
    assert ego_class(other) == "motorcycle"


def test_a_class_that_has_no_room_at_the_start_is_refused(apply: Apply) -> None:
    near = {"op": "set_ego", "at": "1", "position": "75.5m", "vehicle_class": "motorcycle"}
    assert ego_class(apply(near, builder=SHORT)) == "motorcycle"
    with pytest.raises(NotPossible, match="vehicle 31 is there") as caught:
        apply(near, {"op": "set_ego", "vehicle_class": "coach"}, builder=SHORT)
    assert caught.value.reason == "place_taken"


def test_a_bus_that_was_the_ego_drives_on_as_a_bus(apply: Apply) -> None:
    bus = {"op": "set_ego", "vehicle_class": "bus"}
    applied = apply(bus, {"op": "set_ego", "vehicles": ["35"], "former_ego": "traffic"}, builder=SHORT)
    former = applied.tracks()[101]
    assert (former.kind, former.size_m) == ("bus", (12.0, 2.5))


def test_a_goal_that_a_car_meets_and_the_ego_s_class_does_not_is_refused(apply: Apply) -> None:
    goal = {"op": "set_goal", "to": ["1"], "position": "130m", "goal_time": "<=3.2s"}
    assert apply(goal, builder=SHORT).outcome.edits[0].done
    with pytest.raises(NotPossible, match="no bus that starts at"):
        apply({"op": "set_ego", "vehicle_class": "bus"}, goal, builder=SHORT)


@pytest.mark.parametrize("edit", [{}, {"vehicles": ["31"], "speed": "3m/s"}])
def test_either_a_car_or_a_start_is_needed(apply: Apply, edit: dict[str, object]) -> None:
    with pytest.raises(InvalidRequest, match="a vehicle in 'vehicles', a start"):
        apply({"op": "set_ego", **edit}, builder=SHORT)


def test_the_former_ego_cannot_stay_at_the_ego_s_start(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="where the ego still starts") as caught:
        apply({"op": "set_ego", "speed": "5m/s", "former_ego": "traffic"}, builder=SHORT)
    assert "at=LANELET" in caught.value.valid
    away = {"op": "set_ego", "at": "2", "position": "80m", "speed": "5m/s", "former_ego": "traffic"}
    assert 101 in apply(away, builder=SHORT).tracks()


def test_untouched_recordings_stay(apply: Apply) -> None:
    applied = apply({"op": "set_ego", "vehicles": ["35"]}, builder=SHORT)
    old, new = applied.base_tracks(), applied.tracks()
    assert all(np.array_equal(old[key].positions, new[key].positions) for key in new)


@pytest.mark.parametrize(("name", "is_refused"), [("trailer", True), ("truck", False), ("car", False)])
def test_an_ego_that_the_planners_refuse_is_reported_in_advance(apply: Apply, name: str, is_refused: bool) -> None:
    outcome = apply({"op": "set_ego", "vehicle_class": name}, builder=SHORT).outcome
    assert bool(outcome.planners_refuse) is is_refused
    told = ModifyScenarioResult(
        scenario_id="ZAM_A-1_1_T-1",
        base_id="ZAM_B-1_1_T-1",
        edits=outcome.edits,
        touched=(),
        removed=(),
        handed_over=(),
        collisions=(),
        ego_before=None,
        ego_after=None,
        checked_by="closed_form",
        checkers_agree=None,
        untouched=0,
        planners_refuse=outcome.planners_refuse,
        warnings=(),
    ).answer()
    assert (told.next_step == "run_planner") is not is_refused
    assert (outcome.planners_refuse in told.warnings) is is_refused


@pytest.mark.parametrize(
    ("speed", "mps"), [("+2m/s", 12.0), ("-2m/s", 8.0), ("+10%", 11.0), ("50%", 5.0), ("7m/s", 7.0)]
)
def test_a_signed_speed_is_relative_to_the_ego_s_speed(apply: Apply, speed: str, mps: float) -> None:
    builder = replace(town_road(), problems=(Problem(start=(40.0, 0.0, 0.0, 10.0)),))
    applied = apply({"op": "set_ego", "speed": speed}, builder=builder)
    assert read_scenario(applied.xml).problem().initial_state.velocity == pytest.approx(mps)


def test_a_vehicle_without_an_earlier_speed_takes_no_relative_speed(apply: Apply) -> None:
    added = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 15.0}
    with pytest.raises(InvalidRequest) as refused:
        apply({**added, "speed": "+5m/s"})
    assert refused.value.remedies
    apply({**added, "speed": "5m/s"})


def test_a_goal_takes_no_relative_speed(apply: Apply) -> None:
    with pytest.raises(InvalidRequest):
        apply({"op": "set_goal", "to": ["2"], "goal_speed": "+5m/s"})
