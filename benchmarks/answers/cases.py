"""Questions of users as calls, calls with several faults, and what each answer must hold.

A sheet is a sequence of cases that one client sends, so that ``latest`` and ``previous_run`` refer to what came before.
The requirements are fields that the answer must fill and show (``judge.unanswered``); ``judge`` checks their truth.
"""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_FAULTS = Path(__file__).parent / "faults.tsv"
_OUTCOME = ("runs.run_id", "runs.reason")
_EDIT_DONE = ("scenario_id|edits.what", "untouched")


@dataclass(frozen=True)
class Case:
    """A question, its call, and the required content of its answer.

    ``may_refuse``: the requested content may be missing in a scenario; a refusal then counts as an answer if it states
    what is valid or what to do next.
    """

    question: str
    tool: str
    arguments: Mapping[str, Any]
    asks: tuple[str, ...]
    may_refuse: bool = False


@dataclass(frozen=True)
class FaultyCall:
    """A call with several faults, and a word of each that the refusal has to hold."""

    tool: str
    arguments: Mapping[str, Any]
    words: tuple[str, ...]


def sheet_of_scenario(scenario_id: str) -> list[Case]:
    """Return questions about a scenario: its content, a planner's run, and its run after an edit."""
    own = {"scenario_id": scenario_id}

    def edit(question: str, asks: Sequence[str], **values: Any) -> Case:
        return Case(question, "modify_scenario", {**own, "edits": [values]}, (*_EDIT_DONE, *asks), may_refuse=True)

    described = ("counts|scenario_id", "description.ego.speed_mps", "description.ego.goal", "description.ego.way")
    return [
        Case("What is in it, and what has the ego to do?", "describe_scenario", own, described),
        Case(
            "Who is within 60 m?",
            "describe_scenario",
            {**own, "detail": "vehicles", "radius_m": 60},
            ("description.vehicles.vehicle_id|description.vehicles_total",),
        ),
        Case(
            "Where does the nearest vehicle go, and where could it?",
            "describe_scenario",
            {**own, "focus": "nearest:1"},
            (
                "description.asked.vehicle.vehicle_id",
                "description.asked.route",
                "description.asked.reach.lanelet_id|description.asked.vehicle.lanelet",
            ),
            may_refuse=True,
        ),
        Case(
            "Does the default planner make it?", "run_planner", {"scenarios": [scenario_id]}, (*_OUTCOME, "next_step")
        ),
        Case(
            "What happened, when, and how hard was it?",
            "analyze_results",
            {"results": ["latest_run"]},
            ("rows.run_id", "rows.duration_s|rows.reason", "review.largest.value|rows.reason"),
        ),
        Case(
            "Step by step?",
            "analyze_results",
            {"results": ["latest_run"], "detail": "timeline"},
            ("timeline.time_s", "timeline.speed_mps"),
        ),
        edit(
            "Make the two nearest aggressive.",
            ("edits.vehicles", "edits.meant"),
            op="set_behaviour",
            vehicles=["nearest:2"],
            preset="aggressive",
        ),
        edit("Take the nearest one out.", ("removed",), op="remove_vehicle", vehicles=["nearest:1"]),
        edit(
            "Put a truck 40 m ahead of me.",
            ("edits.vehicles", "edits.routes.lanelets", "touched.vehicle_id"),
            op="add_vehicle",
            vehicle_class="truck",
            at="ego",
            lane="same",
            offset_m=40,
        ),
        edit(
            "Send the nearest one left.", ("edits.routes.lanelets",), op="reroute", vehicles=["nearest:1"], turn="left"
        ),
        Case("And now?", "run_planner", {"scenarios": ["latest"]}, _OUTCOME),
        Case(
            "First run against second?",
            "compare_results",
            {"results": ["previous_run", "latest_run"]},
            ("comparisons.verdict", "comparisons.single.run_id"),
        ),
        Case(
            "Is the safety preset better than the default here?",
            "run_planner",
            {"scenarios": [scenario_id], "configs": ["frenetix:Default", "frenetix:Safety-Conservative"]},
            ("batch_id", "summary.outcomes", "summary.config_name"),
        ),
        Case(
            "What got better?",
            "compare_results",
            {"results": ["latest_batch"]},
            ("comparisons.before", "comparisons.weights.weight"),
        ),
    ]


SEARCHES: tuple[Mapping[str, Any], ...] = (
    {"obstacles": ["truck>=1"]},
    {"obstacles": ["car>=20"]},
    {"obstacles": ["bicycle>=1", "car>=5"]},
    {"obstacles": ["motorcycle"]},
    {"obstacles": ["bus=1"]},
    {"obstacles": ["car<=2"]},
    {"obstacles": ["car=0"]},
    {"tags": ["intersection"]},
    {"tags": ["highway"], "obstacles": ["truck"]},
    {"tags": ["critical", "intersection"]},
    {"tags": ["multi_lane"]},
    {"country": "DEU"},
    {"country": "USA", "tags": ["highway"]},
    {"country": "BEL", "obstacles": ["car>=10"]},
    {"country": "ESP", "ego_speed": "0..8m/s"},
    {"ego_speed": "5..10m/s"},
    {"ego_speed": "20..40m/s"},
    {"ego_speed": "0..3m/s", "obstacles": ["car>=3"]},
    {"city": "Lohmar", "country": "DEU"},
    {"tags": ["intersection"], "obstacles": ["bus>=3"]},
)
"""Conditions with matches that the judge counts from the files."""

GENERATIONS: tuple[Mapping[str, Any], ...] = (
    {"place": "Musterstadt", "scenario_type": "signalised_intersection"},
    {"place": "Musterstadt", "vehicles": ["truck=2", "bus=1"], "density": "medium"},
    {"place": "Fahrhausen", "scenario_type": "intersection", "vehicles": ["bicycle=3..3"]},
    {"place": "Fahrhausen", "vehicles": ["car=30..30"], "density": "high"},
    {"place": "Kreiselheim", "scenario_type": "roundabout", "vehicles": ["taxi"]},
    {"place": "Neuland", "scenario_type": "highway", "vehicles": ["truck=30%"], "density": "medium"},
    {"place": "Neuland", "scenario_type": "ramp", "duration_s": 12},
    {"place": "Quadratstadt", "scenario_type": "urban", "vehicles": ["bus", "bicycle"], "density": "medium"},
    {"place": "Landmoor", "scenario_type": "rural", "goal": "distance_m:120"},
    {"place": "Musterstadt", "ego": "type:bus", "duration_s": 10},
)

CONFIGURATIONS: tuple[Mapping[str, Any], ...] = (
    {"preset": "Comfort"},
    {"preset": "Safety-Conservative", "weights": ["jerk=0.5"]},
    {"weights": ["prediction*2"]},
    {"weights": ["velocity_offset=0.4", "lateral_jerk+0.1"], "base": "frenetix:Default"},
    {"preset": "Efficiency-Sporty"},
    {"weights": ["distance_to_obstacles=0.3", "responsibility=0.2"], "base": "frenetix:Balanced"},
    {"preset": "Default"},
    {"weights": ["path_length=0.1"], "base": "frenetix:Safety-Conservative"},
)


def sheet_of_catalogue() -> list[Case]:
    """Return questions about many scenarios, generation, configurations and available artifacts."""
    cases = [
        Case(
            f"Which ones: {json.dumps(given)}?",
            "find_scenarios",
            {**given, "limit": 50},
            ("total", "catalogue", "stages.left"),
        )
        for given in SEARCHES
    ]
    cases += [
        Case(
            f"Make {json.dumps(given)}",
            "generate_scenarios",
            {"seed": seed, **given},
            (
                "scenarios.vehicles_realised",
                "scenarios.ego_speed_mps",
                "scenarios.goal_distance_m",
                "scenarios.scenario_id",
            ),
        )
        for seed, given in enumerate(GENERATIONS)
    ]
    cases += [
        Case(f"Take {json.dumps(given)}", "configure_planner", given, ("config_id", "changes.name|against"))
        for given in CONFIGURATIONS
    ]
    return [
        *cases,
        Case(
            "Which planners and weights are there?",
            "list_planners",
            {},
            ("planners.name", "weights.name", "presets.name"),
        ),
        Case("What is in the catalogue?", "describe_catalog", {}, ("scenarios", "facets.facet")),
        Case("Which obstacles?", "describe_catalog", {"facet": "obstacles"}, ("facets.counts.car",)),
        Case("What was configured?", "list_artifacts", {"kind": "config"}, ("artifacts.artifact_id",)),
        Case("What was run?", "list_artifacts", {"kind": "run"}, ("artifacts.artifact_id",)),
    ]


def faulty_calls() -> list[FaultyCall]:
    """Return calls with two to four faults each, in the order of the data file."""
    with _FAULTS.open(encoding="utf-8", newline="") as stream:
        rows = csv.DictReader(stream, delimiter="\t", quoting=csv.QUOTE_NONE)
        return [FaultyCall(row["tool"], json.loads(row["arguments"]), tuple(row["words"].split("|"))) for row in rows]
