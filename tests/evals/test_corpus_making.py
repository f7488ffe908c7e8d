"""Corpora made from what a workspace holds: ground truth that holds, styles, one side of a split for each scenario."""

import json
import random
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from plannerforge.engine.edits import apply_edits
from plannerforge.engine.execution import silent
from plannerforge.evals.attempts import Task
from plannerforge.evals.corpora import CORPORA, TASKS, corpus_files, packaged_corpora, read_corpus
from plannerforge.evals.ground_truth.modification import edit_of
from plannerforge.evals.making.corpus import make_corpora, write_corpora
from plannerforge.evals.making.materials import STYLES, Materials, read_materials
from plannerforge.evals.making.modification import PossibleEdits, modification_lines, words_of
from plannerforge.schemas.errors import InvalidRequest, PlannerForgeError
from plannerforge.schemas.modification import ModificationRequest

QUICK: tuple[Task, ...] = ("generation", "selection", "routing", "tuning")
ALL_CORPORA = [name for task in TASKS for name in CORPORA[task]]


@pytest.fixture(scope="module")
def materials(tmp_path_factory: pytest.TempPathFactory) -> Materials:
    return read_materials(tmp_path_factory.mktemp("workspace"))


@pytest.mark.parametrize("name", ALL_CORPORA)
def test_every_packaged_corpus_has_twenty_requests_of_several_kinds(name: str) -> None:
    requests = read_corpus(packaged_corpora() / f"{name}.jsonl")
    assert len(requests) >= 20
    assert len({request.text for request in requests}) > 0.9 * len(requests)
    assert name == "e2e" or len({request.expect for request in requests}) >= 2


def test_packaged_requests_use_only_packaged_data(materials: Materials) -> None:
    scenarios = {one.name for one in materials.scenarios}
    maps = {one.file_name for one in materials.maps}
    for path in corpus_files(packaged_corpora(), "all"):
        for request in read_corpus(path):
            assert request.scenario is None or request.scenario in scenarios
            assert request.map_file is None or request.map_file in maps


def test_packaged_searches_have_the_matches_of_the_facts(materials: Materials) -> None:
    facts = {one.facts.scenario_id: one.facts for one in materials.scenarios}
    for request in read_corpus(packaged_corpora() / "selection.jsonl"):
        if request.expect != "ok":
            continue
        truth = request.truth
        matching = [
            key
            for key, one in facts.items()
            if one.location.place == truth["location"]["city"]
            and set(truth.get("tags", ())) <= set(one.tags)
            and all(
                within(one.participants.counts.get(kind, 0), slot) for kind, slot in truth.get("obstacles", {}).items()
            )
            and ("velocity" not in truth or (one.ego is not None and fast_enough(one.ego.speed_mps, truth["velocity"])))
        ]
        assert matching == truth["matching_ids"] != []


def within(count: int, slot: dict[str, Any]) -> bool:
    wanted = slot["count"]
    low, high = {
        "exact": (wanted, wanted),
        "at_least": (wanted, 10**6),
        "at_most": (0, wanted),
        "range": tuple(wanted) if isinstance(wanted, list) else (0, 0),
    }[slot["op"]]
    return bool(low <= count <= high)


def fast_enough(speed_mps: float, slot: dict[str, Any]) -> bool:
    low, high = (value / (3.6 if slot["unit"] == "km/h" else 1.0) for value in slot["value"])
    return bool(low <= speed_mps <= high)


def test_the_same_seed_makes_the_same_requests_and_another_one_others(materials: Materials) -> None:
    first, again, other = (make_corpora(materials, QUICK, 20, seed) for seed in (3, 3, 4))
    assert first == again
    for name in first:
        assert first[name] != other[name]


def test_requests_come_in_all_styles(materials: Materials) -> None:
    for lines in make_corpora(materials, QUICK, 40, 1).values():
        assert {line.style for line in lines} == set(STYLES)


def test_a_scenario_is_on_one_side_of_the_split(materials: Materials, tmp_path: Path) -> None:
    lines = make_corpora(materials, ("selection", "generation"), 60, 1)
    written = write_corpora(lines, tmp_path, whole=False)
    assert {path.parent.name for path in written} == {"dev", "test"}
    sides: dict[str, set[str]] = {}
    for path in written:
        for line in map(json.loads, path.read_text(encoding="utf-8").splitlines()):
            sides.setdefault(str(line["map"]) if "map" in line else "", set()).add(path.parent.name)
    assert {len(found) for name, found in sides.items() if name not in ("", "None")} == {1}
    assert sum(len(read_corpus(path)) for path in written) == sum(map(len, lines.values()))


def test_a_requested_edit_can_be_carried_out_and_an_impossible_one_is_refused(
    materials: Materials, tmp_path: Path
) -> None:
    small = [one for one in materials.scenarios if one.facts.scenario_id.startswith("ZAM_Fahrhausen-4")]
    few = Materials(tuple(small), materials.maps)
    possible = PossibleEdits(1)
    lines = [
        line
        for letter in ("B", "P")
        for line in modification_lines(letter, few, possible, 10, random.Random(1))
        if line.expect != "clarify"
    ]
    refusals = possible.refusals(small[0])
    assert Counter(line.expect for line in lines)["ok"] == 2
    assert {"unknown_vehicle", "unknown_preset", "ego_is_not_traffic", "unknown_class"} <= {
        code for code, _ in refusals
    }
    for number, line in enumerate(lines):
        edits = tuple(edit_of(truth) for truth in line.truth["edits"])
        output = tmp_path / str(number)
        output.mkdir()
        request = ModificationRequest(xml=small[0].path, edits=edits, benchmark_id="ZAM_Test-1_1_T-1", output=output)
        assert apply_edits(request, silent).xml is not None
        assert all(words_of(truth).lower() in line.text.lower() for truth in line.truth["edits"])
    for number, (_, asked) in enumerate(refusals):
        output = tmp_path / f"refused-{number}"
        output.mkdir()
        request = ModificationRequest(
            xml=small[0].path, edits=asked.edits, benchmark_id="ZAM_Test-1_1_T-1", output=output
        )
        with pytest.raises(PlannerForgeError):
            apply_edits(request, silent)


def test_without_scenarios_there_are_no_requests(materials: Materials) -> None:
    with pytest.raises(InvalidRequest, match="no scenario"):
        make_corpora(Materials((), materials.maps), QUICK, 5, 1)
