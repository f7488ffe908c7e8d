"""Scenarios from the built-in maps, for tests of the generator."""

from pathlib import Path

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.schemas.generation import GeneratedScenario, GenerationRequest

MAPS = {entry.facts.place: entry for entry in built_in_maps()}


def request_for(place: str, folder: Path, **changes: object) -> GenerationRequest:
    """Return a request for 6 s at a place of a built-in map, for a single round because further ones only draw other
    traffic; every field can be changed.
    """
    entry = MAPS[place]
    wish: dict[str, object] = {
        "map_path": str(entry.path),
        "map_id": entry.facts.map_id,
        "place": place,
        "country": "ZAM",
        "attribution": entry.facts.attribution,
        "duration_s": 6.0,
        "folder": str(folder),
        "goal": "steps:50",
        "seed": 3,
        "most_rounds": 1,
    }
    return GenerationRequest.model_validate(wish | changes)


def make(place: str, folder: Path, **changes: object) -> GeneratedScenario:
    """Return the scenario of such a request."""
    return generate_scenario(request_for(place, folder, **changes), silent)
