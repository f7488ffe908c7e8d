"""The measured subjects: all operations on maps, networks, scenarios, catalogues and arguments."""

import hashlib
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from plannerforge.engine.catalog import Search, build_index, rank, scenario_facets
from plannerforge.engine.catalog.tables import add_facts, prepare
from plannerforge.engine.commonroad import read_recorded, read_scenario
from plannerforge.engine.edits import apply_edits
from plannerforge.engine.execution import silent
from plannerforge.engine.maps import MapEntry, find_maps, read_map
from plannerforge.engine.network import NetLayout, build_road_network, check_file, read_net, straight_speeds, sumo_net
from plannerforge.engine.planners.registry import open_traffic
from plannerforge.engine.rendering import render
from plannerforge.engine.scenarios import describe, read_facts
from plannerforge.engine.scene import Scene
from plannerforge.engine.tuning import read_weight_file
from plannerforge.engine.vehicles import vehicle_of
from plannerforge.engine.workspace import NewArtifact, Recipe, Workspace
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.base import Model
from plannerforge.schemas.catalog import BuildIndexRequest, FindScenariosArguments, RankRequest
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.generation import MapFacts, ReadMapRequest
from plannerforge.schemas.modification import Edit, ModificationRequest, ModifyScenarioArguments
from plannerforge.schemas.planning import RunPlannerArguments
from plannerforge.schemas.rendering import RenderRequest
from plannerforge.schemas.runs import ScenarioSource
from plannerforge.schemas.scenarios import DescribeRequest, ReadFactsRequest, ScenarioFacts
from plannerforge.server.arguments.checking import read_arguments

from .inputs import rings, stack, star, streets, town
from .measurement import Subject, Work

OnFile = Callable[[Path], object]


def _doubled(first: int, doublings: int = 3) -> tuple[int, ...]:
    return tuple(first * 2**number for number in range(doublings + 1))


def _again(work: Work, times: int) -> Work:
    """Repeat the work if once is too short to measure."""

    def repeated() -> None:
        for _ in range(times):
            work()

    return repeated


# Maps


def _read_map(path: Path) -> MapFacts:
    return read_map(ReadMapRequest(path=str(path)), silent)


def _map_of(draw: Callable[[Path, int], Path]) -> Callable[[int, Path], Work]:
    def prepared(size: int, folder: Path) -> Work:
        path = draw(folder / "map.osm", size)
        return lambda: _read_map(path)

    return prepared


def _facts_of_map(number: int, names: Iterable[str], salt: str) -> MapEntry:
    facts = MapFacts(
        map_id=f"map_{salt}{number}",
        file_name=f"{salt}{number}.osm",
        place=f"Place {salt} {number}",
        places=(f"Place {salt} {number}",),
        country="DEU",
        south=48.0,
        west=11.0,
        north=48.1,
        east=11.1,
        streets=tuple(names),
        refs=(),
        sites={"intersection": 3},
        road_km=10.0,
        attribution="",
    )
    return MapEntry(facts, Path("map.osm"))


def _salt(folder: Path) -> str:
    """Return letters unique to the folder, because compared spellings are cached."""
    digest = hashlib.sha256(str(folder).encode()).hexdigest()[:8]
    return "".join(chr(ord("a") + int(digit, 16)) for digit in digest)


def _place_among_streets(size: int, folder: Path) -> Work:
    salt = _salt(folder)
    entry = _facts_of_map(1, (f"{salt} Street {number}" for number in range(size)), salt)
    return lambda: find_maps([entry], place=f"{salt} Street {size - 1}")


def _place_among_maps(size: int, folder: Path) -> Work:
    salt = _salt(folder)
    entries = [_facts_of_map(number, (f"{salt}{number} Street {n}" for n in range(4)), salt) for number in range(size)]
    return lambda: find_maps(entries, place=f"Place {salt} {size - 1}")


# Networks


def _grid(size: int, folder: Path) -> Work:
    """Return a net of ``size`` rows of four junctions."""
    path = folder / "grid.net.xml"
    program = shutil.which("netgenerate", path=str(Path(sys.executable).parent)) or "netgenerate"
    options = ["--grid", "--grid.x-number=4", f"--grid.y-number={size}", "--grid.length=80"]
    subprocess.run([program, *options, "-o", str(path)], check=True, capture_output=True, timeout=120)
    return lambda: build_road_network(read_net(path), step_s=0.1, elapsed_s=0.0)


def _net_of(path: Path) -> Work:
    network = read_scenario(path).scenario.lanelet_network

    def written() -> str:
        layout = NetLayout.of(network)
        return sumo_net(layout, straight_speeds(layout, {}))

    return written


def _network_of(draw: Callable[[Path, int], Path], prepared: Callable[[Path], Work]) -> Callable[[int, Path], Work]:
    return lambda size, folder: prepared(draw(folder / "network.xml", size))


def _checked(path: Path) -> Work:
    return lambda: check_file(path)


def _row(path: Path, size: int) -> Path:
    return town(path, crossings=size, vehicles=1, steps=2)


# Scenarios


def _scene(path: Path) -> object:
    recorded = read_recorded(path)
    return Scene.of(recorded.loaded)


def _facts(path: Path) -> ScenarioFacts:
    return read_facts(ReadFactsRequest(path=path), silent)


def _describe(path: Path) -> object:
    return describe(DescribeRequest(path=path, detail="checks", focus=None, radius_m=80.0), silent)


def _edit(path: Path) -> object:
    vehicle = read_recorded(path).tracks
    edit = Edit(op="set_speed", vehicles=[str(min(vehicle))], speed="3m/s", time_s=0.5)
    output = path.parent / "edited"
    output.mkdir()
    return apply_edits(
        ModificationRequest(xml=path, edits=(edit,), benchmark_id="ZAM_Growth-1_1_T-2", output=output), silent
    )


def _traffic(path: Path) -> object:
    loaded = read_scenario(path)
    with open_traffic("recorded", loaded, loaded.problem(), vehicle_of(built_in("idm").settings), 0) as traffic:
        return traffic.moving


def _render(path: Path) -> object:
    source = ScenarioSource(scenario_id="ZAM_Growth-1_1_T-1", path=str(path))
    return render(RenderRequest(kind="picture", scenarios=(source,), folder=str(path.parent)), silent)


_ON_SCENARIOS: dict[str, OnFile] = {
    "import": _facts,
    "scene": _scene,
    "describe": _describe,
    "edit": _edit,
    "run set-up": _traffic,
    "render": _render,
}
_Draw = Callable[[Path, int], Path]
_ROAD = 32
"""Crossings of the roads for doubled vehicles and states (chosen): 192 lanelets, 3.8 km."""
_AXES: dict[str, tuple[_Draw, tuple[int, ...]]] = {
    "vehicles": (lambda path, size: town(path, crossings=_ROAD, vehicles=size, steps=20), _doubled(50)),
    "lanelets": (lambda path, size: town(path, crossings=size, vehicles=20, steps=20), _doubled(50)),
    "states": (lambda path, size: town(path, crossings=_ROAD, vehicles=10, steps=size), _doubled(100)),
}


def _on_scenario(draw: _Draw, on_file: OnFile) -> Callable[[int, Path], Work]:
    def prepared(size: int, folder: Path) -> Work:
        path = draw(folder / "scenario.xml", size)
        return lambda: on_file(path)

    return prepared


# Catalogue and workspace


def _facts_to_enter(folder: Path) -> ScenarioFacts:
    return _facts(town(folder / "one.xml", crossings=2, vehicles=4, steps=5))


def _catalogue(size: int, folder: Path) -> Path:
    one = _facts_to_enter(folder)
    path = folder / "workspace.sqlite"
    connection = sqlite3.connect(path, isolation_level=None)
    prepare(connection)
    connection.execute("BEGIN")
    for number in range(1, size + 1):
        tags = tuple(sorted({"urban", f"{('intersection', 'simulated', 'comfort')[number % 3]}"}))
        changes = {"scenario_id": f"ZAM_Town{_letters(number)}-{number}_1_T-1", "tags": tags}
        add_facts(connection, number, one.model_copy(update=changes))
    connection.execute("COMMIT")
    connection.close()
    return path


def _letters(number: int) -> str:
    return "".join(chr(ord("a") + int(digit)) for digit in str(number % 300))


def _search(size: int, folder: Path, **slots: Any) -> Work:
    path = _catalogue(size, folder)

    def found() -> object:
        with sqlite3.connect(path) as connection:
            search = Search(connection, FindScenariosArguments(**slots))
            return search.answer("search", search.find(None), None)

    return _again(found, 10)


def _filters(size: int, folder: Path) -> Work:
    return _search(size, folder, tags=["urban"], city="Towna", obstacles=["car>=1"])


def _diverse(size: int, folder: Path) -> Work:
    return _search(size, folder, tags=["urban"], diverse=10)


def _no_match(size: int, folder: Path) -> Work:
    return _search(size, folder, tags=["urban"], obstacles=["car>=1000"])


def _facets(size: int, folder: Path) -> Work:
    path = _catalogue(size, folder)

    def counted() -> object:
        with sqlite3.connect(path) as connection:
            return scenario_facets(connection, "all", None)

    return _again(counted, 10)


def _text(method: str) -> Callable[[int, Path], Work]:
    def prepared(size: int, folder: Path) -> Work:
        path, index = _catalogue(size, folder), folder / "index"
        if method == "semantic":
            build_index(BuildIndexRequest(database=path, index=index), silent)
        request = RankRequest.model_validate(
            {
                "database": path,
                "index": index,
                "text": "a busy crossing",
                "candidates": None,
                "method": method,
                "limit": size,
            }
        )
        return _again(lambda: rank(request, silent), 10)

    return prepared


def _index(size: int, folder: Path) -> Work:
    path = _catalogue(size, folder)
    return lambda: build_index(BuildIndexRequest(database=path, index=folder / "index"), silent)


class _Note(Model):
    text: str = "a record"


def _artifacts(size: int, folder: Path) -> Workspace:
    workspace = Workspace(folder / "workspace")
    recipes = (Recipe(tool="find_scenarios", arguments={"number": number}) for number in range(size))
    workspace.put_staged([NewArtifact("search", f"search_{recipe.digest}", recipe, _Note(), {}) for recipe in recipes])
    return workspace


def _listing(size: int, folder: Path) -> Work:
    workspace = _artifacts(size, folder)
    return _again(lambda: workspace.newest(text="no such text", limit=20), 50)


def _lookup_of_unknown(size: int, folder: Path) -> Work:
    workspace = _artifacts(size, folder)

    def refused() -> None:
        try:
            workspace.get("search_zzzzzzzzzzzz", "search")
        except InvalidRequest:
            return

    return _again(refused, 10)


# Weight files and arguments


def _weights(size: int, folder: Path) -> Work:
    path = folder / "weights.yaml"
    lines = [f"  weight_{number}: {number}.5" for number in range(size)]
    path.write_text("\n".join(["cost_weights:", *lines, ""]), encoding="utf-8")
    return _again(lambda: read_weight_file(path), 10)


def _arguments(model: type[Model], **given: Callable[[int], list[Any]]) -> Callable[[int, Path], Work]:
    def prepared(size: int, folder: Path) -> Work:
        del folder
        arguments = {name: made(size) for name, made in given.items()}

        def validated() -> None:
            try:
                read_arguments(model, arguments)
            except InvalidRequest:
                return

        return _again(validated, 50)

    return prepared


def _ids(size: int) -> list[Any]:
    return [f"ZAM_Growth-{number}_1_T-1" for number in range(size)]


def _wrong_edits(size: int) -> list[Any]:
    return [{"op": "set_sped", "vehicles": [number], "sped": number} for number in range(size)]


SUBJECTS: tuple[Subject, ...] = (
    Subject("map: roundabouts", _doubled(100), _map_of(rings)),
    Subject("map: ways", _doubled(250), _map_of(streets)),
    Subject("map: nodes a way", _doubled(200), _map_of(lambda path, size: streets(path, 20, size))),
    Subject("map: streets that a place is looked for in", _doubled(4000), _place_among_streets),
    Subject("map: maps that a place is looked for in", _doubled(500), _place_among_maps),
    Subject("network: SUMO grid to lanelets", _doubled(4), _grid),
    Subject("network: lanelets to SUMO", _doubled(50), _network_of(_row, _net_of)),
    Subject("network: rules", _doubled(50), _network_of(_row, _checked)),
    Subject("network: stacked lanelets to SUMO", _doubled(100), _network_of(stack, _net_of)),
    Subject("network: rules on stacked lanelets", _doubled(200), _network_of(stack, _checked)),
    Subject("network: links of one junction to SUMO", _doubled(64), _network_of(star, _net_of)),
    Subject("network: rules on links of one junction", _doubled(128), _network_of(star, _checked)),
    *(
        Subject(f"{work}: {axis}", sizes, _on_scenario(draw, on_file))
        for axis, (draw, sizes) in _AXES.items()
        for work, on_file in _ON_SCENARIOS.items()
    ),
    Subject("catalogue: search by filters", _doubled(500), _filters),
    Subject("catalogue: search with a diverse choice", _doubled(500), _diverse),
    Subject("catalogue: search without a match", _doubled(500), _no_match),
    Subject("catalogue: counts", _doubled(500), _facets),
    Subject("catalogue: words of a text", _doubled(500), _text("bm25")),
    Subject("catalogue: meaning of a text", _doubled(250), _text("semantic")),
    Subject("catalogue: index of texts", _doubled(100), _index),
    Subject("workspace: listing by text", _doubled(2000), _listing),
    Subject("workspace: an id that is not there", _doubled(1000), _lookup_of_unknown),
    Subject("weight file: entries", _doubled(25), _weights),
    Subject("arguments: ids of a grid", _doubled(250), _arguments(RunPlannerArguments, scenarios=_ids)),
    Subject("arguments: wrong edits", _doubled(100), _arguments(ModifyScenarioArguments, edits=_wrong_edits)),
)
"""In the order of measurement; the sizes start at an input that takes about 50 ms, if limits allow it."""
