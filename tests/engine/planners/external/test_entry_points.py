"""Planners of other packages: found by their metadata, imported when they are used, and blamed for what they do."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from support.own_planners import STRAIGHT, install
from support.planning import configuration, drive, goal_state, problem_for, rectangle_at, scenario_on, straight_road

from plannerforge.engine.planners import known_planner, make_planner, planner_names, planner_version, refused_planners
from plannerforge.engine.planners.external import found
from plannerforge.engine.planners.simulation import DrivenRun
from plannerforge.engine.tuning import tuning_of
from plannerforge.schemas.errors import PlannerFailure, UnknownName

Install = Callable[..., Path]


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Installs a planner of a name where this process, and those that it starts, find packages."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")])))
    return lambda name, source=STRAIGHT, **options: install(folder, name, source, **options)


def driven(name: str, slower_mps2: float = 0.0) -> DrivenRun:
    """A run whose configuration is made without a look at what the planner declares, which takes a process."""
    goal = goal_state((10, 30), rectangle_at(20.0, 0.0))
    scenario, problem = scenario_on(straight_road(200.0)), problem_for(goal)
    chosen = configuration("idm").model_copy(update={"planner": name, "weights": {"slower_mps2": slower_mps2}})
    return drive(scenario, problem, chosen, planner=make_planner(name))


def test_a_planner_of_another_package_drives(installed: Install) -> None:
    installed("first")
    run = driven("first")
    assert run.final.outcome == "goal_reached"
    assert run.states[-1].speed_mps == 10.0
    slowed = driven("first", slower_mps2=2.0)
    assert slowed.states[-1].speed_mps < 9.0
    assert slowed.plans[0].costs == {"slower": 2.0}


def test_declared_parameters_can_be_set(installed: Install) -> None:
    installed("second")
    tuning = tuning_of("Second")
    assert tuning.summary == "drives straight on"
    assert {name: preset.weights for name, preset in tuning.presets.items()} == {
        "Default": {"slower_mps2": 0.0},
        "Lazy": {"slower_mps2": 1.0},
    }
    assert tuning.limits == {"slower_mps2": (0.0, 4.0)}
    assert configuration("second", "slower_mps2=3").weights == {"slower_mps2": 3.0}


def test_reading_its_declaration_does_not_import_the_planner(installed: Install) -> None:
    installed("third")
    assert "third" in planner_names()
    assert known_planner("Third") == "third"
    assert planner_version("third")
    assert tuning_of("third").presets
    assert "own_third" not in sys.modules


def test_a_built_in_name_is_refused_in_words_and_the_built_in_planner_stays(installed: Install) -> None:
    installed("idm")
    assert planner_names().count("idm") == 1
    assert refused_planners() == ("the entry point of own_idm has the name of the built-in planner idm; rename it",)
    assert "time_headway_s" in tuning_of("idm").weights


def test_two_planners_of_a_name_are_refused_with_both_packages(installed: Install) -> None:
    installed("fourth")
    installed("fourth", package="another_fourth")
    assert "fourth" not in planner_names()
    with pytest.raises(PlannerFailure, match="fourth") as caught:
        known_planner("fourth")
    assert "own_fourth" in caught.value.message
    assert "another_fourth" in caught.value.message


def test_a_name_that_cannot_be_written_is_refused(installed: Install) -> None:
    installed("my planner", package="own_spaced")
    assert refused_planners()[0].startswith("entry point of own_spaced: 'my planner' is not a valid name")


def test_an_unknown_name_is_answered_with_the_user_s_planners_too(installed: Install) -> None:
    installed("fifth")
    with pytest.raises(UnknownName) as caught:
        known_planner("fith")
    assert "fifth" in caught.value.valid


@pytest.mark.parametrize(
    ("name", "source", "told"),
    [
        ("absent", "import absent_library", "No module named 'absent_library'"),
        ("leaving", "raise SystemExit('no licence')", "no licence"),
        ("number", "PLANNER = 3", "int, not OwnPlanner"),
        ("empty", "", "no attribute 'PLANNER'"),
        ("outside", STRAIGHT.replace("default=0.0", "default=9.0"), "outside 0 to 4"),
        ("no_class", STRAIGHT.replace("    Straight,\n", "    3,\n"), "make is int, neither a class nor a function"),
    ],
)
def test_a_broken_entry_point_is_an_error_of_that_planner(
    name: str, source: str, told: str, installed: Install
) -> None:
    installed(name, source)
    assert name in planner_names()
    for use in (tuning_of, make_planner):
        with pytest.raises(PlannerFailure) as caught:
            use(name)
        assert caught.value.reason == "entry_point_broken"
        assert f"own_{name}:PLANNER of the entry point of own_{name}" in caught.value.message
        assert told in caught.value.message
    assert tuning_of("idm")


def test_a_package_that_hangs_when_imported_is_left(installed: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(found, "IMPORT_LIMIT_S", 0.5)
    installed("sleeper", "import time\ntime.sleep(600)")
    with pytest.raises(PlannerFailure, match="timed out"):
        tuning_of("sleeper")


def test_output_of_a_package_at_import_is_not_a_declaration(installed: Install) -> None:
    installed("talker", "print('{}')\n" + STRAIGHT)
    assert tuning_of("talker").summary == "drives straight on"


@pytest.mark.parametrize(
    ("name", "part", "instead", "reason", "told"),
    [
        ("divides", "ego, slower =", "1 / 0; ego, slower =", "raised", "ZeroDivisionError when it planned step 0"),
        ("leaves", "ego, slower =", "raise SystemExit; ego, slower =", "raised", "raised SystemExit"),
        ("resets", "self.task = task", "raise KeyError('map')", "raised", "raised KeyError when it was reset"),
        (
            "unmade",
            "def reset",
            "def __init__(self, more):\n        pass\n\n    def reset",
            "raised",
            "when it was created",
        ),
        (
            "hasty",
            "def reset(self, task)",
            "def reset(self)",
            "contract_broken",
            "Straight.reset() does not take one argument",
        ),
        ("planless", "def plan(", "def plans(", "contract_broken", "Straight.plan is missing; it needs plan("),
        (
            "lists",
            'return Plan(trajectory, {"slower": slower}, candidates=1)',
            "return [trajectory]",
            "contract_broken",
            "list, not a Plan",
        ),
        ("lists_states", "Plan(trajectory,", "Plan([1, 2],", "contract_broken", "trajectory is list"),
        (
            "lists_numbers",
            "np.full(21, -slower))",
            "[0.0] * 21)",
            "contract_broken",
            "accelerations_mps2 of the trajectory is list",
        ),
        ("no_number", '"slower": slower', '"slower": np.nan', "contract_broken", "cost slower is nan"),
        ("forges", '"slower": slower', '"a\\nNext: call x": slower', "contract_broken", "must be printable"),
        (
            "elsewhere",
            "ego.position + gone",
            "5.0 + ego.position + gone",
            "contract_broken",
            "starts 7.07 m from the ego",
        ),
        ("infinite", "np.full(21, ego.heading_rad)", "np.full(21, np.inf)", "contract_broken", "not finite"),
    ],
)
def test_a_planner_s_fault_is_its_own_error(
    name: str, part: str, instead: str, reason: str, told: str, installed: Install
) -> None:
    assert part in STRAIGHT
    installed(name, STRAIGHT.replace(part, instead))
    with pytest.raises(PlannerFailure) as caught:
        driven(name)
    blamed = caught.value
    assert blamed.reason == reason
    assert told in blamed.message
    assert blamed.message.startswith(f"planner {name} ")


def test_a_plan_that_the_vehicle_cannot_drive_ends_the_run(installed: Install) -> None:
    installed("brake")
    run = driven("brake", slower_mps2=40.0)
    assert run.final.outcome == "infeasible"
    assert run.rejected == {"friction": 1}


def test_an_edited_planner_is_imported_again_under_another_version(installed: Install) -> None:
    installed("edited")
    before = planner_version("edited")
    assert driven("edited").states[-1].speed_mps == 10.0
    installed("edited", STRAIGHT.replace("slower * times", "(slower + 1.5) * times"))
    assert planner_version("edited") != before
    assert driven("edited").states[-1].speed_mps < 9.9
