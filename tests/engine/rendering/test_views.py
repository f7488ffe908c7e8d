"""Views: their data say what the files say, the same bytes every time, and nothing in them gets out of their page."""

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from support.builders import town_road
from support.hostile import HOSTILE
from support.runs import DEFAULT, SAFE, driven, record, source

from plannerforge.engine.analysis import RunSet
from plannerforge.engine.commonroad import kept_recording
from plannerforge.engine.execution import silent
from plannerforge.engine.rendering import empty_page, filled_page, write_view
from plannerforge.engine.rendering.canvas import class_colour, outcome_colour
from plannerforge.engine.rendering.content import content_of
from plannerforge.engine.rendering.views.data import BoardView, DriveView, PlayerView, TrackView
from plannerforge.engine.rendering.views.scenes import track_view
from plannerforge.schemas.rendering import ViewKind, ViewPane, ViewRequest
from plannerforge.schemas.runs import (
    BatchRecord,
    DebugPolygon,
    Lineage,
    LostCell,
    Outcome,
    RunRecord,
    RunSeries,
    RunSource,
    ScenarioSource,
)

TOWN = "ZAM_Builder-1_1_T-1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("views")


@pytest.fixture(scope="module")
def town(folder: Path) -> ScenarioSource:
    return ScenarioSource(scenario_id=TOWN, path=str(town_road().write(folder / "town.xml")))


def player(folder: Path, *panes: ViewPane, title: str = "town") -> PlayerView:
    request = ViewRequest(kind="player", title=title, panes=panes, path=str(folder / "view.json"))
    written = write_view(request, silent)
    content = Path(written.path).read_bytes()
    assert written.size_bytes == len(content)
    return PlayerView.model_validate_json(content)


def collided(name: str = "frenetix:Default") -> RunRecord:
    return record(TOWN, "collision", DEFAULT, obstacle_id=31).model_copy(update={"config_name": name})


def driven_view(folder: Path, town: ScenarioSource, name: str = "frenetix:Default") -> DriveView:
    run = source(collided(name), folder, velocity_offset=3.0, prediction=0.3, jerk=0.0)
    (pane,) = player(folder, ViewPane(scenario=town, run=run)).panes
    assert pane.drive is not None
    return pane.drive


def positions_m(track: TrackView, origin: tuple[float, float]) -> np.ndarray:
    return np.cumsum([track.x_cm, track.y_cm], axis=1).T / 100 + origin


def test_tracks_are_where_the_file_has_them(folder: Path, town: ScenarioSource) -> None:
    (scene,) = player(folder, ViewPane(scenario=town)).scenes
    content = content_of(kept_recording(Path(town.path)))
    assert {track.obstacle_id for track in scene.tracks} == set(content.tracks)
    for track in scene.tracks:
        recorded = content.tracks[track.obstacle_id]
        assert (track.first_step, track.kind) == (recorded.first_step, recorded.kind)
        assert np.allclose(positions_m(track, scene.origin_m), recorded.positions, atol=0.0051)
        assert np.allclose(np.cumsum(track.speed_cmps) / 100, recorded.speeds_mps, atol=0.0051)
        turned = np.cumsum(track.heading_mrad) / 1000 - recorded.headings_rad
        assert np.allclose(np.exp(1j * turned), 1, atol=6e-4)


def test_road_has_every_lanelet_standing_obstacle_and_goal(folder: Path, town: ScenarioSource) -> None:
    (scene,) = player(folder, ViewPane(scenario=town)).scenes
    content = content_of(kept_recording(Path(town.path)))
    assert [one.lanelet_id for one in scene.road.lanelets] == [one.lanelet_id for one in content.lanelets]
    assert len(scene.road.standing) == len(content.standing)
    assert len(scene.road.goals) == len(content.goals)
    for drawn, lanelet in zip(scene.road.lanelets, content.lanelets, strict=True):
        outline = np.cumsum(np.reshape(drawn.outline, (-1, 2)), axis=0) / 100 + scene.origin_m
        assert np.allclose(outline.min(axis=0), lanelet.outline.min(axis=0), atol=0.03)
        assert np.allclose(outline.max(axis=0), lanelet.outline.max(axis=0), atol=0.03)


def test_thinned_track_keeps_every_third_state(town: ScenarioSource) -> None:
    track = next(iter(content_of(kept_recording(Path(town.path))).tracks.values()))
    thin = track_view(track, np.zeros(2), stride=3)
    assert thin.stride == 3
    assert np.allclose(positions_m(thin, (0.0, 0.0)), track.positions[::3], atol=0.0051)


def test_run_has_its_costs_moments_and_contact(folder: Path, town: ScenarioSource) -> None:
    drive = driven_view(folder, town)
    assert drive.costs == {"velocity_offset": (3.0,) * 14, "prediction": (0.3,) * 14}  # what is always 0 is left out
    assert (drive.collision_step, drive.collision_id) == (40, 31)
    assert [moment.step for moment in drive.moments if moment.decisive] == [40]
    assert [moment.step for moment in drive.moments] == sorted(moment.step for moment in drive.moments)
    assert np.cumsum(drive.ego.speed_cmps).tolist() == [1000] * 41
    assert len(drive.gap_cm) == len(drive.nearest) == len(drive.collision_cs) == len(drive.acceleration_cmps2) == 41
    assert ("mean speed", "10 m/s") in drive.figures


def test_run_has_its_series_and_the_debug_values_of_its_planner(tmp_path: Path, town: ScenarioSource) -> None:
    run = source(collided(), tmp_path, velocity_offset=3.0)
    planned = len(range(0, 41, 3))
    series = RunSeries(
        lateral_offset_m=(0.25,) * 41,
        heading_error_rad=(0.1,) * 41,
        steering_rad=(0.0,) * 41,
        desired_speed_mps=(9.0,) * planned,
        numbers={"gap_m": (None, *(5.0,) * (planned - 1))},
        texts={"why": ("free",) * planned},
        polygons=(DebugPolygon(step=3, name="corridor", x_m=(40.0, 60.0, 60.0), y_m=(-1.0, -1.0, 1.0)),),
    )
    assert run.steps_path is not None
    Path(run.steps_path).with_name("series.json").write_text(series.model_dump_json(), encoding="utf-8")
    shown = player(tmp_path, ViewPane(scenario=town, run=run))
    (drive,) = (pane.drive for pane in shown.panes)
    assert drive is not None
    assert drive.series["lateral offset (m)"] == (0.25,) * 41
    assert drive.series["heading error (°)"][0] == pytest.approx(5.73)
    assert drive.planned["desired speed (m/s)"] == (9.0,) * planned
    assert drive.planned["gap_m"][:2] == (None, 5.0)
    assert drive.told == {"why": ("free",) * planned}
    (area,) = drive.areas
    corners = np.cumsum(np.reshape(area.outline, (-1, 2)), axis=0) / 100 + shown.scenes[0].origin_m
    assert (area.step, area.name, corners.tolist()) == (3, "corridor", [[40.0, -1.0], [60.0, -1.0], [60.0, 1.0]])


def test_run_that_was_stored_without_series_is_shown_without(folder: Path, town: ScenarioSource) -> None:
    drive = driven_view(folder, town)
    assert (drive.series, drive.planned, drive.told, drive.areas) == ({}, {}, {}, ())


def test_reactive_traffic_is_shown_next_to_the_recording(folder: Path, town: ScenarioSource) -> None:
    run = source(record(TOWN, config=SAFE), folder, others=(driven(60.0, 0.0, 5.0),))
    (pane,) = player(folder, ViewPane(scenario=town, run=run)).panes
    assert pane.drive is not None
    assert [(track.obstacle_id, track.driven) for track in pane.drive.others] == [(7, True)]


def test_a_run_without_states_is_reported_and_its_scenario_shown(folder: Path, town: ScenarioSource) -> None:
    view = player(folder, ViewPane(scenario=town, run=source(record(TOWN, "invalid"))))
    assert view.panes[0].drive is None
    assert "has no driven states" in view.notes[0]


def test_two_panes_on_one_scenario_share_its_scene(folder: Path, town: ScenarioSource) -> None:
    runs = [source(record(TOWN, config=config), folder) for config in (DEFAULT, SAFE)]
    view = player(folder, *(ViewPane(scenario=town, run=run) for run in runs))
    assert len(view.scenes) == 1
    assert [pane.title for pane in view.panes] == ["frenetix:Default", "frenetix:Safe"]


def test_same_request_gives_the_same_bytes(folder: Path, town: ScenarioSource) -> None:
    pane = ViewPane(scenario=town, run=source(collided(), folder, velocity_offset=3.0))
    contents = []
    for name in ("first.json", "second.json"):
        write_view(ViewRequest(kind="player", title="town", panes=(pane,), path=str(folder / name)), silent)
        contents.append((folder / name).read_bytes())
    assert contents[0] == contents[1]


def batch(*runs: RunSource, batch_id: str = "batch_1", lost: tuple[LostCell, ...] = ()) -> BatchRecord:
    return BatchRecord(
        batch_id=batch_id,
        scenarios=(TOWN,),
        configs=tuple(dict.fromkeys(run.record.config_id for run in runs)),
        prediction="constant_velocity",
        traffic="recorded",
        runs=tuple(run.record.run_id for run in runs),
        lost=lost,
    )


def board(
    folder: Path, town: ScenarioSource, batches: tuple[BatchRecord, ...], *runs: RunSource, whole: bool = True
) -> BoardView:
    request = ViewRequest(
        kind="board", title="b", batches=batches, runs=runs, scenarios=(town,), whole=whole, path=str(folder / "b.json")
    )
    return BoardView.model_validate_json(Path(write_view(request, silent).path).read_bytes())


def test_a_board_has_a_column_for_each_configuration_and_lists_flips(folder: Path, town: ScenarioSource) -> None:
    runs = source(collided(), folder), source(record(TOWN, "goal_reached", SAFE), folder)
    lost = LostCell(scenario_id=TOWN, config_id="cfg_c", error="the worker died")
    view = board(folder, town, (batch(*runs, lost=(lost,)),), *runs)
    assert [column.title for column in view.columns] == ["frenetix:Default", "frenetix:Safe"]
    assert view.columns[0].outcomes == {"collision": 1}
    assert view.columns[1].success.startswith("1 of 1 valid runs reached the goal: 100%")
    assert [(run.row, run.column, run.flip) for run in view.runs] == [(0, 0, None), (0, 1, "to_success")]
    assert view.lost == (f"{TOWN} under cfg_c: the worker died",)
    speed = [metric.words for metric in view.metrics].index("mean speed")
    assert view.runs[0].values[speed] == 10.0


def test_a_board_has_the_intervals_of_an_analysis(folder: Path, town: ScenarioSource) -> None:
    runs = source(record(TOWN), folder), source(record("ZAM_Edited-1_1_T-2", "timeout"), folder)
    scenarios = (town, town.model_copy(update={"scenario_id": "ZAM_Edited-1_1_T-2"}))
    lineage = (Lineage(scenario_id="ZAM_Edited-1_1_T-2", ancestors=(TOWN,), edits=("remove_vehicle 2",)),)
    request = ViewRequest(
        kind="board",
        title="b",
        batches=(batch(*runs),),
        runs=runs,
        scenarios=scenarios,
        lineage=lineage,
        whole=False,
        path=str(folder / "b.json"),
    )
    view = BoardView.model_validate_json(Path(write_view(request, silent).path).read_bytes())
    success = RunSet(runs, lineage=lineage).rate(run.record for run in runs)
    assert success.low is not None
    assert success.high is not None
    assert f"{100 * success.low:.0f} to {100 * success.high:.0f}%" in view.columns[0].success


def test_a_complete_board_contains_its_player_s_data(folder: Path, town: ScenarioSource) -> None:
    runs = source(collided(), folder, velocity_offset=3.0), source(record(TOWN, config=SAFE), folder)
    whole = board(folder, town, (batch(*runs),), *runs)
    lean = board(folder, town, (batch(*runs),), *runs, whole=False)
    assert set(whole.drives) == {run.record.run_id for run in runs}
    assert [scene.scenario_id for scene in whole.scenes] == [TOWN]
    assert whole.drives[runs[0].record.run_id] == player(folder, ViewPane(scenario=town, run=runs[0])).panes[0].drive
    assert (lean.scenes, lean.drives) == ((), {})
    assert lean.runs == whole.runs


def test_two_batches_of_one_configuration_are_two_columns(folder: Path, town: ScenarioSource) -> None:
    runs = [source(record(TOWN, prediction=mode), folder) for mode in ("constant_velocity", "ground_truth")]
    batches = tuple(batch(run, batch_id=f"batch_{i}") for i, run in enumerate(runs))
    view = board(folder, town, batches, *runs, whole=False)
    assert [column.title for column in view.columns] == [
        "frenetix:Default, constant velocity, batch_0",
        "frenetix:Default, ground truth, batch_1",
    ]


def test_an_invalid_run_is_not_a_flip(folder: Path, town: ScenarioSource) -> None:
    runs = source(record(TOWN, "goal_reached")), source(record(TOWN, "invalid", SAFE))
    view = board(folder, town, (), *runs)
    assert [run.flip for run in view.runs] == [None, None]
    assert view.columns[1].success == "no run was possible"
    assert view.drives == {}  # no states were kept


class Tags(HTMLParser):
    """The tags of a page with their attributes, and the text inside scripts and the title."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {"script": [], "title": []}
        self._inside = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._inside = tag

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside in self.texts:
            self.texts[self._inside].append(data)


def test_hostile_names_stay_text_in_the_page(folder: Path, town: ScenarioSource) -> None:
    view = player(folder, ViewPane(scenario=town, run=source(collided(HOSTILE), folder)), title=HOSTILE)
    harmless, page = (Tags(filled_page("player", title, data)) for title, data in (
        ("town", "{}"),
        (HOSTILE, view.model_dump_json()),
    ))  # fmt: skip
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in harmless.tags]
    data, scripts = page.texts["script"]
    assert scripts == harmless.texts["script"][1]
    assert PlayerView.model_validate(json.loads(data)) == view
    assert "</script><script>window.broken=1</script>" in view.panes[0].title
    assert "\u202e" not in view.model_dump_json()


@pytest.mark.parametrize("kind", get_args(ViewKind))
def test_a_page_loads_no_address_and_runs_only_its_own_script(kind: ViewKind) -> None:
    page = filled_page(kind, "town", "{}")
    tags = Tags(page)
    assert not [tag for tag, attributes in tags.tags if {"src", "href", "srcset", "action"} & set(attributes)]
    loading = r"url\(|@import|\bfetch\(|XMLHttpRequest|WebSocket"
    assert not re.search(loading + r"|innerHTML|outerHTML|insertAdjacentHTML|eval\(", page)
    policy = next(str(attributes["content"]) for tag, attributes in tags.tags if "http-equiv" in attributes)
    digest = base64.b64encode(hashlib.sha256(tags.texts["script"][-1].encode()).digest()).decode()
    assert f"default-src 'none'; script-src 'sha256-{digest}'" in policy


def test_page_of_a_host_differs_in_title_policy_and_data_alone() -> None:
    empty, filled = empty_page("player"), filled_page("player", "PlannerForge", "")
    assert re.sub(r"<meta http-equiv.*?>", "", filled) == empty


def test_colours_match_those_of_the_pictures() -> None:
    style = re.search(r"<style>(.*?)</style>", empty_page("player"), re.DOTALL)
    assert style is not None
    pairs = re.findall(r"--([\w-]+): (?:light-dark\()?(#[0-9a-f]{6})", style[1])
    colours = {name: colour.upper() for name, colour in pairs}
    kinds = ("car", "taxi", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "priorityVehicle", "train")
    assert {kind: colours[kind] for kind in kinds} == {kind: class_colour(kind) for kind in kinds}
    outcomes = [one for one in get_args(Outcome) if one != "invalid"]  # lighter there, on white alone
    assert {outcome: colours[outcome] for outcome in outcomes} == {one: outcome_colour(one) for one in outcomes}
