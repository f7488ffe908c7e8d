"""How the files go in that are no scenarios: OpenStreetMap maps and cost-weight files."""

from pathlib import Path

import anyio

from plannerforge.engine.catalog.places import country_code
from plannerforge.engine.maps.unpacking import is_binary, stored_name, unpacked
from plannerforge.engine.planners.registry import known_planner
from plannerforge.engine.tuning.configurations import changed_configuration, preset_configuration
from plannerforge.engine.tuning.planner_tuning import tuning_of
from plannerforge.engine.tuning.weight_file import read_weight_file
from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.generation import ConvertedMap, ConvertMapRequest, MapFacts, ReadMapRequest
from plannerforge.schemas.importing import ImportedItem
from plannerforge.tools.call import ToolCall
from plannerforge.tools.configurations import store_configuration
from plannerforge.tools.storing import content_digest

READ_MAP_TIMEOUT_S = 120.0


def known_country(text: str | None) -> str | None:
    """The ISO alpha-3 code of a country's code or name.

    Raises:
        InvalidRequest: there is no such country.
    """
    code = None if text is None else country_code(text)
    if code is None and text is not None:
        raise InvalidRequest(f"there is no country {text!r}", valid=["DEU", "Germany", "de"])
    return code


async def import_map(call: ToolCall, path: Path, name: str | None, country: str | None = None) -> ImportedItem:
    """Store a map, unpacked, with what it shows; name and country (ISO alpha-3) win over what the file says."""
    with call.workspace.scratch() as folder:
        plain = await _plain(call, path, folder)
        recipe = _recipe(plain, name, country)
        before = call.workspace.find_by_recipe("map", recipe)
        artifact = before or await _store_map(call, plain, recipe, name, country)
    facts = artifact.read(MapFacts)
    sites = ", ".join(f"{count} {kind}" for kind, count in sorted(facts.sites.items()) if count) or "no sites"
    return ImportedItem(
        file=path.name,
        kind="map",
        artifact_id=artifact.artifact_id,
        summary=f"{facts.place} ({facts.country or 'country unknown'}): {facts.road_km:.1f} km of roads, {sites}",
        reused=before is not None,
    )


async def _plain(call: ToolCall, path: Path, folder: Path) -> Path:
    """The map itself, or unpacked into the folder."""
    if not is_binary(path):
        return await anyio.to_thread.run_sync(unpacked, path, folder)
    converted = await call.run(
        "plannerforge.engine.maps.binary_osm:write_as_xml",
        ConvertMapRequest(path=str(path), folder=str(folder)),
        ConvertedMap,
        timeout_s=READ_MAP_TIMEOUT_S,
    )
    return Path(converted.path)


async def _store_map(call: ToolCall, path: Path, recipe: Recipe, name: str | None, country: str | None) -> Artifact:
    facts = await call.run(
        "plannerforge.engine.maps.facts:read_map",
        ReadMapRequest(path=str(path), map_id=f"map_{recipe.digest}", place=name, country=country),
        MapFacts,
        timeout_s=READ_MAP_TIMEOUT_S,
    )
    return call.workspace.put(
        "map", facts.map_id, recipe=recipe, record=facts, files={stored_name(path): path}, name=facts.place
    )


async def import_configuration(call: ToolCall, path: Path, name: str | None) -> ImportedItem:
    """Store a cost-weight file of the Frenetix reference's form, or one that we exported, as a configuration."""
    content = read_weight_file(path)
    planner = known_planner(content.planner)
    tuning = tuning_of(planner)
    base = preset_configuration(planner, tuning.presets[tuning.first_preset])
    configuration, _ = changed_configuration(base, None, content.weights, content.settings)
    before = call.workspace.find("config", configuration.config_id)
    store_configuration(call, configuration, _recipe(path, name), name)
    return ImportedItem(
        file=path.name,
        kind="config",
        artifact_id=configuration.config_id,
        summary=configuration.name,
        reused=before is not None,
    )


def _recipe(path: Path, name: str | None = None, country: str | None = None) -> Recipe:
    arguments = {"content": content_digest(path)}
    arguments |= ({"name": name} if name else {}) | ({"country": country} if country else {})
    return Recipe(tool="import_files", arguments=arguments)
