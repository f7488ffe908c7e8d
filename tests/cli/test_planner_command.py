"""plannerforge planner new | check | schema."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jsonschema
import psutil
import pytest
from support import own_planner_program
from support.builders import Problem, Vehicle, town_road
from support.own_planners import STRAIGHT, install
from typer.testing import CliRunner, Result

from benchmarks.loop import stepwise_program
from plannerforge.cli.planner import published_schema, write_planner
from plannerforge.cli.program import application
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.planning import CommandRequest, EgoStart
from plannerforge.server.settings import settings_file

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples" / "own_planner"
Install = Callable[..., Path]


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Installs a planner of a name where this process, and those that it starts, find packages."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")])))
    return lambda name, source=STRAIGHT, **options: install(folder, name, source, **options)


@pytest.fixture
def road(tmp_path: Path) -> Path:
    """A short drive straight on."""
    path = tmp_path / "road.xml"
    builder = town_road().with_vehicles()
    return type(builder)(builder.lanes, problems=(Problem(goal=(65.0, 0.0, 8.0, 3.0), steps=(15, 35)),)).write(path)


def command(*words: str | Path) -> Result:
    return CliRunner().invoke(application, ["planner", *map(str, words)], env={"COLUMNS": "200"})


def passes_its_own_test(test: Path) -> None:
    """Run what ``planner new`` wrote, on one scenario instead of the three that ``planner check`` drives."""
    text = test.read_text(encoding="utf-8")
    assert "starter_files(3)" in text
    test.write_text(text.replace("starter_files(3)", "starter_files(1)"), encoding="utf-8")
    words = [sys.executable, "-m", "unittest"]
    done = subprocess.run(words, cwd=test.parent, capture_output=True, text=True, check=False)
    assert "Ran 2 tests" in done.stderr, done.stderr
    assert done.returncode == 0, done.stderr


def test_a_new_planner_passes_its_own_test_at_once(tmp_path: Path) -> None:
    made = command("new", "my_first", "--folder", tmp_path)
    assert made.exit_code == 0, made.output
    folder = tmp_path / "my_first"
    assert sorted(path.name for path in folder.iterdir()) == [
        "plannerforge_my_first.py",
        "pyproject.toml",
        "test_plannerforge_my_first.py",
    ]
    assert 'my_first = "plannerforge_my_first:PLANNER"' in (folder / "pyproject.toml").read_text()
    passes_its_own_test(folder / "test_plannerforge_my_first.py")


def test_a_new_planner_that_ignores_others_fails_its_own_test(tmp_path: Path) -> None:
    assert command("new", "blind", "--folder", tmp_path).exit_code == 0
    source = tmp_path / "blind" / "plannerforge_blind.py"
    text = source.read_text()
    blind = text.replace("(self.gap_m(ego, other) for other in observation.obstacles)", "()")
    assert blind != text
    source.write_text(blind)
    words = [sys.executable, "-m", "unittest", "-k", "hits_nothing"]
    done = subprocess.run(words, cwd=source.parent, capture_output=True, text=True, check=False)
    assert "FAIL: test_it_drives_to_the_goal_and_hits_nothing" in done.stderr


def test_a_new_planner_is_checked_in_words(installed: Install, tmp_path: Path) -> None:
    source = write_planner("second", tmp_path) / "plannerforge_second.py"
    installed("second", source.read_text(), package="plannerforge_second")
    checked = command("check", "second")
    assert checked.exit_code == 0, checked.output
    lines = checked.output.splitlines()
    assert lines[0] == "second (entry point of plannerforge_second): follows its route and keeps its distance"
    assert lines[1] == "  weights speed_mps=10, time_gap_s=1.5; presets Default, Careful"
    assert "goal_reached" in lines[2]
    assert lines[-1].startswith("second keeps its contract on 3 scenarios; its drives: goal reached")


@pytest.mark.parametrize("name", ["My Planner", "9lives", "frenetix", "../up", ""])
def test_an_invalid_planner_name_writes_no_files(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidRequest):
        write_planner(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    with pytest.raises(InvalidRequest, match="already exists"):
        write_planner("mine", tmp_path)
    assert list((tmp_path / "mine").iterdir()) == []


@pytest.mark.parametrize(
    ("name", "part", "instead", "told"),
    [
        ("raising", "ego, slower =", "1 / 0; ego, slower =", ["raised ZeroDivisionError", 'own_raising.py", line 12']),
        ("shorter", "arange(21)", "arange(8)", ["different lengths"]),
        ("dice", "candidates=1", "candidates=np.random.randint(10**9)", ["after a reset"]),
        ("counting", "ego, slower =", "self.n = getattr(self, 'n', 0) + 1; ego, slower =", []),
    ],
)
def test_a_planner_s_breaches_are_reported_in_words(
    name: str, part: str, instead: str, told: list[str], installed: Install, road: Path
) -> None:
    assert part in STRAIGHT
    installed(name, STRAIGHT.replace(part, instead))
    checked = command("check", name, road)
    assert checked.exit_code == (1 if told else 0), checked.output
    assert all(words in checked.output for words in told), checked.output
    assert ("BREAKS THE CONTRACT" in checked.output) == bool(told)


def test_a_breach_is_reported_in_full_once(installed: Install, road: Path, tmp_path: Path) -> None:
    installed("again", STRAIGHT.replace("arange(21)", "arange(8)"))
    other = tmp_path / "other.xml"
    other.write_bytes(road.read_bytes())
    output = command("check", "again", road, other).output
    assert output.count("different lengths") == 1
    assert "BREAKS THE CONTRACT, as above" in output
    assert "broken on 2 of 2 scenarios" in output


def test_an_exception_during_import_is_reported_with_its_traceback(installed: Install, road: Path) -> None:
    installed("unimportable", STRAIGHT + "import absent_library\n")
    checked = command("check", "unimportable", road)
    assert checked.exit_code == 1
    assert "No module named 'absent_library'" in checked.output
    assert 'own_unimportable.py", line 30, in <module>' in checked.output


IDLE = STRAIGHT.replace('self.task.configuration.weights["slower_mps2"]', "0.0").replace('{"slower": slower}', "{}")


def test_a_weight_that_changes_no_plan_is_noted_with_the_number_of_observations(installed: Install, road: Path) -> None:
    installed("idle", IDLE)
    told = command("check", "idle", road).output
    asked = len(range(0, 21, 3))  # the drive of 2.1 s is planned every third step
    assert f"Note: the weight slower_mps2 changed none of {asked} plans, from 0 to 4" in told
    assert "kind='parameter'" in told
    installed("acting")
    assert "Note" not in command("check", "acting", road).output


def test_a_parameter_that_does_not_act_is_not_called_a_weight(installed: Install, road: Path) -> None:
    installed("still", IDLE.replace("default=0.0", 'default=0.0, kind="parameter"'))
    told = command("check", "still", road).output
    assert "Note: the parameter slower_mps2 changed none of" in told
    assert "the weight" not in told


def test_a_threshold_that_acts_late_in_the_drive_is_not_noted(installed: Install, road: Path) -> None:
    late = STRAIGHT.replace(
        'self.task.configuration.weights["slower_mps2"]',
        'self.task.configuration.weights["slower_mps2"] * (observation.ego.step > 15)',
    )
    installed("late", late)
    assert "Note" not in command("check", "late", road).output


@pytest.fixture
def blocked(tmp_path: Path) -> Path:
    """The same drive with a car that stands in the lane."""
    car = Vehicle(7, tuple((55.0, 0.0, 0.0, 0.0) for _ in range(40)))
    problem = Problem(goal=(65.0, 0.0, 8.0, 3.0), steps=(15, 35))
    return replace(town_road().with_vehicles(car), problems=(problem,)).write(tmp_path / "blocked.xml")


def test_a_blind_planner_is_reported_to_hit_the_recorded_traffic(installed: Install, blocked: Path) -> None:
    installed("blind")
    checked = command("check", "blind", blocked)
    assert checked.exit_code == 0, "it judges the contract"
    assert "collision: collided with obstacle 7" in checked.output
    assert checked.output.splitlines()[-1] == "blind keeps its contract on 1 scenario; its drives: collision 1."


def test_an_empty_road_must_be_requested_and_is_reported(installed: Install, blocked: Path) -> None:
    installed("blind")
    output = command("check", "blind", blocked, "--empty-road").output
    assert "on an empty road, as requested" in output
    assert output.splitlines()[-1] == "blind keeps its contract on 1 scenario; its drives: goal reached 1."


def test_a_new_stepwise_program_passes_its_own_test_at_once(tmp_path: Path) -> None:
    made = command("new", "stepper", "--kind", "stepwise", "--folder", tmp_path)
    assert made.exit_code == 0, made.output
    folder = tmp_path / "stepper"
    assert sorted(path.name for path in folder.iterdir()) == ["plannerforge.toml", "stepper.py", "test_stepper.py"]
    assert (folder / "stepper.py").read_text() == (EXAMPLES / "stepwise_planner.py").read_text()
    passes_its_own_test(folder / "test_stepper.py")


@pytest.mark.parametrize(("behaviour", "code", "told"), [("drives", 0, "keeps"), ("too_short", 1, "plans only 0.40 s")])
def test_a_program_of_the_settings_is_checked(behaviour: str, code: int, told: str, road: Path) -> None:
    settings_file().parent.mkdir(parents=True, exist_ok=True)
    program = f'["{sys.executable}", "-S", "{own_planner_program.__file__}", "{behaviour}"]'
    settings_file().write_text(f'[planners.theirs]\nsummary = "theirs"\ncommand = {program}\n')
    checked = command("check", "theirs", road)
    assert checked.exit_code == code, checked.output
    assert told in checked.output


@pytest.mark.parametrize(("behaviour", "code", "told"), [("drives", 0, "ms a plan"), ("old_step@2", 1, "for step 0")])
def test_a_stepwise_program_is_checked_and_leaves_no_process(behaviour: str, code: int, told: str, road: Path) -> None:
    settings_file().parent.mkdir(parents=True, exist_ok=True)
    program = f'["{sys.executable}", "-S", "{stepwise_program.__file__}", "{behaviour}"]'
    section = f'[planners.theirs]\nsummary = "theirs"\ncommand = {program}\nprotocol = "stepwise"\n'
    settings_file().write_text(section)
    checked = command("check", "theirs", road)
    assert checked.exit_code == code, checked.output
    assert told in checked.output
    assert [one for one in psutil.Process().children(recursive=True) if behaviour in one.cmdline()] == []


@pytest.mark.parametrize(("name", "told"), [("absent", "there is no planner 'absent'"), ("idm", "built-in")])
def test_a_planner_that_cannot_be_checked_is_named(name: str, told: str) -> None:
    checked = command("check", name)
    assert checked.exit_code != 0
    assert told in str(checked.exception)


@pytest.mark.parametrize("which", ["request", "answer", "start", "ready", "step", "plan"])
def test_the_published_schema_is_that_of_the_models(which: str) -> None:
    printed = command("schema", which).output
    assert printed == (EXAMPLES / f"{which}.schema.json").read_text(encoding="utf-8")


def test_an_answer_that_drives_matches_the_schema() -> None:
    import json

    request = CommandRequest(
        scenario_id="ZAM_Builder-1_1_T-1",
        scenario_file="/tmp/scenario.xml",
        problem_id=100,
        folder="/tmp",
        planner="theirs",
        config_id="cfg_1",
        weights={"comfort": 1.0},
        settings={"length_m": 4.5},
        ego=EgoStart(x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=10.0, acceleration_mps2=0.0),
        first_step=0,
        last_step=30,
        step_s=0.1,
    ).model_dump(mode="json")
    jsonschema.validate(request, json.loads(published_schema("request")))
    answer, form = own_planner_program.answer(request), json.loads(published_schema("answer"))
    jsonschema.validate(answer, form)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(answer | {"colour": "red"}, form)
