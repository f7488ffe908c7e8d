"""Road users with a prescribed motion in reactive traffic: their triggers hold for the ego as it is driven."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.builders import Problem, ScenarioBuilder, Vehicle, driving, town_road
from support.planning import configuration

from plannerforge.engine.commonroad import Track, read_scenario
from plannerforge.engine.edits import apply_edits
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners import EgoState, run_planner
from plannerforge.engine.planners.registry import open_traffic
from plannerforge.engine.vehicles import BMW_320I
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.modification import Edit, ModificationOutcome, ModificationRequest
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import TriggerOutcome

_STEPS = 90
_EGO = Problem(start=(40.0, 0.0, 0.0, 10.0), goal=(190.0, 0.0, 8.0, 3.0), steps=(60, 150))
_LEAD = driving(31, (70.0, 0.0), 10.0, 120)


def edited(folder: Path, edits: Sequence[Mapping[str, object]], *vehicles: Vehicle) -> ModificationOutcome:
    builder: ScenarioBuilder = replace(town_road(), vehicles=vehicles or (_LEAD,), problems=(_EGO,))
    request = ModificationRequest(
        xml=builder.write(folder / "base.xml"),
        edits=tuple(Edit.model_validate(edit) for edit in edits),
        benchmark_id="ZAM_Builder-1_1_T-2",
        output=folder / "edited",
    )
    return apply_edits(request, silent)


def run(outcome: ModificationOutcome, speeds_mps: Sequence[float]) -> dict[int, Track]:
    """What the others do around an ego that drives straight on with a speed at each step."""
    assert outcome.xml is not None
    loaded = read_scenario(outcome.xml)
    problem = loaded.problem()
    ego = EgoState.of(problem.initial_state)
    with open_traffic("reactive", loaded, problem, BMW_320I, 0) as traffic:
        for speed in speeds_mps:
            ahead = np.array([speed * loaded.step_s, 0.0])
            ego = replace(ego, step=ego.step + 1, position=ego.position + ahead, speed_mps=speed)
            traffic.advance(ego)
        return {track.obstacle_id: track for track in traffic.driven}


def braking_step(track: Track) -> int | None:
    """The first step after which a vehicle has lost half a metre a second of its first speed."""
    slower = np.flatnonzero(track.speeds_mps < track.speeds_mps[0] - 0.5)
    return track.first_step + int(slower[0]) if len(slower) else None


_BRAKE = {"op": "set_speed", "vehicles": ["31"], "speed": "4m/s", "rate_mps2": 4.0}


@pytest.mark.parametrize(("speed_mps", "passes_at"), [(10.0, 40), (20.0, 20), (5.0, 80)])
def test_a_place_sets_off_the_braking_when_the_driven_ego_is_there(
    tmp_path: Path, speed_mps: float, passes_at: int
) -> None:
    outcome = edited(tmp_path, [{**_BRAKE, "when": "ego@1:80m"}])
    lead = run(outcome, [speed_mps] * _STEPS)[31]
    begun = braking_step(lead)
    assert begun is not None
    assert passes_at <= begun <= passes_at + 4


def test_a_time_gap_is_that_to_the_driven_ego(tmp_path: Path) -> None:
    outcome = edited(tmp_path, [{**_BRAKE, "when": "gap<=2.5s"}])
    # At first the lead is 2.8 s ahead; a slower ego falls back, and a faster one is 1.8 s behind it at once.
    assert braking_step(run(outcome, [5.0] * _STEPS)[31]) is None
    assert braking_step(run(outcome, [15.0] * _STEPS)[31]) is not None


def test_without_the_ego_no_trigger_fires_and_the_motion_is_the_recorded_one(tmp_path: Path) -> None:
    lead = run(edited(tmp_path, [{**_BRAKE, "when": "ego@1:80m"}]), [0.0] * _STEPS)[31]
    expected = np.array([pose[:2] for pose in _LEAD.poses])[: len(lead.positions)]
    assert np.allclose(lead.positions, expected, atol=1e-3)


def test_followers_react_to_a_triggered_motion(tmp_path: Path) -> None:
    follower = driving(33, (58.0, 0.0), 10.0, 120)
    outcome = edited(tmp_path, [{**_BRAKE, "when": "ego@1:50m"}], _LEAD, follower)
    others = run(outcome, [10.0] * 60)
    gaps = others[31].positions[:, 0] - others[33].positions[:, 0]
    assert braking_step(others[33]) is not None
    assert gaps.min() > 4.5


def test_a_second_trigger_acts_on_the_result_of_the_first(tmp_path: Path) -> None:
    edits = [
        {**_BRAKE, "when": "ego@1:60m"},
        {"op": "change_lane", "vehicles": ["31"], "lane": "left", "lateral_s": 2.0, "when": "ego@1:70m"},
    ]
    lead = run(edited(tmp_path, edits), [10.0] * _STEPS)[31]
    assert abs(float(lead.speeds_mps[-1]) - 4.0) < 0.3
    assert abs(float(lead.positions[-1][1]) - 3.5) < 0.3


def test_a_pedestrian_waits_at_the_kerb_until_the_driven_ego_is_near(tmp_path: Path) -> None:
    walker = {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "1", "position": "0.6", "when": "gap<=3s"}
    outcome = edited(tmp_path, [walker])
    key = outcome.edits[0].vehicles[0]
    never, soon = (run(outcome, [speed] * _STEPS)[key] for speed in (0.0, 15.0))
    assert np.allclose(never.positions, never.positions[0])
    assert float(np.linalg.norm(soon.positions[-1] - soon.positions[0])) > 1.0


def test_only_a_dodging_actor_stops_before_the_ego(tmp_path: Path) -> None:
    swerve = {"op": "swerve", "vehicles": ["32"], "side": "right", "offset_m": 3.5, "time_s": 1.0, "duration_s": 8.0}
    behind = driving(32, (12.0, 3.5), 14.0, 120)
    hits = {}
    for dodge in (True, None):
        folder = tmp_path / str(dodge)
        folder.mkdir()
        outcome = edited(folder, [{**swerve, "dodge": dodge}], _LEAD, behind)
        track = run(outcome, [4.0] * _STEPS).get(32)
        if dodge:
            assert track is not None
            ahead = 40.0 + 0.4 * (np.arange(len(track.positions)))
            apart = np.abs(track.positions[:, 0] - ahead)
            beside = np.abs(track.positions[:, 1])
            hits[dodge] = bool(((apart < 4.5) & (beside < 1.7)).any())
            assert abs(float(track.positions[-1][1])) < 1.0
        else:
            assert track is None, "a motion that does not depend on the ego is the file's"
    assert hits == {True: False}


def test_a_crop_fixes_the_motion_and_reports_it(tmp_path: Path) -> None:
    outcome = edited(tmp_path, [{**_BRAKE, "when": "ego@1:60m"}, {"op": "crop", "duration_s": 8.0}])
    assert outcome.xml is not None
    assert b"script=" not in outcome.xml.read_bytes()
    assert 31 not in run(outcome, [10.0] * 5)


def test_a_script_of_a_foreign_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    outcome = edited(tmp_path, [{**_BRAKE, "when": "ego@1:60m"}])
    assert outcome.xml is not None
    text = outcome.xml.read_text(encoding="utf-8")
    outcome.xml.write_text(text.replace('"first":0', '"first":-3'), encoding="utf-8")
    with pytest.raises(UnsafeInput):
        run(outcome, [10.0])


def driven_by_idm(outcome: ModificationOutcome) -> tuple[TriggerOutcome, ...]:
    request = RunRequest(
        run_id="run_0",
        scenario_path=str(outcome.xml),
        scenario_id="ZAM_Builder-1_1_T-2",
        configuration=configuration("idm:Default"),
        traffic="reactive",
    )
    return run_planner(request, silent).record.triggers


def test_a_run_records_when_a_trigger_fired(tmp_path: Path) -> None:
    (held,) = driven_by_idm(edited(tmp_path, [{**_BRAKE, "when": "ego@1:60m"}]))
    assert (held.obstacle_id, held.code, held.begins) == (31, "trigger_fired", "speed_change")
    assert held.time_s is not None
    assert 1.0 < held.time_s < 4.0


def test_a_trigger_that_never_fired_is_reported(tmp_path: Path) -> None:
    aside = {"op": "change_lane", "vehicles": ["31"], "lane": "left", "lateral_s": 2.0, "when": "ego@1:60m"}
    outcome = edited(tmp_path, [aside])
    assert outcome.xml is not None
    loaded = read_scenario(outcome.xml)
    ego = EgoState.of(loaded.problem().initial_state)
    with open_traffic("reactive", loaded, loaded.problem(), BMW_320I, 0) as traffic:
        for _ in range(5):
            ego = replace(ego, step=ego.step + 1, speed_mps=0.0)
            traffic.advance(ego)
        (never,) = traffic.triggers
    assert (never.code, never.begins, never.time_s) == ("trigger_not_fired", "lateral_motion", None)
    assert never.code in never.in_words()


def test_a_run_without_triggers_records_no_trigger(tmp_path: Path) -> None:
    assert driven_by_idm(edited(tmp_path, [_BRAKE])) == ()
