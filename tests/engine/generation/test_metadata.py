from pathlib import Path

import pytest

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.schemas.generation import GenerationRequest, RequestedGoal


@pytest.mark.parametrize(("country", "signed"), [("AUS", False), ("ZAM", True)])
def test_a_limit_without_a_sign_is_kept_and_reported(tmp_path: Path, country: str, signed: bool) -> None:
    entry = next(entry for entry in built_in_maps() if entry.facts.place == "Landmoor")
    wish = GenerationRequest(
        map_path=str(entry.path),
        map_id=entry.facts.map_id,
        place="Landmoor",
        country=country,
        attribution=entry.facts.attribution,
        scenario_type="rural",
        density="low",
        duration_s=6.0,
        seed=1,
        goal=RequestedGoal.of("steps:50"),
        folder=str(tmp_path),
    )
    made = generate_scenario(wish, silent)
    network = read_scenario(tmp_path / "scenario.xml").scenario.lanelet_network
    assert bool(network.traffic_signs) is signed
    assert any("no speed-limit signs" in note for note in made.notes) is not signed
    assert set(made.unsigned_limits_kmh) <= {lanelet.lanelet_id for lanelet in network.lanelets}
    assert (100.0 in made.unsigned_limits_kmh.values()) is not signed
