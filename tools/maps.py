"""The maps that a call may use: those of the package, of the user's map folders, and the imported ones."""

from plannerforge.engine.maps.index import MapEntry, built_in_maps
from plannerforge.engine.maps.unpacking import is_map
from plannerforge.schemas.generation import MapFacts
from plannerforge.tools.call import ToolCall
from plannerforge.tools.importing_kinds import import_map

MOST_FILES = 200
MOST_MAPS = 1000


async def maps_at_hand(call: ToolCall) -> list[MapEntry]:
    """All maps with what they show; files in the map folders that are new are read and kept first.

    Imported maps come first, newest first; then the maps that we drew ourselves.
    """
    for folder in call.services.map_folders:
        for path in sorted(entry for entry in folder.iterdir() if is_map(entry))[:MOST_FILES]:
            await import_map(call, path, None)
    imported = [
        MapEntry(artifact.read(MapFacts), call.workspace.file("map", artifact.artifact_id, "map.osm"))
        for artifact in call.workspace.newest(kind="map", limit=MOST_MAPS)
    ]
    return [*imported, *built_in_maps()]
