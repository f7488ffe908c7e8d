"""Requests that have to be refused, and what counts as the right reason."""

import json
from collections import Counter
from pathlib import Path

import pytest

from benchmarks.generation.cases import Session, make_all, refused_right
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.evals.ground_truth.generation import PEOPLE, BenchRequest, Refusal, corpus_refusals, is_right_reason
from plannerforge.evals.scoring.map_evidence import BenchMaps
from plannerforge.schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, UnknownName
from plannerforge.schemas.generation import GenerateScenariosArguments

NO_RAMP = {"place": "Landmoor", "scenario_type": "ramp"}
BY_REASON = {
    "unknown_place": Refusal("place", {"place": "Gotham"}, "unknown_place", ("Gotham",)),
    "no_map_here": Refusal("elsewhere", {"place": "Oslo", "country": "NOR"}, "no_map_here", ("Oslo", "NOR")),
    "no_such_site": Refusal("site", NO_RAMP, "no_such_site", ("ramp",)),
    "several_sites": Refusal("sites", {**NO_RAMP, "count": 3}, "no_such_site", ("ramp",)),
    "unknown_class": Refusal("class", {"vehicles": ["tank=5"]}, "unknown_class", ("tank",)),
    "negative": Refusal("number", {"vehicles": ["truck=-4"]}, "invalid_value", ("vehicles",)),
    "no_time": Refusal("duration", {"duration_s": 0}, "invalid_value", ("duration_s",)),
}


@pytest.mark.parametrize("refusal", BY_REASON.values(), ids=BY_REASON)
def test_the_tool_refuses_for_the_right_reason(refusal: Refusal) -> None:
    assert refused_right(refusal, built_in_maps()) == ""


@pytest.mark.parametrize(
    ("reason", "error"),
    [
        ("unknown_place", NotPossible("no map shows 'Gotham'", reason="not_shown")),
        ("unknown_place", UnknownName("no map shows 'Metropolis'", reason="not_shown")),
        ("no_map_here", UnknownName("there is no map")),
        ("no_such_site", NotPossible("Landmoor (map_landmoor) holds no highway site", reason="no_such_site")),
        ("no_such_site", NotPossible("the ramp is lost when the network is built", reason="site_lost")),
        ("no_such_site", UnknownName("Landmoor holds no ramp site", reason="no_such_site")),
        ("unknown_class", UnknownName("no map shows 'tank'", reason="not_shown")),
        ("unknown_class", UnknownName("there is no vehicle class 'helicopter'", reason="unknown_class")),
        ("negative", InvalidRequest("duration_s: too small")),
        ("no_time", NotPossible("duration_s leaves no room")),
    ],
)
def test_another_reason_is_not_the_right_one(reason: str, error: PlannerForgeError) -> None:
    assert not is_right_reason(BY_REASON[reason], error)


def test_a_type_missing_in_all_maps_is_refused_for_the_right_reason() -> None:
    refusal = Refusal("box", {"bbox": [-80, -170, 80, 170], "scenario_type": "ramp"}, "no_such_site", ("ramp",))
    without_ramps = [entry for entry in built_in_maps() if "ramp" not in entry.facts.sites]
    assert refused_right(refusal, without_ramps) == ""


def test_a_result_instead_of_a_refusal_is_reported() -> None:
    possible = Refusal("made", {"place": "Landmoor", "duration_s": 5}, "no_such_site", ("ramp",))
    assert refused_right(possible, built_in_maps()) == "was made in map_landmoor"


def test_several_scenarios_without_a_fitting_site_are_a_failure() -> None:
    arguments = GenerateScenariosArguments.model_validate({**NO_RAMP, "count": 2})
    maps = BenchMaps(tuple(built_in_maps()), {}, {}, {})
    made = make_all(BenchRequest("ramps", arguments, "landmoor.osm"), Session(maps), seed=0)
    assert [one.fault for one in made] == ["NotPossible: “Landmoor” (map_landmoor) has no ramp site"]


def test_every_refusal_of_the_corpus_is_requested_in_the_bench(shared_data: Path) -> None:
    lines = (shared_data / "corpora" / "dev" / "generation.jsonl").read_text(encoding="utf-8").splitlines()
    entries = [json.loads(line) for line in lines]
    reasons = Counter(refusal.reason for refusal in corpus_refusals(lines))
    elsewhere = reasons.pop("no_map_here")
    assert set(reasons) == {"no_such_site", "unknown_place", "unknown_class", "invalid_value"}
    assert reasons.total() == sum(entry["expect"] == "refuse" for entry in entries) - len(PEOPLE)
    assert elsewhere == sum(entry["expect"] == "ok" and entry["map"] is None for entry in entries) + len(PEOPLE)
