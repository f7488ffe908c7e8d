"""Sends the corpus's requests without a local map, against Nominatim and Overpass services on this machine.

The services of ``loopback.py`` serve the real extracts at their places, and moved ones for places without an extract
(``earth.py``). Every request goes through a client's session. The judges of ``make bench-generation`` examine the
stored files, together with what the services know.

Keys:

- ``online_requests``: requests that can be met; ``online_done``: share that succeeds as requested: number of scenarios,
  type of road, vehicles, place, country, street, box, density or the reason against it, and the source of the roads.
- ``online_local_done``: the same for places with an extract, with the extracts available locally.
- ``online_refused``: requests that must be refused; ``online_refused_right``: share refused correctly.
- ``faults``: cases of faulty services; ``faults_survived``: those in which the scenario is generated and the fault
  reported, or the refusal reports it and nothing is stored.
- ``cache_same_bytes``: share of requests that a fresh workspace answers with the same bytes from the cache alone, with
  the services stopped.
- ``online_median_s``: time per request, including pauses for the services' usage policy; ``online_asked``: median
  number of service requests per scenario.
"""

import json
import shutil
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.commonroad import schema_errors
from plannerforge.engine.workspace import Workspace
from plannerforge.evals.ground_truth.generation import BenchRequest, Refusal, corpus_refusals, corpus_requests
from plannerforge.evals.scoring.made_files import (
    EXIT_WITHIN_M,
    STREET_WITHIN_M,
    MadeFiles,
    has_vehicles,
    is_at_street,
    is_in_box,
    judge_density,
    shows_type,
)
from plannerforge.schemas.generation import GeneratedScenario
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import ANSWERS_FOLDER, Settings
from plannerforge.server.tool_calls import answer_text

from ..harness import Figures, share
from .bench import MapsBench
from .earth import STAND_INS, Earth, Region, earth_for
from .extracts import Extract
from .loopback import Fault, FaultKind, MapServers, places_in, settlement

_BEYOND_DEG, _BEYOND_BOX_DEG = 0.01, 0.0001
"""Tolerance of an extract's bounds, beyond which its roads extend; a requested box allows only rounding (10 m)."""
_SAME_BYTES = 8
"""Number of requests repeated from the cache (chosen)."""
_TIMEOUT_S = 3.0
"""Time limit for a service in the cases of faults."""
_CODES = {
    "unknown_place": "[unknown_name]",
    "no_map_here": "[unknown_name]",
    "no_such_site": "[not_possible]",
    "unknown_class": "[unknown_name]",
    "invalid_value": "[invalid_request]",
}
"""The code of the right refusal, by its reason."""


@dataclass(frozen=True)
class _Answered:
    """The result of a call: its text, the scenarios that it names, its duration, and the requests to the services."""

    text: str
    refused: bool
    scenarios: tuple[str, ...]
    seconds: float
    asked: int


def measure(bench: MapsBench) -> Figures:
    """Measure all of it."""
    return anyio.run(_measure, bench)


async def _measure(bench: MapsBench) -> Figures:
    text = (bench.shared / "corpora" / "dev" / "generation.jsonl").read_text(encoding="utf-8")
    lines = [json.loads(line) for line in text.splitlines()]
    earth = earth_for(lines, bench.maps, bench.folder("online_extracts"))
    good = _good(lines, earth)[: bench.limit]
    bad = corpus_refusals([json.dumps(line) for line in lines if line["expect"] == "refuse"])[: bench.limit]
    with MapServers(earth.extracts, earth.places).running() as servers:
        figures = await _requests(bench, servers, earth, good)
        figures |= await _refusals(bench, servers, bad)
    figures |= await _local(bench, earth, [one for one in good if one.map_name not in STAND_INS])
    return figures | await _same_bytes(bench, good) | await _faults(bench)


def _good(lines: Sequence[Mapping[str, Any]], earth: Earth) -> list[BenchRequest]:
    """Measure the feasible requests, with the region of each in place of its map."""
    named = [{**line, "map": line["map"] or line["id"]} for line in lines]
    return corpus_requests([json.dumps(line) for line in named], frozenset(earth.regions))


def _settings(bench: MapsBench, workspace: Path, servers: MapServers, **more: Any) -> Settings:
    return Settings(
        workspace=workspace,
        roots=(bench.scratch,),
        workers=bench.workers,
        starter=False,
        warm_up=False,
        journal=False,
        **{
            "maps_online": "online",
            "nominatim_url": servers.nominatim,
            "overpass_urls": servers.mirrors,
            "maps_delay_s": 0.0,
            **more,
        },
    )


async def _call(client: Client, given: Mapping[str, Any], servers: MapServers | None = None) -> _Answered:
    before = len(servers.requests) if servers is not None else 0
    started = time.perf_counter()
    result = await client.call_tool("generate_scenarios", dict(given))
    made = (result.structured_content or {}).get("scenarios", [])
    asked = len(servers.requests) - before if servers is not None else 0
    ids = tuple(str(one["scenario_id"]) for one in made)
    return _Answered(answer_text(result), bool(result.is_error), ids, time.perf_counter() - started, asked)


def _given(request: BenchRequest) -> dict[str, Any]:
    return request.arguments.model_dump(mode="json", exclude_defaults=True)


async def _requests(
    bench: MapsBench, servers: MapServers, earth: Earth, requests: Sequence[BenchRequest]
) -> dict[str, float | int]:
    workspace = bench.scratch / "online"
    done: list[bool] = []
    seconds: list[float] = []
    asked: list[int] = []
    async with Client(create_server(_settings(bench, workspace, servers))) as client:
        for request in requests:
            answered = await _call(client, _given(request), servers)
            faults = _describe_faults(request, answered, earth.regions[request.map_name], workspace)
            if not answered.refused and "downloaded" not in answered.text:
                faults.append("does not say where the roads come from")
            _say(request.name, faults, answered)
            done.append(not faults)
            seconds.append(answered.seconds)
            asked.append(answered.asked)
    return {
        "online_requests": len(done),
        "online_done": share(done),
        "online_median_s": round(statistics.median(seconds), 1),
        "online_asked": statistics.median(asked),
    }


async def _local(bench: MapsBench, earth: Earth, requests: Sequence[BenchRequest]) -> dict[str, float]:
    """Measure the same requests with the extracts in the library and without services."""
    workspace, done = bench.scratch / "local", []
    settings = Settings(
        workspace=workspace, roots=(bench.maps,), workers=bench.workers, starter=False, warm_up=False, journal=False,
        maps_online="offline",
    )  # fmt: skip
    async with Client(create_server(settings)) as client:
        for name in sorted({request.map_name for request in requests}):
            region = earth.regions[name]
            given = {"path": str(bench.maps / name), "name": region.towns[0], "country": region.country}
            await client.call_tool("import_files", given)
        for request in requests:
            answered = await _call(client, _given(request))
            faults = _describe_faults(request, answered, earth.regions[request.map_name], workspace)
            _say(f"{request.name} (local)", faults, answered)
            done.append(not faults)
    return {"online_local_done": share(done)}


def _describe_faults(request: BenchRequest, answered: _Answered, region: Region, workspace: Path) -> list[str]:
    """Return the deviations from the request, a few words each."""
    if answered.refused:
        return [f"refused: {answered.text}"]
    asked = min(request.arguments.count, region.most.get(request.arguments.scenario_type, request.arguments.count))
    faults = [] if len(answered.scenarios) == asked else [f"{len(answered.scenarios)} of {asked} scenarios"]
    if len(set(answered.scenarios)) != len(answered.scenarios):
        faults.append("a scenario twice")
    for scenario_id in answered.scenarios:
        folder = workspace / "scenarios" / scenario_id
        faults += [f"{scenario_id}: {fault}" for fault in _faults_of(request, scenario_id, folder, region)]
    return faults


def _faults_of(request: BenchRequest, scenario_id: str, folder: Path, region: Region) -> list[str]:
    asked, files = request.arguments, MadeFiles.read(folder)
    report = GeneratedScenario.model_validate_json((folder / "generation.json").read_bytes())
    stated = report.site.scenario_type
    within_m = EXIT_WITHIN_M if stated == "ramp" else STREET_WITHIN_M
    recorded = report.recorded_s >= asked.duration_s - 0.05 or any("are recorded" in note for note in report.notes)
    verdicts = {
        "breaks the schema": not schema_errors(folder / "scenario.xml"),
        f"shows no {stated}": shows_type(files, stated, region.evidence),
        f"is {stated}": asked.scenario_type in (stated, "any"),
        "lacks vehicles": has_vehicles(files, _required(asked.vehicles)),
        "is elsewhere": is_in_box(files, region.extract.box, _BEYOND_DEG),
        "is outside the box": asked.bbox is None or is_in_box(files, asked.bbox, _BEYOND_BOX_DEG),
        "is at another street": request.street is None
        or is_at_street(files, request.street, region.towns, region.evidence, within_m),
        "is in another country": asked.country in (None, scenario_id[:3]),
        "density": judge_density(files, asked.density, report.notes).honest,
        "duration": recorded,
    }
    return [fault for fault, is_right in verdicts.items() if not is_right]


def _required(texts: Sequence[str]) -> dict[str, tuple[int, int | None]]:
    """Return (least, most) of each class in the corpus's arguments: ``truck``, ``truck=2``, ``car=4..4``."""
    required: dict[str, tuple[int, int | None]] = {}
    for text in texts:
        name, _, count = text.partition("=")
        least, _, most = count.partition("..")
        required[name] = (int(least or 1), int(most) if most else None)
    return required


async def _refusals(bench: MapsBench, servers: MapServers, refusals: Sequence[Refusal]) -> dict[str, float | int]:
    """Measure requests that must be refused, with those that only a person can decide: which Springfield, which box."""
    workspace = bench.scratch / "refusals"
    cases = [(refusal.name, dict(refusal.given), _expected_text(refusal)) for refusal in refusals]
    springfields = ("Springfield, Illinois", "Springfield, Missouri", "Springfield, Massachusetts", "place=")
    cases.append(("ambiguous", {"place": "Springfield", "country": "USA"}, ("[invalid_request]", *springfields)))
    cases.append(("box", {"place": "Vienna", "bbox": [48.2, 16.4, 48.1, 16.3]}, ("[invalid_request]", "bbox")))
    right: list[bool] = []
    async with Client(create_server(_settings(bench, workspace, servers))) as client:
        for name, given, words in cases:
            plain = {key: value for key, value in given.items() if value is not None}
            answered = await _call(client, plain, servers)
            missing = [word for word in words if word not in answered.text] if answered.refused else ["a refusal"]
            _say(name, [f"lacks {word}" for word in missing], answered)
            right.append(not missing)
    stored = _stored(workspace, "scenario")
    if stored:
        sys.stderr.write(f"stored though refused: {stored}\n")
    return {"online_refused": len(right), "online_refused_right": 0.0 if stored else share(right)}


def _expected_text(refusal: Refusal) -> tuple[str, ...]:
    """Return the required text of a right refusal: its code, and one word for the fault."""
    return (_CODES[refusal.reason], *refusal.subjects[:1])


async def _same_bytes(bench: MapsBench, requests: Sequence[BenchRequest]) -> dict[str, float]:
    """Repeat earlier requests in a workspace that has only the cached responses, with the services stopped."""
    first, second = bench.scratch / "online", bench.scratch / "again"
    if not requests:
        return {"cache_same_bytes": 0.0}
    shutil.copytree(first / ANSWERS_FOLDER, second / ANSWERS_FOLDER)
    verdicts: list[bool] = []
    chosen = requests[:: max(1, len(requests) // _SAME_BYTES)][:_SAME_BYTES]
    with MapServers((), ()).running() as stopped:
        settings = _settings(bench, second, stopped, maps_online="cache", nominatim_url=_kept_address(first))
    async with Client(create_server(settings)) as client:
        for request in chosen:
            answered = await _call(client, _given(request))
            pairs = [
                (root / "scenarios" / key / "scenario.xml" for root in (first, second)) for key in answered.scenarios
            ]
            same = [one.is_file() and one.read_bytes() == other.read_bytes() for one, other in pairs]
            _say(f"{request.name} (kept)", [] if same and all(same) else ["other bytes"], answered)
            verdicts.append(bool(same) and all(same))
    return {"cache_same_bytes": share(verdicts)}


def _kept_address(workspace: Path) -> str:
    """Return the address of the Nominatim with cached responses in a workspace, as it is part of the request."""
    import gzip

    for path in sorted((workspace / ANSWERS_FOLDER).glob("*.json.gz")):
        kind, address, *_ = json.loads(gzip.decompress(path.read_bytes()))["question"].split(" ")
        if kind == "nominatim":
            return str(address)
    return "http://127.0.0.1:9"


@dataclass(frozen=True)
class _FaultCase:
    """Faulty services, and the required end: survived, or reported in these words."""

    name: str
    faults: Mapping[str, tuple[Fault, ...]]
    survives: bool
    told: tuple[str, ...]


_MIRRORS = ("one", "two", "three", "four")
_NOTES_BY_KIND: Mapping[FaultKind, str] = {
    "429": "429",
    "504": "504",
    "403": "refuses (403)",
    "slow": "in time",
    "drip": "too slowly",
    "cut": "broke off",
    "html": "page instead of data",
    "garbage": "not the JSON",
    "remark": "gave up",
    "redirect": "redirects",
    "no_slot": "no slot",
}
"""The answer's text for each kind of fault."""


def _fault_cases() -> list[_FaultCase]:
    """Return each fault of the first service, of all, and of Nominatim, and faults that do not belong to one
    service.
    """
    cases: list[_FaultCase] = []
    for kind, told in _NOTES_BY_KIND.items():
        often = Fault(kind, 2)
        cases.append(_FaultCase(f"{kind} of the first", {"one": (often,)}, True, (told,)))
        cases.append(
            _FaultCase(f"{kind} of all", dict.fromkeys(_MIRRORS, (often,)), False, (told, "[service_failure]"))
        )
        if kind not in ("no_slot", "remark"):
            cases.append(_FaultCase(f"{kind} of Nominatim", {"nominatim": (often,)}, False, (told, "Nominatim")))
    empty = Fault("empty", 9)
    return [
        *cases,
        _FaultCase("429 once, with Retry-After", {"one": (Fault("429", 1, wait_s=1),)}, True, ("downloaded",)),
        _FaultCase("504 once of Nominatim", {"nominatim": (Fault("504"),)}, True, ("downloaded",)),
        _FaultCase("429 for an hour", {"one": (Fault("429", 1, wait_s=3600),)}, True, ("429",)),
        _FaultCase("empty of the first", {"one": (Fault("empty"),)}, True, ("has nothing there",)),
        _FaultCase("empty of all", dict.fromkeys(_MIRRORS, (empty,)), False, ("[not_possible]", "on OpenStreetMap")),
        _FaultCase("unknown to Nominatim", {"nominatim": (empty,)}, False, ("[unknown_name]", "no such place")),
        _FaultCase("200 MB", {"one": (Fault("huge"),)}, False, ("[not_possible]", "60 MB")),
    ]


async def _faults(bench: MapsBench) -> dict[str, float | int]:
    """Measure every case at its own town, so that the cache does not help; then an area over the limit, and no
    network.
    """
    cases = _fault_cases()[: bench.limit]
    workspace = bench.scratch / "faulty"
    extracts = [
        Extract.read(bench.maps / "ALB_Korce-1.osm", middle=(-40 + 1.5 * number, 20.0), nameless=True)
        for number in range(len(cases) + 2)
    ]
    towns = [settlement([f"Faultville {number}"], "ZAF", one.box) for number, one in enumerate(extracts)]
    roads = [place for number, one in enumerate(extracts) for place in places_in(one, f"Faultville {number}", "ZAF")]
    verdicts: list[bool] = []
    with MapServers(extracts, [*towns, *roads]).running() as servers:
        settings = _settings(bench, workspace, servers, maps_timeout_s=_TIMEOUT_S)
        async with Client(create_server(settings)) as client:
            for number, case in enumerate(cases):
                for service, faults in case.faults.items():
                    servers.fail(service, *faults)
                verdicts.append(await _is_met(client, case, f"Faultville {number}", workspace, servers))
                servers.faults.clear()
            south, west, _, _ = extracts[-2].box
            given = {"bbox": [south - 1, west - 1, south + 1, west + 1], "scenario_type": "roundabout"}
            too_large = await _call(client, given, servers)
            verdicts.append("too large to fetch whole" in too_large.text)
            _say("an area over the limit", [] if verdicts[-1] else ["not told"], too_large)
            servers.stop()
            stopped = await _call(client, {"place": f"Faultville {len(cases) + 1}"}, servers)
            verdicts.append(stopped.refused and "cannot be reached" in stopped.text and stopped.seconds < 30)
            _say("no net", [] if verdicts[-1] else ["not told"], stopped)
    left = [path.name for path in (workspace / ANSWERS_FOLDER).iterdir() if path.name.endswith(".partial")]
    verdicts.append(not left and not list((workspace / "scratch").glob("*")))
    return {"faults": len(verdicts), "faults_survived": share(verdicts)}


async def _is_met(client: Client, case: _FaultCase, town: str, workspace: Path, servers: MapServers) -> bool:
    maps, made = _stored(workspace, "map"), _stored(workspace, "scenario")
    answered = await _call(client, {"place": town, "scenario_type": "roundabout", "seed": 1}, servers)
    faults = [] if answered.refused != case.survives else ["refused" if answered.refused else "made"]
    faults += [f"does not tell {word}" for word in case.told if word not in answered.text]
    if answered.refused and (_stored(workspace, "map"), _stored(workspace, "scenario")) != (maps, made):
        faults.append("left something behind")
    _say(case.name, faults, answered)
    return not faults


def _stored(workspace: Path, kind: str) -> list[str]:
    """Return the ids of a workspace's artifacts of a kind, and their existing folders."""
    opened = Workspace(workspace)
    try:
        ids = [one.artifact_id for one in opened.newest(kind=kind, limit=1000)]  # type: ignore[arg-type]
    finally:
        opened.close()
    return sorted({*ids, *(path.name for path in (workspace / f"{kind}s").glob("*"))})


def _say(name: str, faults: Sequence[str], answered: _Answered) -> None:
    verdict = "; ".join(faults) or "right"
    sys.stderr.write(f"{name}: {verdict} ({answered.seconds:.1f} s, {answered.asked} asked)\n")
    if faults:
        sys.stderr.write(f"    {answered.text[:600]}\n")
