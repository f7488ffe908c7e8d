"""Pictures, animations and charts: sizes, the same bytes every time, everything named."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
from PIL import Image
from support.builders import Problem, town_road
from support.runs import DEFAULT, SAFE, record, source

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.rendering.charts import CHARTS
from plannerforge.engine.rendering.pictures import render
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName
from plannerforge.schemas.rendering import REPORT_PICTURES, PictureKind, RenderedImage, RenderRequest
from plannerforge.schemas.runs import RunSource, ScenarioSource

TOWN = "ZAM_Builder-1_1_T-1"


@pytest.fixture
def town(tmp_path: Path) -> ScenarioSource:
    return ScenarioSource(scenario_id=TOWN, path=str(town_road().write(tmp_path / "town.xml")))


@pytest.fixture
def pair(tmp_path: Path) -> tuple[RunSource, RunSource]:
    hit = source(record(TOWN, "collision", DEFAULT, obstacle_id=31), tmp_path, velocity_offset=3.0, prediction=0.3)
    return hit, source(record(TOWN, "goal_reached", SAFE), tmp_path, velocity_offset=2.0, distance_to_obstacles=1.0)


def drawn(folder: Path, **changes: object) -> RenderedImage:
    folder.mkdir(exist_ok=True)
    request = RenderRequest.model_validate({"kind": "auto", "folder": str(folder)} | changes)
    return render(request, silent).images[0]


def test_picture_names_every_vehicle_and_is_small(tmp_path: Path, town: ScenarioSource) -> None:
    image = drawn(tmp_path / "out", scenarios=(town,))
    assert image.mime_type == "image/png"
    assert image.width_px >= 1000
    assert image.size_bytes < 300_000
    assert "4 vehicles in view, 1 outside, labels: 31, 32, 33, 35" in image.alt_text


def test_colours_that_mean_something_are_exact(tmp_path: Path, town: ScenarioSource) -> None:
    path = Path(drawn(tmp_path / "out", scenarios=(town,)).path)
    with Image.open(path) as opened:
        colours = {colour for _, colour in opened.convert("RGB").getcolors(1 << 20) or []}
    # white, road, ego, car, truck
    assert {(255, 255, 255), (228, 228, 228), (213, 94, 0), (86, 180, 233), (0, 158, 115)} <= colours


@pytest.mark.parametrize(
    "kind", ["picture", "causes", "distributions", "terms", "timeline", "outcomes", "costs", "flips", "profile"]
)
def test_pictures_and_charts_are_the_same_bytes_again(
    tmp_path: Path, town: ScenarioSource, pair: tuple[RunSource, RunSource], kind: str
) -> None:
    given = {"kind": kind, "scenarios": (town,), "runs": pair, "configs": (DEFAULT, SAFE)}
    first, second = drawn(tmp_path / "a", **given), drawn(tmp_path / "b", **given)
    assert Path(first.path).read_bytes() == Path(second.path).read_bytes()
    assert first.width_px >= 1000
    assert first.size_bytes < 300_000
    assert len(first.alt_text) > 40


def test_runs_are_named_with_their_outcome(
    tmp_path: Path, town: ScenarioSource, pair: tuple[RunSource, RunSource]
) -> None:
    image = drawn(tmp_path / "out", scenarios=(town,), runs=pair)
    assert "at 4.0 s" in image.alt_text
    assert "driven paths: Default (collision), Safe (goal reached)" in image.alt_text


def test_an_animation_moves_and_ends_with_the_run_and_a_strip_shows_its_moments(
    tmp_path: Path, town: ScenarioSource, pair: tuple[RunSource, RunSource]
) -> None:
    request = RenderRequest(kind="animation", scenarios=(town,), runs=pair[:1], folder=str(tmp_path))
    gif, strip = render(request, silent).images
    again = drawn(tmp_path / "again", kind="animation", scenarios=(town,), runs=pair[:1])
    assert Path(gif.path).read_bytes() == Path(again.path).read_bytes()
    assert (gif.mime_type, strip.mime_type) == ("image/gif", "image/png")
    assert gif.size_bytes < 2_000_000
    with Image.open(gif.path) as opened:
        assert opened.n_frames == 41  # type: ignore[attr-defined]
        assert opened.info["duration"] == 100
        first = opened.convert("RGB").tobytes()
        opened.seek(40)
        assert opened.convert("RGB").tobytes() != first
    assert strip.alt_text == "Still frames at 0.0, 0.8, 1.6, 2.4, 3.2, 4.0 s, row by row."
    assert strip.width_px == pytest.approx(1500, abs=3)
    assert strip.size_bytes < 400_000
    with Image.open(strip.path) as opened:
        row = opened.convert("RGB").crop((0, 0, opened.width, opened.height // 2))
        thirds = [row.crop((i * row.width // 3, 0, (i + 1) * row.width // 3, row.height)).tobytes() for i in range(3)]
    assert len(set(thirds)) == 3


def test_long_recordings_are_thinned_to_few_frames(tmp_path: Path, town: ScenarioSource) -> None:
    image = drawn(tmp_path / "out", kind="animation", scenarios=(town,))
    with Image.open(image.path) as opened:
        assert opened.n_frames <= 60  # type: ignore[attr-defined]


def test_two_scenarios_are_shown_side_by_side(tmp_path: Path, town: ScenarioSource) -> None:
    other = town.model_copy(update={"scenario_id": "ZAM_Other-1_1_T-1"})
    image = drawn(tmp_path / "out", scenarios=(town, other))
    assert image.width_px == 1500
    assert "Next to it:" in image.alt_text


def test_side_by_side_everything_that_differs_is_in_view(tmp_path: Path, town: ScenarioSource) -> None:
    other = town_road().with_vehicles(*(one for one in town_road().vehicles if one.vehicle_id != 34))
    removed = ScenarioSource(scenario_id="removed", path=str(other.write(tmp_path / "removed.xml")))
    far = replace(town_road(), problems=(Problem(goal=(290.0, 0.0, 8.0, 3.0)),))
    moved = ScenarioSource(scenario_id="moved", path=str(far.write(tmp_path / "moved.xml")))
    image = drawn(tmp_path / "out", kind="picture", scenarios=(town, removed))
    assert image.alt_text.count("34") == 1
    assert "5 vehicles in view" in image.alt_text
    with Image.open(drawn(tmp_path / "goal", kind="picture", scenarios=(town, moved)).path) as opened:
        after = opened.convert("RGB").crop((opened.width // 2, 62, opened.width, opened.height - 40))
        rightmost = max(x for x in range(after.width) for y in range(after.height) if is_orange(after.getpixel((x, y))))
    assert rightmost > after.width * 0.8


def is_orange(pixel: tuple[int, int, int]) -> bool:
    return pixel[0] > 190 and pixel[1] < 160 and pixel[2] < 110


def test_auto_chooses_outcomes_for_several_scenarios(tmp_path: Path, town: ScenarioSource) -> None:
    runs = (source(record("ZAM_A-1_1_T-1")), source(record("ZAM_B-1_1_T-1")))
    for given, kind in ((runs, "outcomes"), (runs[:1], "picture")):
        image = drawn(tmp_path, scenarios=(town,), runs=given, configs=(DEFAULT,))
        assert Path(image.path).name == f"{kind}.png"


@pytest.mark.parametrize("kind", sorted(CHARTS))
def test_charts_without_runs_are_refused(tmp_path: Path, town: ScenarioSource, kind: str) -> None:
    with pytest.raises(NotPossible, match=r"no run or batch"):
        drawn(tmp_path, kind=kind, scenarios=(town,))


def test_a_picture_is_of_the_surroundings_of_a_road_user(tmp_path: Path, town: ScenarioSource) -> None:
    ego, other = (
        drawn(tmp_path / name, scenarios=(town,), focus=focus, time_s=1.0)
        for name, focus in (("ego", None), ("35", 35))
    )
    assert "35" in other.alt_text.partition("labels:")[2]
    assert other.alt_text != ego.alt_text
    assert Path(other.path).read_bytes() != Path(ego.path).read_bytes()


def test_an_absent_road_user_is_refused_with_the_present_ones(tmp_path: Path, town: ScenarioSource) -> None:
    with pytest.raises(UnknownName) as caught:
        drawn(tmp_path / "out", scenarios=(town,), focus=99)
    assert "31" in caught.value.valid


def test_a_moment_after_the_end_is_refused(tmp_path: Path, town: ScenarioSource) -> None:
    with pytest.raises(InvalidRequest, match=r"ends at 15\.0 s at the latest"):
        drawn(tmp_path, scenarios=(town,), time_s=99.0)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["DEU_A99-1_2_T-1", "BEL_Antwerp-1_9_T-1", "ZAM_Zip-1_6_T-1"])
def test_real_scenarios_are_drawn(tmp_path: Path, shared_data: Path, name: str) -> None:
    path = shared_data / "data" / "commonroad" / f"{name}.xml"
    image = drawn(tmp_path, scenarios=(ScenarioSource(scenario_id=name, path=str(path)),))
    assert image.size_bytes < 300_000
    assert "in view" in image.alt_text


def test_every_kind_that_can_be_requested_is_drawn() -> None:
    of_scenarios, of_a_study, of_a_map = {"auto", "picture", "animation"}, {"search"}, {"boundary"}
    assert of_scenarios | of_a_study | of_a_map | set(CHARTS) == set(get_args(PictureKind))


def test_a_report_has_a_place_for_every_chart_and_for_the_run_from_above() -> None:
    assert set(REPORT_PICTURES) == set(CHARTS) | {"picture", "animation"}
