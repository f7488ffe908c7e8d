"""Every line of the tuning corpus as arguments of ``configure_planner``, judged by the numbers of the corpus.

Before each request its context is put in force as a configuration of its own. Then the call is made that the truth
comes to: a preset, stated values, relative changes in the words of the tool (``jerk*2``, ``jerk+0.1``,
``jerk=lateral_jerk``), so that the product does the arithmetic; a request outside the vocabulary goes through as it was
said. What came out is read from the YAML that the answer holds.

A line is exact where every weight is that of the truth within 1e-3 of it, those that the request does not touch and
the three external ones included; where it gives a direction alone, where one of the named weights moved there and
nothing else moved. For MP-RBFN's presets, whose values the corpus does not know, the weights that it does not name are
those that ``list_planners`` shows. A refusal is right where the tool refuses, names what it refuses, and makes no
configuration. Lines at which a question is right have no arguments.

The configurations of MP-RBFN that came out each drive one scenario.

Keys: ``requests_exact``: share of the exact lines; ``refused_right``: share of the right refusals;
``requests_of_rbfn``: share of the exact lines of MP-RBFN alone; ``rbfn_lines``: how many these are;
``rbfn_driven``: share of their configurations whose run was driven; ``requests``: lines in all.
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
"""Relative, as in the paper."""
_FACTOR = {"up": "+0.3", "down": "*0.5"}
"""What stands for a direction without a value (chosen)."""
Weights = Mapping[str, float]


def measure(bench: SeededBench) -> Figures:
    """The keys above; with a limit, of so many lines."""
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
    """The configuration that is in force before a request, as its answer."""
    context = line.context
    given = {**context.get("weights", {}), **context.get("overrides", {})}
    weights = [f"{name}={value}" for name, value in given.items()]
    base = f"{context['planner']}:{context.get('preset') or 'Default'}"
    return await ask(client, "configure_planner", base=base, weights=weights)


def _changes(truth: Mapping[str, Any]) -> Iterator[str]:
    """The changes of weights that a truth comes to, as the tool takes them."""
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
    """The weights of the preset that a request asks for, as the product lists them; nothing where it asks for none."""
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
    """All weights of a configuration's file, the external ones with them."""
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
    """Whether one of the named weights moved as wanted."""
    sign = 1 if wanted["sign"] == "up" else -1
    return any(sign * (after[name] - before[name]) > 0 for name in wanted["any_of"])


async def _driven(client: Client, bench: SeededBench, configs: list[str]) -> float:
    """The share of configurations whose run of one public scenario was driven by MP-RBFN."""
    if not configs:
        return 0.0
    await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", 1))
    batch_id = await finished_batch(client, scenarios=["preset:1"], configs=configs)
    good = [one for one in attempted_runs(bench.scratch / "requests", batch_id) if one.planner == "mp_rbfn"]
    return round(len(good) / len(configs), 4)
