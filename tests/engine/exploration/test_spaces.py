"""The strata that a scenario offers to a search, and the operations on them, with fast planners on drawn roads."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commonroad.common.file_reader import CommonRoadFileReader
from support.builders import driving, town_road

from plannerforge.engine.execution import silent
from plannerforge.engine.exploration import Evaluator, concrete_edits, evaluate_in_space, open_space
from plannerforge.engine.exploration.evaluation import DrivenPoint
from plannerforge.engine.exploration.finding import is_same_failure, scored, shrunk
from plannerforge.engine.exploration.roads import write_road
from plannerforge.engine.exploration.spaces import values_at
from plannerforge.engine.tuning import preset_configuration
from plannerforge.schemas.exploration import Curve, EncounterSetting, Evaluation, LogicalScenario
from plannerforge.schemas.failures import (
    EvaluatedPoint,
    SearchSpace,
    ShrinkRequest,
    SpacePoint,
    SpacePointsRequest,
    SpaceRequest,
)


@pytest.fixture(scope="module")
def setting(tmp_path_factory: pytest.TempPathFactory) -> EncounterSetting:
    quiet = town_road().with_vehicles(
        driving(34, (280, 7), 11.0, 151, heading_rad=3.14159), driving(33, (70, 3.5), 9.0, 151)
    )
    path = quiet.write(tmp_path_factory.mktemp("base") / "town.xml")
    return EncounterSetting(xml=path, configuration=preset_configuration("keep_lane", None))


@pytest.fixture(scope="module")
def space(setting: EncounterSetting) -> SearchSpace:
    return open_space(SpaceRequest(setting=setting, base_id="ZAM_Town-1_1_T-1"), silent)


@pytest.fixture(scope="module")
def evaluator(setting: EncounterSetting) -> Iterator[Evaluator]:
    with Evaluator(setting) as opened:
        yield opened


def stratum_of(space: SearchSpace, name: str) -> LogicalScenario:
    return next(one for one in space.strata if one.name == name)


def evaluated(
    setting: EncounterSetting, space: SearchSpace, name: str, *shares: tuple[float, ...]
) -> tuple[EvaluatedPoint, ...]:
    points = tuple(SpacePoint(stratum=name, shares=one) for one in shares)
    request = SpacePointsRequest(setting=setting, strata=space.strata, points=points, recorded=space.recorded)
    return evaluate_in_space(request, silent).points


def test_recorded_and_added_road_users_have_strata_that_the_road_allows(space: SearchSpace) -> None:
    names = {stratum.name for stratum in space.strata}
    assert space.base.outcome == "safe"
    assert space.recorded == (33, 34)
    assert {
        "car 33 changes lane",
        "car 33 swerves",
        "pedestrian crosses from the right",
        "cyclist crosses from the left",
    } <= names
    assert {"car ahead brakes", "car stands ahead", "car cuts in from the left"} <= names
    assert "car cuts in from the right" not in names  # there is no such lane


def test_strata_survive_the_way_to_a_worker(space: SearchSpace) -> None:
    assert SearchSpace.model_validate_json(space.model_dump_json()) == space


def test_a_crossing_pedestrian_stands_at_the_kerb_first_and_is_timed_by_the_nominal_motion(
    setting: EncounterSetting, space: SearchSpace, evaluator: Evaluator
) -> None:
    stratum = stratum_of(space, "pedestrian crosses from the right")
    edits = concrete_edits(stratum, values_at(stratum, (0.5, 0.3, 0.5)))
    assert edits[0].duration_s is not None
    assert edits[0].duration_s > 0.3
    loaded = evaluator.edited(edits)
    assert loaded is not None
    walker = next(track for key, track in loaded.tracks.items() if key not in space.recorded)
    assert walker.first_step == 0
    assert walker.speeds_mps[0] == 0.0
    assert evaluator.evaluate(edits).counterpart_id == walker.obstacle_id  # a planner that never brakes arrives on time


def test_a_place_along_the_way_is_on_the_lanelet_that_contains_it(tmp_path: Path) -> None:
    path = write_road("crossing_straight", tmp_path / "road.xml")
    setting = EncounterSetting(xml=path, configuration=preset_configuration("keep_lane", None))
    space = open_space(SpaceRequest(setting=setting, base_id="road"), silent)
    derived = stratum_of(space, "pedestrian crosses from the right").derived
    lanelets, origins, driven = derived["lanelet"], derived["origin_m"], derived["along_m"]
    assert isinstance(lanelets, Curve)
    assert isinstance(origins, Curve)
    assert isinstance(driven, Curve)
    network = CommonRoadFileReader(str(path)).open()[0].lanelet_network
    assert len(lanelets.at) > 1
    for place in np.arange(0.0, float(driven.values[-1]), 0.2):
        station = float(place) + float(origins.value(float(place)))
        length = float(network.find_lanelet_by_id(int(lanelets.value(float(place)))).distance[-1])
        assert -0.1 <= station <= length + 0.1


def test_a_failure_far_from_the_sought_road_user_draws_no_search_towards_it(space: SearchSpace) -> None:
    hit_from_behind = Evaluation(outcome="failed_unavoidably", reason="hit from behind", counterpart_id=33, steps=9)
    far: Any = SimpleNamespace(traffic=SimpleNamespace(moving=(), standing=()), task=None, states=())
    stratum = stratum_of(space, "pedestrian crosses from the right")
    assert scored(stratum, DrivenPoint(hit_from_behind, far), space.recorded).value == 1.0


def test_the_score_tells_failures_from_near_and_far_misses_and_from_the_implausible(
    setting: EncounterSetting, space: SearchSpace
) -> None:
    hit, early = evaluated(setting, space, "cyclist crosses from the left", (0.5, 0.4, 0.5), (0.5, 1.0, 1.0))
    assert hit.score.value is not None
    assert hit.score.value < -1.0
    assert hit.score.cell is not None
    assert hit.score.cell.counterpart == "cyclist crosses from the left"
    assert early.evaluation.outcome == "safe"
    assert early.score.cell is None
    assert 0.0 <= (early.score.value or 0.0) <= 1.0


def test_a_failure_is_reduced_to_its_counterpart_and_stays_the_same(
    setting: EncounterSetting, space: SearchSpace, evaluator: Evaluator
) -> None:
    (hit,) = evaluated(setting, space, "car stands ahead", (0.2,))
    assert hit.evaluation.outcome == "failed_avoidably"
    request = ShrinkRequest(
        setting=setting, stratum=stratum_of(space, "car stands ahead"), point=hit.point, recorded=space.recorded
    )
    small = shrunk(evaluator, request, silent)
    assert small.road_users_before == 3
    assert small.road_users == 1
    assert small.kept == ()
    assert small.is_minimal
    assert small.runs <= 14
    assert small.duration_s is not None
    assert is_same_failure(hit.evaluation, small.evaluation)
    assert is_same_failure(evaluator.evaluate(small.edits), hit.evaluation)


def test_a_failure_is_reduced_to_the_part_of_the_map_that_it_needs(tmp_path: Path) -> None:
    path = write_road("crossing_lights", tmp_path / "crossing.xml")
    setting = EncounterSetting(xml=path, configuration=preset_configuration("keep_lane", None), horizon_s=6.0)
    space = open_space(SpaceRequest(setting=setting, base_id="crossing"), silent)
    stratum = stratum_of(space, "car stands ahead")
    point = SpacePoint(stratum=stratum.name, shares=(0.2,) * len(stratum.parameters))
    request = ShrinkRequest(setting=setting, stratum=stratum, point=point, recorded=space.recorded)
    with Evaluator(setting) as evaluator:
        small = shrunk(evaluator, request, silent)
        again = evaluator.evaluate(small.edits)
    assert small.area_m is not None
    assert 0 < small.lanelets < small.lanelets_before
    assert again == small.evaluation
    assert again.has_failed


def test_a_curve_interpolates_numbers_and_steps_through_texts() -> None:
    ramp = Curve(of="x", at=(0.0, 10.0, 20.0), values=(0.0, 5.0, 25.0))
    assert [ramp.value(place) for place in (-1.0, 5.0, 15.0, 30.0)] == [0.0, 2.5, 15.0, 25.0]
    names = Curve(of="x", at=(0.0, 10.0), values=("106", "107"), steps=True)
    assert [names.value(place) for place in (-5.0, 9.9, 10.0)] == ["106", "106", "107"]
    assert Curve.model_validate_json(names.model_dump_json()) == names


def test_a_base_that_fails_offers_nothing(tmp_path: Path) -> None:
    path = town_road().with_vehicles(driving(31, (70, 0), 0.0, 151)).write(tmp_path / "town.xml")
    setting = EncounterSetting(xml=path, configuration=preset_configuration("keep_lane", None))
    space = open_space(SpaceRequest(setting=setting, base_id="ZAM_Town-1_1_T-1"), silent)
    assert space.base.has_failed
    assert space.strata == ()
