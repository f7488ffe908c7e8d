"""Every line of the tuning corpus as arguments of ``configure_planner``, judged by the numbers of the corpus.

Before each request its context becomes the active configuration. Then the bench makes the call that the truth implies:
a preset, absolute values, or relative changes in the tool's notation (``jerk*2``, ``jerk+0.1``, ``jerk=lateral_jerk``),
so that the product does the arithmetic. A request outside the vocabulary is sent as it is. The result is read from the
YAML in the answer.

A line is exact if every weight is within 1e-3 (relative) of the truth, including unchanged ones and the three external
ones. If the truth gives only a direction, one of the named weights must move that way and no other weight may move. For
MP-RBFN's presets, which the corpus does not know, unnamed weights are compared with ``list_planners``. A refusal is
right if the tool refuses, names the refused part, and creates no configuration. Lines that need a question have no
arguments.

Each resulting configuration of MP-RBFN drives one scenario.

Keys: ``requests_exact``: share of exact lines; ``refused_right``: share of right refusals; ``requests_of_rbfn``: share
of exact lines for MP-RBFN alone; ``rbfn_lines``: their number; ``rbfn_driven``: share of their configurations that
drove; ``requests``: number of lines.
"""

import math
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import anyio
import yaml
from mcp import Client

from plannerforge.evals.attempts import EvalRequest
from plannerforge.evals.corpora import read_corpus
from plannerforge.evals.oracle import calls_of
from plannerforge.server.assembly import create_server

from ..harness import (
    Figures,
    SeededBench,
    ask,
    attempted_runs,
    finished_batch,
    import_scenarios,
    scenario_files,
    settings_for,
    share,
)

_TOLERANCE = 1e-3
"""Relative tolerance, as in the paper."""
_FACTOR = {"up": "+0.3", "down": "*0.5"}
"""The change for a direction without a value (chosen)."""
Weights = Mapping[str, float]


def measure(bench: SeededBench) -> Figures:
    """Return the keys above; with a limit, of so many lines."""
    return anyio.run(_measured, bench)


async def _measured(bench: SeededBench) -> Figures:
    folder = bench.scratch / "requests"
    lines = read_corpus(bench.shared / "corpora" / "dev" / "tuning.jsonl")[: bench.limit]
    exact: dict[str, bool] = {}
    refused: dict[str, bool] = {}
    made: dict[str, str] = {}
    async with Client(create_server(settings_for(folder, bench.shared, 1))) as client:
        for line in (line for line in lines if line.expect != "clarify"):
            base = await _context(client, line)
            arguments = {**calls_of(line)[0].arguments, "base": base["config_id"]}
            if line.expect == "refuse":
                refused[line.request_id] = await _is_refused(client, line, arguments)
                continue
            arguments["weights"] = list(_changes(line.truth))
            answer = await ask(client, "configure_planner", **arguments)
            preset = await _shown(client, line)
            exact[line.request_id] = _is_exact(line.truth, _read(base["yaml"]), _read(answer["yaml"]), preset)
            if line.truth["planner"] == "mp_rbfn":
                made[line.request_id] = answer["config_id"]
        driven = await _driven(client, bench, sorted(set(made.values())))
    for wrong in [name for name, right in {**exact, **refused}.items() if not right]:
        sys.stderr.write(f"{wrong} is wrong\n")
    return {
        "requests_exact": share(exact.values()),
        "refused_right": share(refused.values()),
        "requests_of_rbfn": share(exact[name] for name in made),
        "rbfn_lines": len(made),
        "rbfn_driven": driven,
        "requests": len(lines),
    }


async def _context(client: Client, line: EvalRequest) -> Any:
    """Return the configuration that is in force before a request, as its answer."""
    context = line.context
    given = {**context.get("weights", {}), **context.get("overrides", {})}
    weights = [f"{name}={value}" for name, value in given.items()]
    base = f"{context['planner']}:{context.get('preset') or 'Default'}"
    return await ask(client, "configure_planner", base=base, weights=weights)


def _changes(truth: Mapping[str, Any]) -> Iterator[str]:
    """Yield the changes of weights that a truth comes to, as the tool takes them."""
    for name, value in truth.get("explicit", {}).items():
        yield f"{name}={value}"
    for name, change in truth.get("relative", {}).items():
        if change["op"] == "copy":
            yield f"{name}={change['from']}"
        elif change["op"] == "multiply":
            yield f"{name}*{change['by']}"
        else:
            yield f"{name}{change['by']:+}"
    for one in truth.get("direction", ()):
        yield one["any_of"][0] + _FACTOR[one["sign"]]


async def _shown(client: Client, line: EvalRequest) -> Weights:
    """Return the listed weights of the requested preset, empty if the request has none."""
    preset = line.truth["preset"]
    if preset is None:
        return {}
    listed = await ask(client, "list_planners", planner=line.truth["planner"])
    named = next(one for one in listed["presets"] if one["name"] == preset)
    return {one["name"]: named["weights"].get(one["name"], 0.0) for one in listed["weights"]}


async def _is_refused(client: Client, line: EvalRequest, arguments: Mapping[str, Any]) -> bool:
    async def configurations() -> list[str]:
        listed = await ask(client, "list_artifacts", kind="config")
        return [one["artifact_id"] for one in listed["artifacts"]]

    before = await configurations()
    result = await client.call_tool("configure_planner", {**arguments})
    text = "".join(getattr(part, "text", "") for part in result.content)
    named = all(str(word).replace(" ", "_") in text for word in line.truth["refused"])
    return bool(result.is_error) and named and await configurations() == before


def _read(text: str) -> dict[str, float]:
    """Return all weights of a configuration's file, the external ones with them."""
    content = yaml.safe_load(text)
    sections = [content[name] for name in ("cost_weights", "external_cost_weights") if name in content]
    return {name: float(value) for section in sections for name, value in section.items()}


def _is_exact(truth: Mapping[str, Any], before: Weights, after: Weights, preset: Weights) -> bool:
    moved = {name for name in after if not math.isclose(after[name], before[name], rel_tol=_TOLERANCE)}
    if truth.get("direction"):
        wanted = [_moved_to(one, before, after) for one in truth["direction"]]
        return all(wanted) and len(moved) == len(wanted)
    expected = {**before, **{name: value for name, value in preset.items() if name in after}, **truth["weights"]}
    return after.keys() == expected.keys() and all(
        math.isclose(after[name], value, rel_tol=_TOLERANCE, abs_tol=1e-9) for name, value in expected.items()
    )


def _moved_to(wanted: Mapping[str, Any], before: Weights, after: Weights) -> bool:
    """Return True if one of the named weights moved as requested."""
    sign = 1 if wanted["sign"] == "up" else -1
    return any(sign * (after[name] - before[name]) > 0 for name in wanted["any_of"])


async def _driven(client: Client, bench: SeededBench, configs: list[str]) -> float:
    """Return the share of configurations with a run of one public scenario by MP-RBFN."""
    if not configs:
        return 0.0
    await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", 1))
    batch_id = await finished_batch(client, scenarios=["preset:1"], configs=configs)
    good = [one for one in attempted_runs(bench.scratch / "requests", batch_id) if one.planner == "mp_rbfn"]
    return round(len(good) / len(configs), 4)
