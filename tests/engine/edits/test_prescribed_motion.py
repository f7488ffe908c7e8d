"""Edits whose motion is prescribed: it comes out as asked, others react to it, and it survives reactive traffic."""

import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.builders import Problem, driving, town_road
from support.edits import Apply, apply_to

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.edits import scripted
from plannerforge.engine.edits.explanations import why_missed
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.registry import open_traffic
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.modification import EditReport

ALONE = town_road().with_vehicles(driving(31, (70, 0), 10.0, 101))
BESIDE = town_road().with_vehicles(driving(33, (50, 3.5), 12.0, 121))


def test_a_speed_is_reached_by_the_prescribed_braking(apply: Apply) -> None:
    braking = {"op": "set_speed", "vehicles": ["31"], "speed": "2m/s", "rate_mps2": 5.0, "time_s": 2.0}
    applied = apply(braking, builder=ALONE)
    speeds = applied.tracks()[31].speeds_mps
    assert speeds[20] == pytest.approx(10.0, abs=0.3)
    assert speeds[-1] == pytest.approx(2.0, abs=0.1)
    assert np.diff(speeds).min() / 0.1 == pytest.approx(-5.0, abs=0.5)
    assert applied.outcome.touched[0].feasible


def test_a_share_of_its_speed_is_driven_along_its_way(apply: Apply) -> None:
    track = apply({"op": "set_speed", "vehicles": ["31"], "speed": "+20%"}, builder=ALONE).tracks()[31]
    assert track.speeds_mps[-1] == pytest.approx(12.0, abs=0.2)


def test_a_lane_change_lasts_the_prescribed_time(apply: Apply) -> None:
    aside = {"op": "change_lane", "vehicles": ["31"], "lane": "left", "time_s": 2.0, "lateral_s": 4.0}
    places = apply(aside, builder=ALONE).tracks()[31].positions[:, 1]
    assert places[20] == pytest.approx(0.0, abs=0.1)
    assert places[42] == pytest.approx(1.75, abs=0.3)
    assert places[62] == pytest.approx(3.5, abs=0.1)


def test_a_swerve_returns(apply: Apply) -> None:
    swerve = {"op": "swerve", "vehicles": ["31"], "side": "right", "offset_m": 0.8, "time_s": 2.0}
    places = apply(swerve, builder=ALONE).tracks()[31].positions[:, 1]
    assert places.min() == pytest.approx(-0.8, abs=0.1)
    assert places[-1] == pytest.approx(0.0, abs=0.1)


def test_a_cut_in_ends_with_the_requested_gap(apply: Apply) -> None:
    edit = {"op": "cut_in", "vehicles": ["33"], "gap_s": 1.2, "lateral_s": 3.0, "time_s": 3.0}
    applied = apply(edit, builder=BESIDE)
    track, report = applied.tracks()[33], applied.outcome.edits[0]
    gap = next(one for one in report.achieved if one.unit == "s")
    assert report.verdict == "done"
    assert gap.value == pytest.approx(1.2, abs=0.1)
    assert track.positions[60][1] == pytest.approx(0.0, abs=0.3)
    assert track.positions[28][1] > 3.0


@pytest.mark.parametrize(("speed_mps", "units"), [(0.2, ["m"]), (10.0, ["s", "m"])])
def test_a_time_gap_to_a_standing_vehicle_is_not_reported_as_reached(
    apply: Apply, speed_mps: float, units: list[str]
) -> None:
    tracks = apply({"op": "set_speed", "vehicles": ["31"], "speed": "9m/s"}, builder=ALONE).base_tracks()
    ahead, behind = tracks[31], replace(tracks[31], obstacle_id=32, positions=tracks[31].positions - [19.5, 0.0])
    behind = replace(behind, speeds_mps=np.full(len(behind.positions), speed_mps))
    replays = {31: SimpleNamespace(track=ahead)}
    edited: Any = SimpleNamespace(changes=SimpleNamespace(replays=replays), road_users={32: behind})
    path: Any = SimpleNamespace(line=np.array([[0.0, 0.0], [300.0, 0.0]]))
    found: Any = SimpleNamespace(last=20)
    told = scripted._cut_in_achieved(edited, 31, behind, path, found, 1.5)
    assert [one.unit for one in told] == units
    assert all(one.reached for one in told) == (len(units) == 2)
    assert (why_missed(told) is None) == (len(units) == 2)


def test_an_edit_is_done_if_it_succeeds_for_one_of_its_vehicles() -> None:
    missed = scripted.missed(31, "lines crossed", "it stands")
    crossed = scripted.achieved(32, "crossing at red", None, 4.0, "s")
    short = scripted.achieved(31, "gap", 1.5, 1.2, "s")
    assert why_missed([missed]) is not None
    assert why_missed([missed, crossed]) is None
    assert not short.reached
    assert why_missed([short]) is None
    told = EditReport(index=0, op="cut_in", letter="T", done=False, what="", vehicles=(31,), achieved=(missed,))
    assert told.verdict == "off target"


def test_a_cut_in_from_a_farther_lane_names_the_vehicles_alongside(apply: Apply) -> None:
    both = BESIDE.with_vehicles(*BESIDE.vehicles, driving(31, (70, 0), 10.0, 101))
    with pytest.raises(NotPossible) as refusal:
        apply({"op": "cut_in", "vehicles": ["31"]}, builder=both)
    assert refusal.value.valid == ("vehicles=['33']",)


def test_a_vehicle_moves_to_the_oncoming_lane(apply: Apply) -> None:
    places = apply({"op": "wrong_way", "vehicles": ["33"], "time_s": 2.0}, builder=BESIDE).tracks()[33].positions[:, 1]
    assert places[-1] == pytest.approx(7.0, abs=0.2)


def test_a_vehicle_is_put_in_that_drives_against_its_lane(apply: Apply) -> None:
    applied = apply({"op": "wrong_way", "at": "2", "position": "0.9", "speed": "10m/s"}, builder=ALONE)
    (key,) = applied.outcome.edits[0].vehicles
    track = applied.tracks()[key]
    assert abs(abs(track.headings_rad[0]) - np.pi) < 1e-6
    assert track.positions[0][0] - track.positions[-1][0] == pytest.approx(100.0, abs=2.0)


def test_the_follower_reacts_to_prescribed_braking(apply: Apply) -> None:
    close = ALONE.with_vehicles(*ALONE.vehicles, driving(32, (55, 0), 10.0, 101))
    braking = {"op": "set_speed", "vehicles": ["31"], "speed": "0m/s", "rate_mps2": 6.0, "time_s": 4.0}
    applied = apply(braking, builder=close, traffic="reactive")
    assert applied.outcome.handed_over == (32,)
    assert not applied.outcome.collisions
    assert applied.tracks()[31].speeds_mps[-1] == 0.0


def test_prescribed_motion_survives_the_reactive_traffic_of_a_run(tmp_path: Path) -> None:
    problem = Problem(start=(10.0, 0.0, 0.0, 10.0), goal=(190.0, 0.0, 8.0, 3.0))
    base = replace(ALONE, problems=(problem,)).write(tmp_path / "base.xml")
    slow = {"op": "set_speed", "vehicles": ["31"], "speed": "2m/s"}
    applied = apply_to(base, tmp_path / "out", slow)
    loaded = read_scenario(applied.xml)
    ego = EgoState.of(loaded.problem().initial_state)
    with warnings.catch_warnings(), open_traffic("reactive", loaded, loaded.problem(), BMW_320I, seed=0) as traffic:
        warnings.simplefilter("ignore")
        for step in range(1, 60):
            traffic.advance(replace(ego, step=ego.step + step))
    assert traffic.on_recording == (31,)


def test_infeasible_motions_are_refused(apply: Apply) -> None:
    with pytest.raises(InvalidRequest):
        apply({"op": "set_speed", "vehicles": ["31"], "speed": "2m/s", "rate_mps2": 40.0}, builder=ALONE)


def test_a_reroute_after_a_prescribed_motion_is_refused(apply: Apply) -> None:
    swerve = {"op": "swerve", "vehicles": ["31"], "time_s": 2.0}
    with pytest.raises(NotPossible):
        apply(swerve, {"op": "reroute", "vehicles": ["31"], "to": ["13"]}, builder=ALONE)


@pytest.mark.parametrize(("trigger", "step"), [("gap<=4s", 0), ("ego@1:60m", 20), ("gap <= 0.1 s", 100)])
def test_a_trigger_is_looked_up_on_the_drive_of_the_ego(apply: Apply, trigger: str, step: int) -> None:
    road = town_road().with_vehicles(driving(31, (75, 0), 10.0, 121))
    braking = {"op": "set_speed", "vehicles": ["31"], "speed": "4m/s", "rate_mps2": 3.0, "when": trigger}
    if step == 100:
        with pytest.raises(NotPossible):
            apply(braking, builder=road)
        return
    speeds = apply(braking, builder=road).tracks()[31].speeds_mps
    first = int(np.argmax(speeds < 9.7))
    assert step - 1 <= first <= step + 6


def test_a_pedestrian_steps_out_when_the_ego_is_near(apply: Apply) -> None:
    walker = {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "1", "position": "0.7", "when": "gap<=3s"}
    applied = apply(walker, builder=ALONE)
    (key,) = applied.outcome.edits[0].vehicles
    assert 30 < applied.tracks()[key].first_step < 100
