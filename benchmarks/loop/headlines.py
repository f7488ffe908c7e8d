"""Checks that the headlines of comparisons and studies match the runs, with independent code.

Comparisons use stored runs with drawn outcomes and metrics, and are requested through the tools. The runs have few
pairs with flips, ties, few flips among many pairs, flips both ways, differences below the resolution of the metrics,
and metrics that differ only by chance or really. There are comparisons of three configurations, of two and three
batches, of two versions of one planner, and calls that leave out what to compare. Studies are sensitivity analyses in
which a weight decides, in which scenarios change only by chance, and in which nothing changes, and searches with IDM on
public scenarios.

A comparison is right if it pairs the matching sides, or is refused if no sides match. It has the code that
``docs/statistics.md`` gives to the counted flips, has these counts in its fields, and states no figure in its headline
that its fields lack. It has a better side in exactly the metrics that differ beyond resolution and chance, and lists
runs of counted pairs. The tests are those of ``analysis/recomputed.py``, which shares no code with the product. A study
is right if its headline names exactly the decisive weights, or its code follows from the held-out runs, and if it drove
no more configurations than allowed.

Keys: ``headlines_right``: share of the comparisons and studies that are right; ``headlines``: their number.
"""

import hashlib
import random
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from statistics import fmean
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.execution import silent
from plannerforge.engine.tuning import sensitivity_design, sensitivity_effects
from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.analysis.optimization import (
    DesignRequest,
    Effect,
    EffectsRequest,
    OptimizePlannerResult,
    StudyRecord,
)
from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.runs import BatchRecord, Outcome, RunRecord
from plannerforge.server.assembly import create_server

from ..analysis.public_runs import RawRuns
from ..analysis.recomputed import METRICS, Pairs, goal, holm
from ..harness import Figures, SeededBench, ask, ask_to_the_end, import_scenarios, scenario_files, settings_for, share
from ..stated_figures import unknown_in_fields

SCENARIOS, SEARCHED = 40, 8
"""Numbers of public scenarios for runs and for searches (chosen)."""
_SMALL, _LEAST, _MARGIN = 0.05, 6, 10.0
"""The level, the number of differing scenarios that any test needs to reach it, and ten points."""
_FAILURES: tuple[Outcome, ...] = ("collision", "timeout", "off_road")
_HIGHER = ("minimum_distance_m", "minimum_time_to_collision_s", "minimum_time_headway_s", "minimum_time_gap_s")
_HIGHER_TOO = (*_HIGHER, "risk_score")
_NEITHER = ("distance_m", "mean_speed_mps")
_TYPICAL: Mapping[str, float] = {
    "duration_s": 6.0,
    "distance_m": 60.0,
    "mean_speed_mps": 10.0,
    "minimum_distance_m": 2.0,
    "minimum_time_to_collision_s": 4.0,
    "minimum_time_headway_s": 2.0,
    "minimum_time_gap_s": 1.6,
    "maximum_jerk_mps3": 2.0,
    "mean_squared_jerk": 1.0,
    "maximum_planar_jerk_mps3": 2.5,
    "maximum_braking_mps2": 1.5,
    "maximum_steering_rate_radps": 0.1,
    "maximum_lateral_acceleration_mps2": 1.0,
}
"""An unremarkable run."""
_COMPARED = [name for name in METRICS if name != "mean_total_cost"]


@dataclass(frozen=True)
class _Side:
    """The synthetic runs of one configuration in one batch; ``version``: of its planner."""

    batch: int
    config: str
    outcomes: str
    figures: tuple[Mapping[str, float], ...]
    version: str = ""


@dataclass(frozen=True)
class _Case:
    """A comparison: its sides, which batches are named in which order, and which sides are alike (None: refused)."""

    kind: str
    sides: tuple[_Side, ...]
    named: tuple[int, ...]
    couples: tuple[tuple[int, int], ...] | None
    is_ranked: bool = False
    is_left_out: bool = False


class _Maker:
    """Draws cases; ``g`` is a run to the goal, ``c``, ``t`` and ``o`` are failures, ``i`` could not be attempted."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)  # noqa: S311 - no secret

    def cases(self) -> Iterator[_Case]:
        """Yield all cases in their order."""
        for pairs, flips in ((2, 2), (3, 2), (4, 3), (4, 1), (5, 5), (5, 4), (1, 1), (1, 0)):
            yield self._two("few pairs", *self._flipped(pairs, flips, back=False))
            yield self._two("few pairs", *self._flipped(pairs, flips, back=True))
        for pairs in (2, 4, 6, 17, 40):
            yield self._two("tie", *self._flipped(pairs, 0, back=False))
        for pairs, flips in ((20, 3), (30, 5), (40, 2), (40, 4)):
            yield self._two("few flips", *self._flipped(pairs, flips, back=self.draw.random() < 0.5))
        for gained, lost in ((8, 5), (6, 6), (9, 1), (12, 0), (0, 10), (2, 13), (7, 1), (6, 0), (16, 3)):
            yield self._two("both ways", *self._both_ways(40, gained, lost))
        for pairs in (8, 20, 40):
            yield self._two("below resolution", "g" * pairs, "g" * pairs, below=True)
        for pairs in (10, 20, 30, 40, 40, 40):
            yield self._two("by chance", "g" * pairs, "g" * pairs, noise=0.3)
        for pairs, shift in ((12, 0.5), (25, 0.5), (40, 0.3), (40, 0.05)):
            yield self._two("in fact", "g" * pairs, "g" * pairs, noise=0.05, shift=shift)
        yield from self._three()
        yield from self._batches()
        yield from self._versions()
        yield from self._left_out()

    def _flipped(self, pairs: int, flips: int, *, back: bool) -> tuple[str, str]:
        places = set(self.draw.sample(range(pairs), flips))
        first = "".join("c" if place in places else self.draw.choice("ggt") for place in range(pairs))
        second = "".join("g" if place in places else first[place] for place in range(pairs))
        return (second, first) if back else (first, second)

    def _both_ways(self, pairs: int, gained: int, lost: int) -> tuple[str, str]:
        same = [self.draw.choice("gggt") * 2 for _ in range(pairs - gained - lost)]
        both = ["cg"] * gained + ["gc"] * lost + same
        self.draw.shuffle(both)
        return "".join(one[0] for one in both), "".join(one[1] for one in both)

    def _figures(self, count: int, noise: float = 0.0, **shifts: float) -> tuple[Mapping[str, float], ...]:
        return tuple(
            {name: value + self.draw.gauss(0, noise) + shifts.get(name, 0.0) for name, value in _TYPICAL.items()}
            for _ in range(count)
        )

    def _two(
        self, kind: str, before: str, after: str, *, noise: float = 0.0, shift: float = 0.0, below: bool = False
    ) -> _Case:
        first = self._figures(len(before), noise)
        shifts = dict.fromkeys(self.draw.sample(sorted(_TYPICAL), 3), shift) if shift else {}
        second = self._figures(len(after), noise, **shifts)
        if below:
            second = tuple({name: value + 0.0009 for name, value in one.items()} for one in first)
        sides = (_Side(0, "Default", before, first), _Side(0, "Other", after, second))
        return _Case(kind, sides, (0,), ((0, 1),), is_ranked=False)

    def _drawn_sides(self, names: Sequence[tuple[int, str]], pairs: int = 20) -> tuple[_Side, ...]:
        return tuple(
            _Side(batch, config, "".join(self.draw.choice("gggct") for _ in range(pairs)), self._figures(pairs, 0.1))
            for batch, config in names
        )

    def _three(self) -> Iterator[_Case]:
        for goals in ((38, 36, 12), (20, 20, 20), (40, 25, 10)):
            sides = []
            for config, count in zip(("Default", "Other", "Third"), goals, strict=True):
                outcomes = list("g" * count + "c" * (40 - count))
                self.draw.shuffle(outcomes)
                sides.append(_Side(0, config, "".join(outcomes), self._figures(40, 0.2)))
            yield _Case("three", tuple(sides), (0,), ((0, 1), (0, 2)), is_ranked=True)

    def _batches(self) -> Iterator[_Case]:
        for named in ((0, 1), (1, 0)):
            sides = self._drawn_sides([(0, "Default"), (0, "Other"), (1, "Default"), (1, "Other")])
            couples = ((0, 2), (1, 3)) if named == (0, 1) else ((2, 0), (3, 1))
            yield _Case("two batches", sides, named, couples)
        sides = self._drawn_sides([(0, "Default"), (1, "Other"), (1, "Default")])
        yield _Case("one has more", sides, (0, 1), ((0, 2),))
        sides = self._drawn_sides([(0, "Default"), (1, "Other")])
        yield _Case("one each", sides, (1, 0), ((1, 0),))
        sides = self._drawn_sides([(0, "Default"), (1, "Other"), (1, "Third")])
        yield _Case("against each", sides, (0, 1), ((0, 1), (0, 2)), is_ranked=True)
        sides = self._drawn_sides([(0, "Default"), (0, "Other"), (1, "Third"), (1, "Fourth")])
        yield _Case("none alike", sides, (0, 1), None)
        sides = self._drawn_sides([(0, "Default"), (1, "Default"), (2, "Default")])
        yield _Case("three batches", sides, (1, 0, 2), ((1, 0), (1, 2)), is_ranked=True)
        sides = self._drawn_sides([(0, "Default"), (0, "Other"), (1, "Default"), (1, "Third")])
        yield _Case("one left of each", sides, (0, 1), ((0, 2), (1, 3)))

    def _versions(self) -> Iterator[_Case]:
        for named in ((0, 1), (1, 0)):
            first, second = self._drawn_sides([(0, "Default"), (1, "Default")], 12)
            sides = (replace(first, version="v1 (a1b2c3d)"), replace(second, version="v2 (d4e5f6a)"))
            yield _Case("versions", sides, named, ((0, 1),) if named == (0, 1) else ((1, 0),))

    def _left_out(self) -> Iterator[_Case]:
        sides = self._drawn_sides([(0, "Default"), (1, "Default")])
        yield _Case("left out, one each", sides, (), None, is_left_out=True)
        sides = self._drawn_sides([(0, "Default"), (1, "Default"), (1, "Other")])
        yield _Case("left out, several", sides, (), ((1, 2),), is_left_out=True)


def measure(bench: SeededBench) -> Figures:
    """Return the figures of the keys above, over all cases or up to the bench's limit of each sort."""
    right = anyio.run(_compared, bench)
    right += [_sensitivity_right(bench.seed + number) for number in range(bench.limit or 12)]
    right += anyio.run(_searched, bench)
    return {"headlines_right": share(right), "headlines": len(right)}


async def _compared(bench: SeededBench) -> list[bool]:
    cases = list(_Maker(bench.seed).cases())[: bench.limit]
    folder = bench.scratch / "headlines"
    right = []
    async with Client(create_server(settings_for(folder, bench.shared, 1))) as client:
        await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", SCENARIOS))
        workspace = Workspace(folder)
        scenarios = [one.artifact_id for one in workspace.newest(kind="scenario", limit=SCENARIOS)]
        for number, case in enumerate(cases):
            made = _stored(workspace, case, number, scenarios)
            faults = await _faults(client, case, made, number)
            right.append(not faults)
            sys.stderr.write("".join(f"{number} {case.kind}: {fault}\n" for fault in faults))
        workspace.close()
    return right


def _stored(workspace: Workspace, case: _Case, number: int, scenarios: Sequence[str]) -> list[list[RunRecord]]:
    """Store the batches of a case; the records of each side."""
    made = [_records(side, number, scenarios) for side in case.sides]
    for batch in sorted({side.batch for side in case.sides}):
        runs = [one for side, records in zip(case.sides, made, strict=True) if side.batch == batch for one in records]
        for run in runs:
            workspace.put("run", run.run_id, recipe=Recipe(tool="run_planner"), record=run)
        record = BatchRecord(
            batch_id=_batch_id(number, batch),
            scenarios=tuple(dict.fromkeys(run.scenario_id for run in runs)),
            configs=tuple(dict.fromkeys(run.config_id for run in runs)),
            prediction="constant_velocity",
            traffic="recorded",
            runs=tuple(run.run_id for run in runs),
            lost=(),
        )
        recipe = Recipe(tool="run_planner", arguments={"case": number, "batch": batch})
        workspace.put("batch", record.batch_id, recipe=recipe, record=record)
    return made


def _batch_id(number: int, batch: int) -> str:
    return f"batch_{hashlib.sha256(f'{number} {batch}'.encode()).hexdigest()[:12]}"


def _records(side: _Side, number: int, scenarios: Sequence[str]) -> list[RunRecord]:
    ends: dict[str, Outcome] = {"g": "goal_reached", "c": "collision", "t": "timeout", "o": "off_road", "i": "invalid"}
    return [
        RunRecord(
            run_id=f"run_{hashlib.sha256(f'{number} {side.batch} {side.config} {place}'.encode()).hexdigest()[:12]}",
            scenario_id=scenarios[place],
            problem_id=1,
            config_id=f"cfg_{hashlib.sha256(side.config.encode()).hexdigest()[:12]}",
            config_name=f"made:{side.config}",
            planner="made",
            prediction="constant_velocity",
            traffic="recorded",
            seed=0,
            step_s=0.1,
            outcome=ends[letter],
            reason="as it was made",
            collision=None,
            rejected_candidates={},
            metrics=RunMetrics.model_validate({**figures, "risk_score": 3, "mean_total_cost": None}),
            planner_version=side.version,
            planner_source=side.version,
        )
        for place, (letter, figures) in enumerate(zip(side.outcomes, side.figures, strict=True))
    ]


async def _faults(client: Client, case: _Case, made: Sequence[Sequence[RunRecord]], number: int) -> list[str]:
    """Return the faults of the answer."""
    given = {} if case.is_left_out else {"results": [_batch_id(number, batch) for batch in case.named]}
    answer = await client.call_tool("compare_results", given)
    text = "\n".join(getattr(part, "text", "") for part in answer.content)
    if case.couples is None:
        return [] if answer.is_error else [f"not refused: {text}"]
    if answer.is_error or answer.structured_content is None:
        return [f"refused: {text}"]
    result = answer.structured_content
    told = _judged(case, made, number)
    if len(result["comparisons"]) != len(told):
        return [f"{len(result['comparisons'])} comparisons, not {len(told)}: {text}"]
    faults: list[str] = []
    for comparison, expected in zip(result["comparisons"], told, strict=True):
        faults += expected.faults(comparison, result["sides"], text)
    return [*faults, *([text] if faults else [])]


@dataclass(frozen=True)
class _Expected:
    """The expected content of a comparison: sides, counts of pairs, code, and the better side in each metric."""

    sides: tuple[_Side, _Side]
    batches: tuple[str, str]
    counts: tuple[int, int, int]
    code: str
    better: Mapping[str, str]
    flipped: frozenset[str]
    runs: frozenset[str]

    def faults(self, comparison: Mapping[str, Any], sides: Sequence[Mapping[str, Any]], text: str) -> Iterator[str]:
        """Yield the faults of a comparison."""
        by_label = {side["label"]: side for side in sides}
        for end, side, batch in zip(("before", "after"), self.sides, self.batches, strict=True):
            found = by_label[comparison[end]]
            if found["result_id"] != batch or not found["config_name"].startswith(f"made:{side.config}"):
                yield f"{end} is {comparison[end]} of {found['result_id']}, not {side.config} of {batch}"
            if side.version and side.version not in comparison[end]:
                yield f"{end} does not name {side.version}"
        test = comparison["success"]
        counts = (test["pairs"], test["only_after"], test["only_before"])
        if counts != self.counts:
            yield f"pairs, gained and lost {counts}, not {self.counts}"
        if comparison["headline_code"] != self.code:
            yield f"{comparison['headline_code']}, not {self.code}"
        for unknown in unknown_in_fields(comparison):
            yield f"a figure of the headline is in no field: {unknown}"
        better = {one["name"]: one["better"] for one in comparison["metrics"] if one["better"]}
        if better != self.better:
            yield f"better {better}, not {self.better}"
        evidence = comparison["run_ids"]
        if not set(evidence) <= self.runs or (self.flipped and not set(evidence[:2]) <= self.flipped):
            yield f"runs {evidence}"
        if any(words not in text for words in (comparison["after"], comparison["before"], comparison["verdict"])):
            yield "the text says something else"


def _pairs(before: Sequence[RunRecord], after: Sequence[RunRecord]) -> Pairs:
    records = (
        *(one.model_copy(update={"config_id": "before"}) for one in before),
        *(one.model_copy(update={"config_id": "after"}) for one in after),
    )
    empty = BatchRecord(
        batch_id="", scenarios=(), configs=(), prediction="constant_velocity", traffic="recorded", runs=(), lost=()
    )
    return Pairs(RawRuns(empty, records, {}, {}, {}), ("before", "after"))


def _judged(case: _Case, made: Sequence[Sequence[RunRecord]], number: int) -> list[_Expected]:
    """Return the expected content of each comparison of a case, in the order of the answer."""
    couples = case.couples or ()
    all_pairs = {couple: _pairs(made[couple[0]], made[couple[1]]) for couple in couples}
    tests = {couple: pairs.success() for couple, pairs in all_pairs.items()}
    family: dict[str, float] = {str(couple): test["p"] for couple, test in tests.items() if test["differing"] >= _LEAST}
    if case.is_ranked:
        for couple in combinations(range(len(made)), 2):
            if couple not in couples and couple[::-1] not in couples:
                test = _pairs(made[couple[0]], made[couple[1]]).success()
                family |= {str(couple): test["p"]} if test["differing"] >= _LEAST else {}
    metrics = {
        (couple, name): found
        for couple, pairs in all_pairs.items()
        for name in _COMPARED
        if (found := pairs.tested(name)) is not None and found["differing"] >= _LEAST
    }
    halves = sum(bool(one) for one in (family, metrics))
    success_p = {name: min(1.0, halves * p) for name, p in holm(family).items()}
    keys = {str(key): key for key in metrics}
    adjusted = {keys[name]: halves * p for name, p in holm({str(k): v["p"] for k, v in metrics.items()}).items()}
    told = []
    for couple, pairs in all_pairs.items():
        better = {}
        for (of, name), test in metrics.items():
            resolution, _ = METRICS[name]
            is_apart = not test["low"] <= 0 <= test["high"] and abs(test["shift"]) > resolution
            if of == couple and adjusted[of, name] < _SMALL and is_apart and name not in _NEITHER:
                better[name] = "after" if (test["shift"] > 0) == (name in _HIGHER_TOO) else "before"
        flipped = [pair for pair in pairs.pairs if goal(pair[0]) != goal(pair[1])]
        told.append(
            _Expected(
                sides=(case.sides[couple[0]], case.sides[couple[1]]),
                batches=(
                    _batch_id(number, case.sides[couple[0]].batch),
                    _batch_id(number, case.sides[couple[1]].batch),
                ),
                counts=(len(pairs.pairs), *_ways(pairs)),
                code=_code(pairs, tests[couple], success_p.get(str(couple))),
                better=better,
                flipped=frozenset(run.run_id for pair in flipped for run in pair),
                runs=frozenset(run.run_id for pair in pairs.pairs for run in pair),
            )
        )
    return told


def _ways(pairs: Pairs) -> tuple[int, int]:
    return pairs.count(before=False, after=True), pairs.count(before=True, after=False)


def _code(pairs: Pairs, test: Mapping[str, float], adjusted: float | None) -> str:
    """Return the code of a headline by the rules of docs/statistics.md."""
    gained, lost = _ways(pairs)
    if len(pairs.pairs) == 1:
        return "one_pair_better" if gained else "one_pair_worse" if lost else "one_pair_same"
    if adjusted is not None and adjusted < _SMALL and not test["low"] <= 0 <= test["high"]:
        return "better" if gained > lost else "worse"
    if gained + lost == 0:
        return "tie"
    if test["low"] >= -_MARGIN and test["high"] <= _MARGIN:
        return "alike"
    return "flips_too_few" if test["differing"] < _LEAST else "no_difference_shown"


def _sensitivity_right(seed: int) -> bool:
    """Return True if the headline of a sensitivity analysis names only the decisive weight."""
    draw = random.Random(seed)  # noqa: S311 - no secret
    names = ("prediction", "velocity_offset", "jerk", "path_length", "distance_to_obstacles")
    kind = ("decides", "chance", "nothing", "decides among chance")[seed % 4]
    decisive, chaotic, scenarios = draw.randrange(len(names)), draw.randrange(len(names)), 24
    limits = [draw.uniform(0.2, 0.8) for _ in range(scenarios)]

    def success(point: tuple[float, ...], scenario: int) -> float:
        reached = point[decisive] >= limits[scenario] if kind.startswith("decides") else scenario % 3 > 0
        word = f"{seed} {scenario} {point[chaotic]:.3f}"
        is_turned = kind.endswith("chance") and chaotic != decisive and hashlib.sha256(word.encode()).digest()[0] < 26
        return float(reached != is_turned)

    design = DesignRequest(method="morris", names=names, most=60, seed=seed)
    points = sensitivity_design(design, silent).points
    scores = tuple(tuple(success(point, scenario) for scenario in range(scenarios)) for point in points)
    request = EffectsRequest(
        design=design,
        values=tuple(fmean(row) for row in scores),
        scores=scores,
        units=tuple(f"scenario {number}" for number in range(scenarios)),
    )
    effects = sensitivity_effects(request, silent).effects
    headline = _study(effects, scenarios).to_text().splitlines()[0]
    named = {name for name in names if re.search(rf"\b{name}\b", headline)}
    wanted = {names[decisive]} if kind.startswith("decides") else set()
    if named != wanted:
        sys.stderr.write(f"sensitivity {seed} ({kind}): {headline}, not {wanted}: {effects}\n")
    return named == wanted


def _study(effects: tuple[Effect, ...], scenarios: int) -> OptimizePlannerResult:
    study = StudyRecord(
        study_id="study_made",
        method="morris",
        objective=("success",),
        constraints=(),
        prediction="constant_velocity",
        traffic="recorded",
        base_id="cfg_made",
        base_name="made:Default",
        best_id="cfg_made",
        best_name="made:Default",
        training_scenarios=scenarios,
        training=(),
        held_out_places=(),
        trials=(),
        effects=effects,
    )
    return OptimizePlannerResult(state="done", study=study, next_step="")


async def _searched(bench: SeededBench) -> list[bool]:
    """Return whether each search with IDM kept its limit and reports the result of its held-out runs."""
    files = _of_several_places(scenario_files(bench.shared / "data" / "commonroad", None))
    right = []
    for most in (3, 6, 11, 16)[: bench.limit]:
        folder = bench.scratch / f"search {most}"
        async with Client(create_server(settings_for(folder, bench.shared, 1))) as client:
            await import_scenarios(client, files)
            given = {"scenarios": ["preset:500"], "base": "idm:Default", "max_trials": most, "seed": bench.seed}
            answer = await ask(client, "optimize_planner", **given)
            if answer["state"] == "running":
                await ask_to_the_end(client, "get_job", job_id=answer["job_id"], wait_s=0)
                answer = await ask(client, "optimize_planner", **given)
        study = answer["study"]
        workspace = Workspace(folder)
        records = [one.read(RunRecord) for one in workspace.newest(kind="run", limit=5000)]
        workspace.close()
        driven, code = _recounted(study, records)
        is_right = driven <= study["driven"] <= most and answer["headline_code"] == code
        if not is_right:
            sys.stderr.write(
                f"search of {most}: {driven} and {study['driven']} driven, {answer['headline_code']}, {code}\n"
            )
        right.append(is_right)
    return right


def _of_several_places(files: Sequence[Path]) -> list[Path]:
    """Return one file of each of some places."""
    by_place: dict[str, Path] = {}
    for path in files:
        by_place.setdefault(path.name.removeprefix("C-").partition("-")[0], path)
    return [by_place[place] for place in sorted(by_place)][:SEARCHED]


def _recounted(study: Mapping[str, Any], records: Sequence[RunRecord]) -> tuple[int, str]:
    """Return the number of configurations driven over a half of the scenarios, and the code that the runs imply."""
    seen = {(record.config_id, record.scenario_id.partition("-")[0] in study["training"]) for record in records}
    if study["best_id"] == study["base_id"]:
        return len(seen), "nothing_better"
    if study["held_out"] is None:
        return len(seen), "not_judged"
    others = [one for one in records if one.scenario_id.partition("-")[0] not in study["training"]]
    before, after = ([one for one in others if one.config_id == study[key]] for key in ("base_id", "best_id"))
    pairs = _pairs(before, after)
    test = pairs.success()
    halves = 1 + any((found := pairs.tested(name)) and found["differing"] >= _LEAST for name in _COMPARED)
    is_shown = test["differing"] >= _LEAST and halves * test["p"] < _SMALL
    code = ("better" if test["difference"] > 0 else "worse") if is_shown else "no_gain_shown"
    return len(seen), code
