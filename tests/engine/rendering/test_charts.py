"""Charts of causes, strata, distributions, cost terms and timelines: what they say in words is what the runs hold."""

from pathlib import Path

import pytest
from PIL import Image
from support.builders import driving, town_road
from support.runs import DEFAULT, SAFE, metrics, record, source

from plannerforge.engine.analysis import RunSet, course_of
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.rendering.charts import CHARTS
from plannerforge.engine.rendering.pictures import render
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.rendering import PictureKind, RenderRequest
from plannerforge.schemas.runs import RunRecord, RunSeries, RunSource, ScenarioSource

TOWN = "ZAM_Builder-1_1_T-1"


@pytest.fixture
def town(tmp_path: Path) -> ScenarioSource:
    """Car 31 drives at 5 m/s ahead of an ego at 10 m/s, which touches it between the steps 39 and 40."""
    ahead = town_road().with_vehicles(driving(31, (64.3, 0.0), 5.0, 151))
    return ScenarioSource(scenario_id=TOWN, path=str(ahead.write(tmp_path / "town.xml")))


@pytest.fixture
def hit(tmp_path: Path) -> RunSource:
    return source(record(TOWN, "collision", DEFAULT, obstacle_id=31), tmp_path, velocity_offset=3.0, prediction=1.0)


def words(kind: PictureKind, runs: tuple[RunSource, ...], *scenarios: ScenarioSource) -> str:
    return CHARTS[kind](RunSet(runs, (DEFAULT, SAFE), scenarios)).alt_text


def test_causes_state_kinds_and_the_number_of_unpreventable_collisions(hit: RunSource, town: ScenarioSource) -> None:
    text = words("causes", (hit, source(record(TOWN, config=SAFE))), town)
    assert "1 rear-end by the ego under Default (1 preventable)" in text
    assert "0 of 1 judged collisions not preventable" in text


def test_causes_without_a_collision_are_refused() -> None:
    with pytest.raises(NotPossible, match="no run ended in a collision"):
        words("causes", (source(record()),))


def test_strata_contain_every_valid_run_once_for_each_factor() -> None:
    names = [f"ZAM_T-{number}_1_T-1" for number in range(6)]
    known = [
        ScenarioSource(scenario_id=name, path="", road="highway" if number < 2 else "", density_per_km=10.0 * number)
        for number, name in enumerate(names)
    ]
    runs = tuple(source(record(name, "timeout" if name == names[0] else "goal_reached")) for name in names)
    text = words("strata", (*runs, source(record("ZAM_X-1_1_T-1", "invalid"))), *known)
    default = "frenetix:Default"
    for said in (f"highway: {default} 1 of 2", f"road unknown: {default} 4 of 4", f"0 vehicles/km: {default} 0 of 1"):
        assert said in text
    busier = f"under 20/km: {default} 1 of 1; 20 to 50/km: {default} 3 of 3; 50/km and more: {default} 1 of 1"
    assert busier in text


def test_strata_of_runs_that_do_not_differ_are_refused() -> None:
    with pytest.raises(NotPossible, match="do not differ"):
        words("strata", (source(record()),))


def measured(number: int, config: object, value: float) -> RunRecord:
    figures = metrics(minimum_distance_m=value, minimum_time_headway_s=None)
    return record(f"ZAM_T-{number}_1_T-1", config=config, figures=figures)  # type: ignore[arg-type]


def test_distributions_give_the_median_of_each_configuration() -> None:
    before = [source(measured(number, DEFAULT, value)) for number, value in enumerate((1.0, 2.0, 100_115.84))]
    after = [source(measured(number, SAFE, value)) for number, value in enumerate((1.5, 2.5, 3.5))]
    text = words("distributions", (*before, *after))
    assert "medians for frenetix:Default | frenetix:Safe: minimum distance 2 | 2.5 m" in text
    assert "headway" not in text
    assert "mean total cost" not in text  # means nothing across configurations


def test_a_value_far_out_does_not_stretch_the_axis() -> None:
    values = [*(1.0 + 0.1 * number for number in range(20)), 100_115.84]
    drawing = CHARTS["distributions"](
        RunSet(tuple(source(measured(number, DEFAULT, value)) for number, value in enumerate(values)))
    )
    axes = next(one for one in drawing.figure.axes if one.get_title("left").startswith("minimum distance"))
    assert axes.get_xlim()[1] < 4
    assert "1 outliers" in axes.get_title("left")


def test_terms_are_of_one_run_with_their_mean_shares(hit: RunSource, town: ScenarioSource) -> None:
    drawing = CHARTS["terms"](RunSet((source(record(TOWN, config=SAFE)), hit), (), (town,)))
    assert "mean shares: velocity_offset 75%, prediction 25%" in drawing.alt_text
    assert hit.record.run_id in drawing.alt_text


def test_timeline_marks_the_contact_and_the_last_moment_to_brake(hit: RunSource, town: ScenarioSource) -> None:
    text = words("timeline", (hit,), town)
    assert "ran into the back of car 31 at 4.0 s" in text
    assert "full braking prevents the collision" in text


def labels_of_timeline(hit: RunSource, town: ScenarioSource) -> list[str]:
    drawing = CHARTS["timeline"](RunSet((hit,), (), (town,)))
    return [axes.get_ylabel().replace("\n", " ") for axes in drawing.figure.axes]


def test_timeline_of_a_run_with_series_has_its_place_on_the_route(tmp_path: Path, town: ScenarioSource) -> None:
    run = source(record(TOWN, "collision", DEFAULT, obstacle_id=31), tmp_path, velocity_offset=3.0)
    assert "offset from the route [m]" not in labels_of_timeline(run, town)
    series = RunSeries(
        lateral_offset_m=(0.2,) * 41,
        heading_error_rad=(0.01,) * 41,
        steering_rad=(0.02,) * 41,
        desired_speed_mps=(9.0,) * len(range(0, 41, 3)),
    )
    assert run.steps_path is not None
    Path(run.steps_path).with_name("series.json").write_text(series.model_dump_json(), encoding="utf-8")
    labels = labels_of_timeline(run, town)
    assert "offset from the route [m]" in labels
    assert "heading error, steering [°]" in labels


def test_timeline_draws_an_axis_of_times_to_collision_only_if_it_has_a_curve(
    hit: RunSource, tmp_path: Path, town: ScenarioSource
) -> None:
    assert any("time to collision" in label for label in labels_of_timeline(hit, town))
    alone = source(record("ZAM_Alone-1_1_T-1"), tmp_path, velocity_offset=3.0)
    drawing = CHARTS["timeline"](RunSet((alone,), (), ()))
    assert not any("time to collision" in axes.get_ylabel() for axes in drawing.figure.axes)


def test_course_is_as_near_as_the_rectangles_are(hit: RunSource, town: ScenarioSource) -> None:
    course = course_of(RunSet((hit,), (), (town,)), hit.record)
    assert course is not None
    assert len(course.time_s) == len(course.gap_m) == 41
    # 64.3 − 40 m between the centres, half of 4.508 m and of 4.5 m less, and 5 m/s nearer
    assert course.gap_m[20] == pytest.approx(24.3 - 4.504 - 5.0 * 2.0, abs=0.01)
    assert course.time_to_collision_s[20] == pytest.approx(course.gap_m[20] / 5.0, abs=0.01)
    assert (course.obstacle_ids[20], course.gap_m[40]) == (31, 0.0)


def test_charts_of_runs_without_steps_are_refused() -> None:
    for kind, refused in (("terms", "no cost terms were recorded"), ("timeline", "no recorded steps")):
        with pytest.raises(NotPossible, match=refused):
            CHARTS[kind](RunSet((source(record()),)))


def test_an_animation_is_slower_around_the_collision_and_says_so(
    tmp_path: Path, hit: RunSource, town: ScenarioSource
) -> None:
    request = RenderRequest(kind="animation", runs=(hit,), scenarios=(town,), folder=str(tmp_path))
    image = render(request, silent).images[0]
    assert "1/4 speed around 4.0 s (collision with car 31)" in image.alt_text
    durations = []
    with Image.open(image.path) as opened:
        for frame in range(opened.n_frames):  # type: ignore[attr-defined]
            opened.seek(frame)
            durations.append(opened.info["duration"])
    assert durations[:30] == [100] * 30
    assert durations[30:-1] == [400] * 10
    assert durations[-1] == 1500


def test_an_animation_slows_at_the_closest_encounter_of_a_run_without_a_collision(
    tmp_path: Path, town: ScenarioSource
) -> None:
    run = source(record(TOWN, figures=metrics(minimum_distance_m=0.0)), tmp_path)
    image = render(RenderRequest(kind="animation", runs=(run,), scenarios=(town,), folder=str(tmp_path)), silent)
    assert "speed around" in image.images[0].alt_text
    assert "closest: 0.00 m to car 31" in image.images[0].alt_text
