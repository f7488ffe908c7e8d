"""Builds the starter catalogue from the built-in maps with this generator.

``python -m plannerforge.engine.generation.starter_catalog`` writes the catalogue package's ``starter.zip``. On one type
of machine, the bytes are always the same (fixed order, fixed times of day, no dates).
"""

import json
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from ...schemas.generation import Density, GenerationRequest, RequestedGoal, SiteType, VehicleDemand
from ...schemas.scenarios import ReadFactsRequest
from ..catalog import ARCHIVE
from ..execution import silent
from ..maps import MapEntry, built_in_maps
from ..scenarios import read_facts
from .generator import generate_scenario

FIXED_TIME = (2025, 1, 1, 0, 0, 0)
"""The date of all members of the archive: a real date would make its bytes differ from day to day."""


STARTER_GOAL = "steps:50"
"""The default goal of the starter's scenarios: most last 10 to 12 s, in which few cars pass a whole site."""


@dataclass(frozen=True)
class _Plan:
    """One scenario of the starter catalogue; ``classes`` are the classes other than car."""

    place: str
    scenario_type: SiteType
    density: Density
    classes: tuple[str, ...]
    duration_s: float
    seed: int
    goal: str = STARTER_GOAL


PLANS = (
    _Plan("Musterstadt", "signalised_intersection", "low", ("bus",), 12, 1),
    _Plan("Musterstadt", "signalised_intersection", "medium", ("truck", "motorcycle"), 10, 2),
    _Plan("Musterstadt", "intersection", "low", ("bicycle",), 12, 3),
    _Plan("Fahrhausen", "intersection", "low", ("truck",), 12, 4),
    _Plan("Fahrhausen", "intersection", "low", ("bicycle", "bus"), 12, 5, "distance_m:40"),
    _Plan("Fahrhausen", "urban", "low", ("delivery",), 12, 6),
    _Plan("Kreiselheim", "roundabout", "low", ("bicycle",), 12, 7),
    _Plan("Kreiselheim", "roundabout", "medium", ("truck", "taxi"), 10, 8),
    _Plan("Kreiselheim", "roundabout", "low", ("bus", "motorcycle"), 12, 9, "steps:70"),
    _Plan("Neuland", "highway", "low", ("truck",), 12, 10),
    _Plan("Neuland", "highway", "medium", ("truck", "coach"), 10, 11, "distance_m:120"),
    _Plan("Neuland", "ramp", "low", ("truck",), 12, 12),
    _Plan("Neuland", "ramp", "medium", ("trailer", "motorcycle"), 10, 13),
    _Plan("Quadratstadt", "urban", "low", ("bus", "bicycle"), 12, 14),
    _Plan("Quadratstadt", "signalised_intersection", "medium", ("emergency", "taxi"), 10, 15),
    _Plan("Quadratstadt", "urban", "high", ("truck", "bicycle"), 8, 16),
    _Plan("Landmoor", "rural", "low", ("truck",), 12, 17),
    _Plan("Landmoor", "rural", "low", ("bus", "motorcycle"), 12, 18, "distance_m:100"),
    _Plan("Musterstadt", "signalised_intersection", "high", ("taxi", "coach"), 10, 19),
    _Plan("Musterstadt", "urban", "low", ("delivery", "moped"), 12, 20, "distance_m:60"),
    _Plan("Fahrhausen", "intersection", "medium", ("motorcycle",), 12, 21),
    _Plan("Fahrhausen", "urban", "high", ("bicycle", "moped"), 10, 22),
    _Plan("Kreiselheim", "roundabout", "high", ("coach",), 10, 23),
    _Plan("Kreiselheim", "intersection", "low", ("emergency",), 12, 24),
    _Plan("Neuland", "highway", "high", ("trailer", "truck"), 10, 25),
    _Plan("Neuland", "highway", "low", ("emergency", "motorcycle"), 15, 26, "distance_m:200"),
    _Plan("Neuland", "ramp", "high", ("truck", "delivery"), 10, 27),
    _Plan("Neuland", "rural", "medium", ("trailer",), 12, 28),
    _Plan("Quadratstadt", "intersection", "medium", ("bus",), 12, 29, "steps:70"),
    _Plan("Quadratstadt", "signalised_intersection", "low", ("delivery", "bicycle"), 12, 30),
    _Plan("Landmoor", "rural", "medium", ("trailer", "coach"), 12, 31),
    _Plan("Landmoor", "intersection", "low", ("truck",), 12, 32),
)


def build(target: Path) -> list[str]:
    """Generate all scenarios, write the archive, and return the scenarios' ids in order.

    The archive contains ``manifest.json`` (each scenario's recipe), ``facts.json`` (the scenarios' facts, by id), and
    the files.
    """
    maps = {entry.facts.place: entry for entry in built_in_maps()}
    members: dict[str, bytes] = {}
    facts: dict[str, object] = {}
    manifest: list[dict[str, object]] = []
    for number, plan in enumerate(PLANS, start=1):
        with tempfile.TemporaryDirectory() as folder:
            request = _request(plan, maps[plan.place], number, folder)
            made = generate_scenario(request, silent)
            xml, net = Path(folder) / "scenario.xml", Path(folder) / "scenario.net.xml"
            members[f"scenarios/{made.benchmark_id}.xml"] = xml.read_bytes()
            members[f"scenarios/{made.benchmark_id}.net.xml"] = net.read_bytes()
            facts[made.benchmark_id] = read_facts(ReadFactsRequest(path=xml), silent).model_dump(mode="json")
        arguments = request.model_dump(mode="json", exclude={"folder", "map_path"})
        manifest.append({"id": made.benchmark_id, "tool": "generate_scenarios", "arguments": arguments})
    members["manifest.json"] = _json(manifest)
    members["facts.json"] = _json(facts)
    _write(target, members)
    return [str(entry["id"]) for entry in manifest]


def _request(plan: _Plan, entry: MapEntry, number: int, folder: str) -> GenerationRequest:
    return GenerationRequest(
        map_path=str(entry.path),
        map_id=entry.facts.map_id,
        place=entry.facts.place,
        country=entry.facts.country,
        attribution=entry.facts.attribution,
        scenario_type=plan.scenario_type,
        density=plan.density,
        vehicles=tuple(VehicleDemand(vehicle_class=name) for name in plan.classes),
        duration_s=plan.duration_s,
        goal=RequestedGoal.of(plan.goal),
        seed=plan.seed,
        benchmark_number=number,
        folder=folder,
    )


def _json(content: object) -> bytes:
    return json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False).encode() + b"\n"


def _write(target: Path, members: dict[str, bytes]) -> None:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_LZMA) as archive:
        for name in sorted(members):
            entry = zipfile.ZipInfo(name, FIXED_TIME)
            entry.compress_type = zipfile.ZIP_LZMA
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, members[name])


if __name__ == "__main__":
    build(Path(__file__).parents[1] / "catalog" / ARCHIVE)
