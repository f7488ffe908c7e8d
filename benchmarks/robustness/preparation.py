"""The start of a campaign: a workspace with a few artifacts of every kind, and valid files to mutate."""

import io
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..harness import ask, shared_folder
from .arguments import Surface, hostile_arguments
from .files import Seed, hostile_files
from .holes import hostile_holes
from .inputs import Chance, HostileInput
from .server_process import Folders, plannerforge_server, session

_SCENARIOS = ("ZAM_Zip-1_1_T-1", "ZAM_test_0-1", "DEU_Moelln-7_1_T-1", "DEU_IV21-1_1_T-1", "BEL_Antwerp-30_1_T-1")
_MAPS = ("planet_10.068_48.135_10.071_48.137.osm", "o2s_overlapping_service_roads.osm", "bautzen.osm")
_BINARY_MAP = "o2s_frederiksted.osm.pbf"
"""Small real files that take milliseconds to process."""


@dataclass(frozen=True)
class Prepared:
    """The folders of a server that has worked before, its offer, and the files to mutate."""

    folders: Folders
    surface: Surface
    scenario_id: str
    seeds: dict[str, list[Seed]]

    def inputs(self, kind: str, chance: Chance) -> Iterator[HostileInput]:
        """Yield endless hostile inputs of a kind: of every hundred, arguments 70, files 28, known holes 2."""
        arguments = hostile_arguments(self.surface, self.scenario_id, chance)
        files = hostile_files(self.seeds, chance)
        holes = hostile_holes(self.seeds, self.scenario_id, chance)
        only = {"args": arguments, "files": files, "holes": holes}.get(kind)
        while True:
            way = chance.random()
            yield next(only or (arguments if way < 0.7 else files if way < 0.98 else holes))


async def prepared(base: Path) -> Prepared:
    """Start a server, have it make a little of everything, and read the sound files."""
    folders = Folders(base / "template").make()
    shared = shared_folder() / "data"
    small = [shared / "commonroad" / f"{name}.xml" for name in _SCENARIOS]
    (folders.root / "small.xml").write_bytes(small[0].read_bytes())
    async with session(folders, base / "preparation.log", plannerforge_server()) as running:
        client = running.client
        tools = {tool.name: dict(tool.input_schema) for tool in (await client.list_tools()).tools}
        templates = [each.uri_template for each in (await client.list_resource_templates()).resource_templates]
        prompts = {
            each.name: [argument.name for argument in each.arguments or ()]
            for each in (await client.list_prompts()).prompts
        }
        imported = await ask(client, "import_files", path=str(folders.root / "small.xml"))
        scenario_id = str(imported["items"][0]["artifact_id"])
        await ask(client, "find_scenarios", limit=3)
        await ask(client, "run_planner", scenarios=[scenario_id], configs=["idm"], wait_s=45)
        configuration = (await ask(client, "configure_planner", weights=["lateral_jerk=0.3"]))["config_id"]
        await ask(client, "export_artifacts", ids=[configuration], folder=str(folders.root / "out"), formats=["yaml"])
        weights = next((folders.root / "out").rglob("*.yaml")).read_bytes()
    maps = [Seed(".osm", (shared / "osm" / name).read_bytes()) for name in _MAPS]
    seeds = {
        ".xml": [Seed(".xml", path.read_bytes()) for path in small],
        ".osm": maps,
        ".net.xml": [Seed(".net.xml", _small_net(base / "small.net.xml"))],
        ".yaml": [Seed(".yaml", weights)],
        ".osm.gz": [Seed(".osm.gz", maps[0].content)],
        ".osm.bz2": [Seed(".osm.bz2", maps[0].content)],
        ".zip": [Seed(".zip", _small_archive(small))],
        ".osm.pbf": [Seed(".osm.pbf", (shared / "osm" / _BINARY_MAP).read_bytes())],
    }
    return Prepared(folders, Surface(tools, templates, prompts), scenario_id, seeds)


def _small_archive(paths: Sequence[Path]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in paths[:2]:
            archive.writestr(zipfile.ZipInfo(path.name), path.read_bytes())
    return packed.getvalue()


def _small_net(path: Path) -> bytes:
    program = Path(sys.executable).parent / "netgenerate"
    subprocess.run(
        [str(program), "--grid", "--grid.number=2", "--grid.attach-length=60", "-o", str(path)],
        check=True,
        capture_output=True,
        timeout=60,
    )
    return path.read_bytes()
