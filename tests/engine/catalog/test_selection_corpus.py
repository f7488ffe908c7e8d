"""The filter on real scenarios, against the ground truth of the selection corpus."""

import json
from pathlib import Path

import pytest
from support.catalog import catalogue, funnel

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.evals.ground_truth.selection import arguments_of
from plannerforge.schemas.scenarios import ReadFactsRequest

COUNTRIES = ("ARG", "ZAM", "ITA", "FRA")


@pytest.mark.shared_data
def test_the_funnel_finds_exactly_the_corpus_s_ids(shared_data: Path) -> None:
    paths = sorted(path for code in COUNTRIES for path in (shared_data / "data/commonroad").glob(f"{code}_*.xml"))
    connection = catalogue([read_facts(ReadFactsRequest(path=path), silent) for path in paths])
    ids = dict(connection.execute("SELECT number, scenario_id FROM catalog_scenarios").fetchall())
    lines = (shared_data / "corpora/dev/selection.jsonl").read_text(encoding="utf-8").splitlines()
    compared = 0
    for line in map(json.loads, lines):
        truth = line["truth"]
        if line["expect"] != "ok" or (truth.get("location") or {}).get("country") not in COUNTRIES:
            continue
        one = funnel(connection, arguments_of(truth))
        assert sorted(ids[number] for number in one.matches) == truth["matching_ids"], line["id"]
        assert {stage.stage: len(stage.numbers) for stage in one.stages} == truth["n_after_stage"], line["id"]
        compared += 1
    assert compared >= 10
