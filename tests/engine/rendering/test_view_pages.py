"""The pages of views in a real browser: keys, clicks, and that hostile text does nothing there."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.builders import town_road
from support.hostile import HOSTILE
from support.runs import DEFAULT, SAFE, record, source

from benchmarks.serve.browser import Browser, Page, chromium, find_chromium
from plannerforge.engine.execution import silent
from plannerforge.engine.rendering import empty_page, filled_page, write_view
from plannerforge.schemas.planning import RunPlans, ShownPlan
from plannerforge.schemas.rendering import ViewPane, ViewRequest
from plannerforge.schemas.runs import DebugPolygon, RunSeries, RunSource, ScenarioSource

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="Chromium is not installed")
TOWN = "ZAM_Builder-1_1_T-1"
PLAYER = "document.querySelector('.player').player"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def town(folder: Path) -> ScenarioSource:
    return ScenarioSource(scenario_id=TOWN, path=str(town_road().write(folder / "town.xml")))


def opened(browser: Browser, folder: Path, title: str, *panes: ViewPane, scheme: str = "light") -> Page:
    request = ViewRequest(kind="player", title=title, panes=panes, path=str(folder / "view.json"))
    data = Path(write_view(request, silent).path).read_text(encoding="utf-8")
    file = folder / "page.html"
    file.write_text(filled_page("player", title, data), encoding="utf-8")
    page = browser.open(file.as_uri(), scheme=scheme)
    page.wait_for("document.querySelector('.player')")
    return page


def opened_board(browser: Browser, folder: Path, town: ScenarioSource, *runs: RunSource) -> Page:
    path = str(folder / "board.json")
    request = ViewRequest(kind="board", title="two runs", runs=runs, scenarios=(town,), path=path)
    file = folder / "board.html"
    data = Path(write_view(request, silent).path).read_text(encoding="utf-8")
    file.write_text(filled_page("board", "two runs", data), encoding="utf-8")
    page = browser.open(file.as_uri())
    page.wait_for("document.querySelector('.board')")
    return page


def hit(folder: Path, name: str = "frenetix:Default") -> RunSource:
    run = record(TOWN, "collision", DEFAULT, obstacle_id=31).model_copy(update={"config_name": name})
    return source(run, folder, velocity_offset=3.0, prediction=0.3)


@pytest.fixture(scope="module")
def page(browser: Browser, folder: Path, town: ScenarioSource) -> Page:
    return opened(browser, folder, "one run", ViewPane(scenario=town, run=hit(folder)))


def shown(page: Page, selector: str) -> str:
    page.wait_for(f"!{PLAYER}.stale")
    return str(page.value(f"document.querySelector('{selector}').innerText"))


def test_arrows_and_ends_move_through_time(page: Page) -> None:
    page.press("Home")
    page.press("ArrowRight")
    assert page.value(f"{PLAYER}.step") == 1
    assert shown(page, ".time").startswith("0.1 s of")
    page.press("End")
    assert page.value(f"{PLAYER}.step") == 40
    page.press("ArrowLeft")
    assert page.value(f"{PLAYER}.step") == 39


def test_space_plays_to_the_end_and_stops_there(page: Page) -> None:
    page.value(f"{PLAYER}.seek(35)")
    page.press(" ")
    page.wait_for(f"{PLAYER}.step > 36")
    page.wait_for(f"!{PLAYER}.playing")
    assert page.value(f"{PLAYER}.step") == 40


def test_figures_of_the_moment_match_the_run(page: Page) -> None:
    page.value(f"{PLAYER}.seek(10)")
    figures = shown(page, ".now")
    for part in ("10.0 m/s", "velocity offset\t3.000", "prediction\t0.300", "cost\t3.300"):
        assert part in figures


def test_click_on_a_vehicle_shows_its_data(page: Page) -> None:
    page.press("Home")
    page.press("0")
    page.wait_for(f"!{PLAYER}.stale")
    left, top, *_ = page.box(".stage canvas")
    x, y = page.value(f"""(() => {{
        const {{ camera, canvas, tracks }} = {PLAYER}.panes[0], track = tracks.find(one => one.id === 31);
        return camera.toPixels(track.x[0], track.y[0], canvas.clientWidth, canvas.clientHeight); }})()""")
    page.click(left + x, top + y)
    assert "31" in shown(page, ".picked")
    assert "collision\twith the ego at 4.0 s" in shown(page, ".picked")
    page.press("e")
    assert "4.51 × 1.61 m" in shown(page, ".picked")
    page.press("Escape")
    assert "Click a vehicle" in shown(page, ".picked")


def test_the_slider_keeps_its_position_during_playback(page: Page) -> None:
    page.press("Home")
    at_rest = page.box(".scrub input")
    page.press(" ")
    page.wait_for(f"{PLAYER}.playButton.textContent === 'Pause' && {PLAYER}.step > 2")
    assert page.box(".scrub input") == at_rest
    page.press(" ")


def test_moments_lead_to_their_step(page: Page) -> None:
    page.press("Home")
    assert "collided with" in shown(page, ".moments .decisive") or "4.0 s" in shown(page, ".moments .decisive")
    page.value("document.querySelector('.moments .decisive').click()")
    assert page.value(f"{PLAYER}.step") == 40


def test_the_pointer_on_the_chart_shows_figures_and_a_click_goes_there(page: Page) -> None:
    page.value(f"{PLAYER}.chartSelect.selectedIndex = {PLAYER}.charts.length - 1; {PLAYER}.chartSelect.onchange()")
    chart = page.box(".chart canvas")
    x, y = chart.point()[0], chart.top + 40
    page.move(x, y)
    assert "velocity offset 3.000" in shown(page, ".chart .tip")
    page.click(x, y)
    assert 18 <= page.value(f"{PLAYER}.step") <= 22


def test_dragging_moves_the_view_and_ends_following(page: Page) -> None:
    page.value(f"{PLAYER}.setFollow(true)")
    stage = page.box(".stage canvas")
    x, y = stage.left + 100, stage.top + 100
    before = page.value(f"{PLAYER}.panes[0].camera.x")
    page.move(x, y)
    page.mouse.down()
    page.move(x + 60, y)
    page.mouse.up()
    assert page.value(f"[{PLAYER}.follow, {PLAYER}.panes[0].camera.x < {before}]") == [False, True]


def test_theme_key_changes_ground_and_canvas(page: Page) -> None:
    colour = f"[getComputedStyle(document.body).backgroundColor, {PLAYER}.colours.road]"
    before = page.value(colour)
    page.press("t")
    after = page.value(colour)
    page.press("t")
    assert before[0] != after[0]
    assert before[1] != after[1]
    assert page.value(colour) == before


def test_two_panes_move_together(browser: Browser, folder: Path, town: ScenarioSource) -> None:
    panes = [ViewPane(scenario=town, run=run) for run in (hit(folder), source(record(TOWN, config=SAFE), folder))]
    page = opened(browser, folder, "two runs", *panes, scheme="dark")
    page.press("End")
    page.press("+")
    assert len(page.value("[...document.querySelectorAll('.stage')].map(one => one.innerText)")) == 2
    assert page.value(f"{PLAYER}.panes[0].camera.scale === {PLAYER}.panes[1].camera.scale")
    assert page.errors == []


def test_hostile_names_run_no_script_and_load_no_address(browser: Browser, folder: Path, town: ScenarioSource) -> None:
    page = opened(browser, folder, HOSTILE, ViewPane(scenario=town, run=hit(folder, HOSTILE)))
    assert page.value("window.broken") is None
    assert "</script><script>window.broken=1</script>" in page.value("document.querySelector('.stage').innerText")
    assert page.value("document.querySelectorAll('script').length") == 2
    assert [url for url in page.requests if not url.startswith("file:")] == []
    assert page.errors == []


@pytest.fixture
def board(browser: Browser, folder: Path, town: ScenarioSource) -> Page:
    return opened_board(browser, folder, town, hit(folder), source(record(TOWN, "goal_reached", SAFE), folder))


def cells(page: Page) -> list[str]:
    return list(page.value("[...document.querySelectorAll('.cell')].map(cell => cell.innerText)"))


def test_board_shows_outcomes_and_its_filters_hide_rows(board: Page) -> None:
    assert cells(board) == ["collision", "goal reached ▲"]
    board.press("g")
    assert "10" in board.value("document.querySelector('.wide tbody tr').innerText")
    board.press("g")
    board.press("/")
    for letter in "nowhere":
        board.press(letter)
    assert cells(board) == []
    board.press("Escape")
    board.press("r")
    assert len(cells(board)) == 2
    board.value("const one = document.querySelector('.board select'); one.value = 'collision'; one.onchange()")
    assert board.value("[...document.querySelectorAll('.cell')].map(cell => cell.classList.contains('dim'))") == [
        False,
        True,
    ]


def test_a_board_opens_a_run_in_the_player_and_returns(board: Page) -> None:
    board.press("ArrowRight")
    board.press("Enter")
    board.wait_for("document.querySelector('.stage')")
    assert board.value("document.querySelector('.board').offsetHeight") == 0
    assert "goal reached" in board.value("document.querySelector('.stage').innerText")
    board.press("ArrowRight")
    assert board.value("document.querySelector('.player:not(.board)').player.step") == 1
    board.press("Escape")
    assert board.value("document.querySelector('.board').offsetHeight") > 0
    assert board.value("document.activeElement.innerText") == "goal reached ▲"


def test_board_opens_a_run_next_to_that_of_the_first_column(board: Page) -> None:
    board.value("document.querySelectorAll('.cell')[1].focus()")
    board.value(
        "[...document.querySelectorAll('.side button')].find(one => one.innerText.startsWith('Next to')).click()"
    )
    board.wait_for("document.querySelectorAll('.stage').length === 2")
    titles = board.value("[...document.querySelectorAll('.stage figcaption')].map(one => one.innerText)")
    assert [title.split()[1] for title in titles] == ["frenetix:Default", "frenetix:Safe"]
    assert board.errors == []


def test_a_page_without_data_and_host_says_so(browser: Browser, folder: Path) -> None:
    file = folder / "empty.html"
    file.write_text(empty_page("player"), encoding="utf-8")
    page = browser.open(file.as_uri())
    assert "no data" in page.value("document.body.innerText")


def test_plan_of_the_moment_is_drawn_unless_it_is_switched_off(
    browser: Browser, folder: Path, town: ScenarioSource
) -> None:
    plans = (
        ShownPlan(step=0, plan=(0.0, 0.0, 9.0, 0.0), candidates=((0.0, 0.0, 9.0, 2.0),)),
        ShownPlan(step=20, plan=(1.0, 1.0)),
    )
    (folder / "plans.json").write_text(RunPlans(plans=plans).model_dump_json())
    pane = ViewPane(scenario=town, run=hit(folder), plans_path=str(folder / "plans.json"), note="run_x: told")
    page = opened(browser, folder, "plans", pane)
    at = f"planAt({PLAYER}.panes[0].plans"
    assert [page.value(f"{at}, {step}).step") for step in (0, 19.9, 20, 40)] == [0, 0, 20, 20]
    assert page.value(f"{at}, -1) === undefined")
    assert "plan; thin: other candidates" in shown(page, ".side")
    assert "run_x: told" in shown(page, "header")
    page.press("Home")
    picture = "document.querySelector('.stage canvas').toDataURL()"
    page.wait_for(f"!{PLAYER}.stale")
    with_plans = page.value(picture)
    page.press("o")
    page.wait_for(f"!{PLAYER}.stale")
    assert page.value(picture) != with_plans
    assert page.errors == []


def test_predictions_are_drawn_in_their_colour_with_the_plans(
    browser: Browser, folder: Path, town: ScenarioSource
) -> None:
    plans = (ShownPlan(step=0, plan=(0.0, 0.0, 9.0, 0.0), predictions=((20.0, 8.0, 60.0, 8.0),)),)
    (folder / "predictions.json").write_text(RunPlans(plans=plans).model_dump_json())
    pane = ViewPane(scenario=town, run=hit(folder), plans_path=str(folder / "predictions.json"))
    page = opened(browser, folder, "predictions", pane)
    assert "where the planner expected others" in shown(page, ".side")
    of_their_colour = f"""(() => {{
        const canvas = document.querySelector('.stage canvas');
        const wanted = {PLAYER}.colours['series-0'].match(/\\d+/g).map(Number);
        const seen = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
        let count = 0;
        for (let i = 0; i < seen.length; i += 4)
            count += wanted.every((value, j) => Math.abs(seen[i + j] - value) <= 2);
        return count; }})()"""
    page.press("Home")
    page.wait_for(f"!{PLAYER}.stale")
    assert page.value(of_their_colour) > 20
    page.press("o")
    page.wait_for(f"!{PLAYER}.stale")
    assert page.value(of_their_colour) == 0


def test_debug_values_of_the_planner_are_shown_drawn_and_charted(
    browser: Browser, folder: Path, town: ScenarioSource
) -> None:
    own = folder / "debug"
    own.mkdir()
    run, planned = hit(own), len(range(0, 41, 3))
    series = RunSeries(
        lateral_offset_m=tuple(0.01 * step for step in range(41)),
        desired_speed_mps=(9.0,) * planned,
        numbers={"gap_m": (None, *(5.25,) * (planned - 1))},
        texts={"why": ("free", *("behind 7",) * (planned - 1))},
        polygons=(DebugPolygon(step=3, name="corridor", x_m=(40.0, 60.0, 60.0), y_m=(-1.0, -1.0, 1.0)),),
    )
    assert run.steps_path is not None
    Path(run.steps_path).with_name("series.json").write_text(series.model_dump_json(), encoding="utf-8")
    page = opened(browser, own, "debug", ViewPane(scenario=town, run=run))
    page.press("Home")
    for _ in range(3):
        page.press("ArrowRight")
    told = shown(page, ".now")
    for row in (r"lateral offset \(m\)\s+0.03", r"desired speed \(m/s\)\s+9.000", r"gap m\s+5.250", r"why\s+behind 7"):
        assert re.search(row, told), told
    assert "areas that the planner reported: corridor" in shown(page, ".side")
    charts = page.value("[...document.querySelectorAll('.chart option')].map(one => one.innerText)")
    assert charts[-3:] == ["lateral offset (m)", "desired speed (m/s)", "gap m"]
    picture = "document.querySelector('.stage canvas').toDataURL()"
    with_areas = page.value(picture)
    page.press("o")
    page.wait_for(f"!{PLAYER}.stale")
    assert page.value(picture) != with_areas
    for _ in charts:
        page.press("c")
        page.wait_for(f"!{PLAYER}.stale")
    assert page.errors == []
