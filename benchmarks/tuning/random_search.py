"""How much there is to be gained by weights of Frenetix: the best of a large random search.

The default runs on a hundred public scenarios under constant-velocity prediction. Random configurations, half of them
drawn anywhere (each of the thirteen weights 0 or evenly in the logarithm from 0.01 to 100), half around the default
(each weight times 0.1 to 10, or 0; of those that are 0 one in five is drawn anywhere), run on what the default fails:
the share of it that one mends bounds its gain. Only those whose bound lies above the best gain seen run on the rest
too, so that the best one is found with a part of the runs. That is done for all scenarios and for both halves of three
splits by place; the best of a half is judged on the other, where nothing was chosen, and the best of all on the public
scenarios that were not drawn. On these the default runs with other settings too.

Keys: ``random_gain``: gain in success of the best configuration on the scenarios that it was chosen on, and so too
favourable; ``random_held_out``: gain of the best of a half on the other half, mean over scenarios, the default where
nothing was better; ``random_unseen``: gain of the best of all on the ``random_unseen_scenarios`` others; each with the
ends of its 95 % interval, ``_low`` and ``_high``. ``settings_gain``: the largest gain of other settings on these;
``bound_best``: largest share of all scenarios that a configuration mends, whatever it loses; ``bound_mean``: the mean;
``bound_any``: share that any of them mends; ``random_configurations``, ``random_whole``: how many were drawn, and ran
on the rest too; ``random_scenarios``, ``random_failures``: run, and failed by the default.
"""

import math
import random
import sys
from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean
from typing import NamedTuple

import anyio
from mcp import Client

from plannerforge.engine.tuning import preset_configuration
from plannerforge.schemas.runs import RunRecord
from plannerforge.server.assembly import create_server

from ..analysis.advice import sides
from ..harness import (
    Figures,
    SeededBench,
    ask,
    attempted_runs,
    finished_batch,
    import_scenarios,
    scenario_files,
    settings_for,
)
from .optimised import DEFAULT, SCENARIOS, SPLITS, place_interval

CONFIGURATIONS = 200
"""Random configurations (chosen: an hour)."""
SETTINGS = (
    ("replan_steps=1",),
    ("replan_steps=2",),
    ("horizon_s=2",),
    ("horizon_s=2", "replan_steps=1"),
    ("horizon_s=4",),
    ("horizon_s=5",),
    ("sampling_level=3",),
)
"""Other settings, around those of the default (chosen)."""
_ROUND = 10
"""Configurations a batch (chosen)."""


class Half(NamedTuple):
    """Scenarios that a configuration is chosen on, and those that it is judged on."""

    training: frozenset[str]
    held_out: frozenset[str]


class Search:
    """What is known of the configurations: which failures of the default each mends, and what it loses."""

    def __init__(
        self, solved: Iterable[str], mended: Mapping[str, frozenset[str]], chosen_on: Sequence[frozenset[str]]
    ):
        self.solved = frozenset(solved)
        self.mended = mended
        self.lost: dict[str, frozenset[str]] = {}
        self._chosen_on = chosen_on

    def gain(self, config: str, among: frozenset[str]) -> int:
        """Scenarios that it wins over the default less those that it loses."""
        return len(self.mended[config] & among) - len(self.lost[config] & among)

    def best(self, among: frozenset[str]) -> str | None:
        """The first of those with the highest gain; None, the default, where none gains."""
        best = max(self.lost, key=lambda config: self.gain(config, among), default=None)
        return best if best is not None and self.gain(best, among) > 0 else None

    def to_run(self) -> list[str]:
        """The next configurations whose losses decide, those that mend most first; none: the best are known."""
        to_beat = {among: self._best_gain(among) for among in self._chosen_on}
        open_ones = [
            config
            for config, mended in self.mended.items()
            if config not in self.lost and any(len(mended & among) > gain for among, gain in to_beat.items())
        ]
        return sorted(open_ones, key=lambda config: -len(self.mended[config]))[:_ROUND]

    def _best_gain(self, among: frozenset[str]) -> int:
        best = self.best(among)
        return 0 if best is None else self.gain(best, among)


class _Loop:
    """Runs of the product, and how they ended."""

    def __init__(self, bench: SeededBench, client: Client) -> None:
        self._bench, self._client = bench, client

    async def runs(self, configs: Sequence[str], scenarios: Sequence[str]) -> list[RunRecord]:
        """All runs of a grid, without those that were not attempted."""
        batch_id = await finished_batch(
            self._client, scenarios=list(scenarios), configs=list(configs), prediction="constant_velocity"
        )
        return attempted_runs(self._bench.scratch / "random", batch_id)

    async def reached(self, configs: Sequence[str], scenarios: Sequence[str]) -> dict[str, frozenset[str]]:
        """By configuration: the scenarios whose goal it reached."""
        found = await self.runs(configs, scenarios)
        return {
            config: frozenset(
                run.scenario_id for run in found if run.config_id == config and run.outcome == "goal_reached"
            )
            for config in configs
        }

    async def gains(self, config: str, known: frozenset[str]) -> dict[str, float]:
        """By scenario that is not known: what a configuration gains over the default."""
        runs = await self.runs([DEFAULT, config], ["preset:500"])
        reached = {(run.scenario_id, run.config_id) for run in runs if run.outcome == "goal_reached"}
        default = preset_configuration("frenetix").config_id
        return {
            name: float((name, config) in reached) - float((name, default) in reached)
            for name in sorted({run.scenario_id for run in runs} - known)
            if config != DEFAULT
        }


def measure(bench: SeededBench) -> Figures:
    """The keys above; with a limit, of so many random configurations."""
    return anyio.run(_measured, bench)


async def _measured(bench: SeededBench) -> Figures:
    choice = random.Random(bench.seed)  # noqa: S311 - no secret
    folder = bench.scratch / "random"
    public = bench.shared / "data" / "commonroad"
    drawn = scenario_files(public, SCENARIOS)
    async with Client(create_server(settings_for(folder, bench.shared, 2))) as client:
        await import_scenarios(client, drawn)
        loop = _Loop(bench, client)
        first = await loop.runs([DEFAULT], ["preset:500"])
        scenarios = frozenset(run.scenario_id for run in first)
        solved = sorted(run.scenario_id for run in first if run.outcome == "goal_reached")
        failed = sorted(scenarios.difference(solved))
        configs = [await _configured(client, choice, number) for number in range(bench.limit or CONFIGURATIONS)]
        halves = [half for seed in range(bench.seed, bench.seed + SPLITS) for half in split(scenarios, seed)]
        mended: dict[str, frozenset[str]] = {}
        for start in range(0, len(configs), _ROUND):
            mended |= await loop.reached(configs[start : start + _ROUND], failed)
            sys.stderr.write(f"{len(mended)} configurations: {max(map(len, mended.values()))} mended at most\n")
        search = Search(solved, mended, [scenarios, *(half.training for half in halves)])
        while to_run := search.to_run():
            kept = await loop.reached(to_run, solved)
            search.lost |= {config: search.solved - kept[config] for config in to_run}
            best = search.best(scenarios)
            sys.stderr.write(f"{len(search.lost)} on all: {best and search.gain(best, scenarios)} gained at most\n")
        await import_scenarios(client, [file for file in scenario_files(public, None) if file not in drawn])
        unseen = await loop.gains(search.best(scenarios) or DEFAULT, scenarios)
        set_otherwise = [
            await loop.gains(await _made(client, settings=list(settings)), scenarios) for settings in SETTINGS
        ]
    return {**_figures(search, scenarios, halves, bench.seed), **_of_unseen(unseen, set_otherwise, bench.seed)}


async def _configured(client: Client, choice: random.Random, number: int) -> str:
    defaults = preset_configuration("frenetix").weights
    words = [
        f"{name}={drawn_near(value, choice) if number % 2 else drawn_anywhere(choice)}"
        for name, value in defaults.items()
    ]
    return await _made(client, weights=words)


async def _made(client: Client, **changes: list[str]) -> str:
    return str((await ask(client, "configure_planner", base=DEFAULT, **changes))["config_id"])


def drawn_anywhere(choice: random.Random) -> float:
    """A weight: 0 in one of four, else even in the logarithm."""
    return 0.0 if choice.random() < 0.25 else _rounded(math.exp(choice.uniform(math.log(0.01), math.log(100))))


def drawn_near(value: float, choice: random.Random) -> float:
    """A weight: 0 in one of ten, else the default's times 0.1 to 10; of those that are 0 one in five goes anywhere."""
    if value == 0:
        return drawn_anywhere(choice) if choice.random() < 0.2 else 0.0
    return 0.0 if choice.random() < 0.1 else _rounded(value * 10.0 ** choice.uniform(-1.0, 1.0))


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def split(scenarios: Iterable[str], seed: int) -> tuple[Half, Half]:
    """Two halves that share no place, each of them once the one that is chosen on."""
    first, second = map(frozenset, sides(scenarios, random.Random(seed)))  # noqa: S311 - no secret
    return Half(first, second), Half(second, first)


def _figures(search: Search, scenarios: frozenset[str], halves: Sequence[Half], seed: int) -> Figures:
    held_out: dict[str, list[float]] = {name: [] for name in sorted(scenarios)}
    for half in halves:
        best = search.best(half.training)
        for name in half.held_out:
            held_out[name].append(0.0 if best is None else search.gain(best, frozenset({name})))
    judged = {name: fmean(gains) for name, gains in held_out.items()}
    best = search.best(scenarios)
    chosen = {name: 0.0 if best is None else float(search.gain(best, frozenset({name}))) for name in sorted(scenarios)}
    low, high = place_interval(chosen, seed)
    held_out_low, held_out_high = place_interval(judged, seed)
    mended = search.mended.values()
    return {
        "random_gain": round(fmean(chosen.values()), 4),
        "random_gain_low": low,
        "random_gain_high": high,
        "random_held_out": round(fmean(judged.values()), 4),
        "random_held_out_low": held_out_low,
        "random_held_out_high": held_out_high,
        "bound_best": round(max(map(len, mended)) / len(scenarios), 4),
        "bound_mean": round(fmean(map(len, mended)) / len(scenarios), 4),
        "bound_any": round(len(frozenset().union(*mended)) / len(scenarios), 4),
        "random_configurations": len(search.mended),
        "random_whole": len(search.lost),
        "random_scenarios": len(scenarios),
        "random_failures": len(scenarios) - len(search.solved),
    }


def _of_unseen(gains: Mapping[str, float], set_otherwise: Sequence[Mapping[str, float]], seed: int) -> Figures:
    low, high = place_interval(gains, seed)
    return {
        "random_unseen": round(fmean(gains.values()), 4) if gains else 0.0,
        "random_unseen_low": low,
        "random_unseen_high": high,
        "random_unseen_scenarios": len(gains),
        "settings_gain": round(max(fmean(one.values()) for one in set_otherwise), 4),
    }
