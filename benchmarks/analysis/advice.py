"""Checks that advice that helps in a trial also helps on other roads.

The bench spoils one weight of Frenetix's default at a time and runs the configuration on scenarios of half of the
roads. ``analyze_results`` with ``trial=true`` suggests changes and tries them there. Each change that is reported to
help then runs on the other half next to the spoiled configuration. The split of the roads is drawn again for each
spoiled configuration.

Keys:

- ``advice_helped``: share of the changes reported to help that raise the success on the other roads.
- ``advice_told``: number of these changes; ``advice_tried``: number of all changes tried.
- ``advice_gain``: mean difference in success rate of the changes reported to help.
"""

import random
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.workspace import Workspace

from ..harness import Figures, SeededBench, ask, ask_to_the_end, attempted_runs, finished_batch, share
from .public_runs import DEFAULT, PREDICTION, import_public, public_folder, public_server

ENOUGH = 30
"""Helpful changes after which the search stops (chosen)."""
HALF = 40
"""Largest number of scenarios for either half of the roads (chosen)."""
SPOILED = (
    "velocity_offset=0",
    "prediction=20",
    "longitudinal_jerk=10",
    "distance_to_reference_path=0",
    "acceleration=10",
    "velocity_offset=0.05",
    "distance_to_obstacles=20",
    "prediction=0",
    "lateral_jerk=20",
    "distance_to_reference_path=100",
    "jerk=10",
    "velocity_offset=20",
    "longitudinal_jerk=3",
    "prediction=5",
    "acceleration=3",
    "distance_to_obstacles=5",
    "velocity=10",
    "path_length=5",
    "orientation_offset=50",
    "lane_center_offset=20",
    "velocity_offset=0.2",
    "jerk=3",
    "lateral_jerk=5",
    "responsibility=10",
)
"""One weight of the default, changed enough that some scenarios fail (chosen), most failures first."""


@dataclass(frozen=True)
class _Advice:
    """A change reported to help, and the goals reached on the other roads."""

    change: str
    before: int
    after: int
    scenarios: int

    @property
    def helped(self) -> bool:
        """True if more scenarios reach the goal with it."""
        return self.after > self.before

    @property
    def gain(self) -> float:
        """Difference of the success rates."""
        return (self.after - self.before) / self.scenarios if self.scenarios else 0.0


def road_of(scenario_id: str) -> str:
    """Return the place of a scenario: ``DEU_Aachen`` for ``DEU_Aachen-2_7_T-1``."""
    return scenario_id.removeprefix("C-").split("-", maxsplit=1)[0]


def halves(scenarios: Sequence[str], choice: random.Random) -> tuple[list[str], list[str]]:
    """Return two sets of scenarios without a common place, at most :data:`HALF` of each."""
    first, second = (sorted(choice.sample(side, min(HALF, len(side)))) for side in sides(scenarios, choice))
    return first, second


def sides(scenarios: Iterable[str], choice: random.Random) -> tuple[list[str], list[str]]:
    """Divide all scenarios into two sides of about the same size without a common place."""
    roads: dict[str, list[str]] = {}
    for name in sorted(scenarios):
        roads.setdefault(road_of(name), []).append(name)
    drawn = sorted(roads)
    choice.shuffle(drawn)
    shared_out: tuple[list[str], list[str]] = ([], [])
    for road in drawn:
        min(shared_out, key=len).extend(roads[road])
    return shared_out


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above; a limit restricts the number of spoiled configurations."""
    return anyio.run(_measured, bench)


async def _measured(bench: SeededBench) -> Figures:
    found: list[_Advice] = []
    tried = 0
    choice = random.Random(bench.seed)  # noqa: S311 - no secret
    async with public_server(bench) as client:
        await import_public(bench, client)
        scenarios = _scenarios(bench)
        for spoiled in SPOILED[: bench.limit]:
            count, told = await _round(bench, client, spoiled, halves(scenarios, choice))
            found, tried = [*found, *told], tried + count
            if len(found) >= ENOUGH:
                break
    return {
        "advice_helped": share(advice.helped for advice in found),
        "advice_told": len(found),
        "advice_tried": tried,
        "advice_gain": round(sum(advice.gain for advice in found) / max(len(found), 1), 4),
    }


def _scenarios(bench: SeededBench) -> list[str]:
    workspace = Workspace(public_folder(bench))
    names = [artifact.artifact_id for artifact in workspace.newest(kind="scenario", limit=1000)]
    workspace.close()
    return names


async def _round(
    bench: SeededBench, client: Client, spoiled: str, sides: tuple[list[str], list[str]]
) -> tuple[int, list[_Advice]]:
    """Return the number of changes tried for a spoiled configuration, and the helpful ones with their effect."""
    seen, unseen = sides
    base = (await ask(client, "configure_planner", base=DEFAULT, weights=[spoiled]))["config_id"]
    batch_id = await finished_batch(client, scenarios=seen, configs=[base], prediction=PREDICTION)
    changes = await _changes(client, batch_id)
    for tried in changes:
        words = f"+{tried['gained']} of {tried['failing']}, -{tried['lost']} of {tried['passing']}"
        sys.stderr.write(
            f"{spoiled}: {tried['change']}: {words}{', reported to help' if _is_reported_helpful(tried) else ''}\n"
        )
    told = {tried["config_id"]: tried["change"] for tried in changes if _is_reported_helpful(tried)}
    if not told:
        return len(changes), []
    judged = await finished_batch(client, scenarios=unseen, configs=[base, *told], prediction=PREDICTION)
    goals = _goals(bench, judged, [base, *told])
    found = [_elsewhere(change, goals[base], goals[config_id]) for config_id, change in told.items()]
    for advice in found:
        sys.stderr.write(f"  {advice.change} elsewhere: {advice.before} to {advice.after} of {advice.scenarios}\n")
    return len(changes), found


def _elsewhere(change: str, before: Mapping[str, bool], after: Mapping[str, bool]) -> _Advice:
    both = [name for name in before if name in after]
    goals = [sum(side[name] for name in both) for side in (before, after)]
    return _Advice(change=change, before=goals[0], after=goals[1], scenarios=len(both))


async def _changes(client: Client, batch_id: str) -> list[Mapping[str, Any]]:
    """Return the changes that were tried."""
    answer = await ask(client, "analyze_results", results=[batch_id], trial=True)
    while answer["job_id"]:
        await ask_to_the_end(client, "get_job", job_id=answer["job_id"], wait_s=0)
        answer = await ask(client, "analyze_results", results=[batch_id], trial=True)
    suggestions = [finding["suggestion"] for finding in answer["findings"] if finding["suggestion"]]
    return [one["tried"] for one in suggestions if one["tried"]]


def _is_reported_helpful(tried: Mapping[str, Any]) -> bool:
    """Return True if the answer calls it a help: more gained than lost, at the level of docs/analysis.md."""
    return bool(tried["gained"] > tried["lost"] and tried["p"] <= 1 / 16)


def _goals(bench: SeededBench, batch_id: str, configs: Sequence[str]) -> dict[str, dict[str, bool]]:
    """Return by configuration whether each scenario reached its goal, without runs that could not be attempted."""
    records = attempted_runs(public_folder(bench), batch_id)
    return {
        config_id: {
            record.scenario_id: record.outcome == "goal_reached" for record in records if record.config_id == config_id
        }
        for config_id in configs
    }
