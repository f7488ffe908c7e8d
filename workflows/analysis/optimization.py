"""Searches for a better configuration, and studies that show which weights matter.

A search uses half of the roads. It runs planners as ``run_planner`` does and reuses earlier runs, so an interrupted
search resumes, and the same call gives the same study.
"""

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import Literal

from ...engine.execution import JobProgress
from ...engine.planners import check_modes, check_world
from ...engine.tuning import (
    Constraint,
    Dimension,
    Objective,
    changed_configuration,
    differences,
    dimensions,
    fewest_configurations,
    parse_constraint,
    parse_objective,
    point_of,
    tuning_of,
    values_at,
)
from ...engine.workspace import Recipe, versions_of
from ...schemas.analysis.comparison import CompareResultsArguments
from ...schemas.analysis.optimization import (
    ChangeShare,
    DesignRequest,
    Effect,
    EffectsRequest,
    EvaluatedTrial,
    GainRequest,
    HeldOut,
    OptimizePlannerArguments,
    OptimizePlannerResult,
    ProposeRequest,
    StudyRecord,
    TrialLine,
)
from ...schemas.errors import Faults, InvalidRequest, NotPossible, with_values
from ...schemas.planning import PlannerConfiguration
from ...schemas.runs import RunRecord
from ...schemas.text import counted, shown_name
from ...schemas.worlds import PERFECT, World, world_of
from ..configurations import BY_SEARCH, resolve_configuration, store_configuration
from ..context import WorkflowContext
from ..failures import found_failures
from ..operations import JUDGE_GAIN, PROPOSE, SENSITIVITY_DESIGN, SENSITIVITY_EFFECTS
from ..results import lineages
from ..runs import Cell, own_versions, run_grid, store_batch
from ..scenarios import ChosenScenario, choose_scenarios
from .comparison import compare_results

_ROUND = 4
"""How many candidates are drawn together (chosen); fixed, so that the number of workers changes nothing."""
_RUNGS = (0.25, 0.5, 1.0)
"""Shares of the training scenarios after which candidates may be abandoned (chosen)."""
_BROKEN = 1.0
"""Subtracted from the sampler's score of a candidate that breaks a constraint (chosen: as much as full success)."""
_LOOK = 2
"""The number of configurations run on the held-out half: the base and the result."""
_REVERTING_SHARE = 1 / 3
"""The share of the remaining budget reserved for reverting changes (chosen), if there are that many weights."""
_MOST_FRONT = 8
"""The maximum number of front members to store (chosen)."""
_SENSITIVITY = ("morris", "sobol")


@dataclass(frozen=True)
class _Trial:
    """A candidate with its runs on the training scenarios, in order (None: not run, lost or invalid)."""

    number: int
    configuration: PlannerConfiguration
    point: tuple[float, ...] | None
    runs: tuple[RunRecord | None, ...]
    is_pruned: bool

    @property
    def valid(self) -> list[RunRecord]:
        """The runs that could be attempted."""
        return [run for run in self.runs if run is not None and run.outcome != "invalid"]


@dataclass(frozen=True)
class _Plan:
    """A study's resolved arguments, and the scenarios of its two parts in the order in which they run."""

    arguments: OptimizePlannerArguments
    base: PlannerConfiguration
    objectives: tuple[Objective, ...]
    constraints: tuple[Constraint, ...]
    space: tuple[Dimension, ...]
    training: tuple[ChosenScenario, ...]
    held_out: tuple[ChosenScenario, ...]
    places: tuple[tuple[str, ...], tuple[str, ...]]
    roots: Mapping[str, str]
    notes: tuple[str, ...]
    world: World = PERFECT

    def values(self, runs: Sequence[RunRecord]) -> tuple[float, ...]:
        """Return the mean objectives over runs: their sum, or each objective separately for a front."""
        if not runs:
            return (-math.inf,) * self.count
        each = tuple(fmean(one.score(run) for run in runs) for one in self.objectives)
        return each if self.arguments.pareto else (sum(each),)

    @property
    def count(self) -> int:
        """The number of objectives reported."""
        return len(self.objectives) if self.arguments.pareto else 1

    def score(self, run: RunRecord) -> float:
        """Return the summed objectives of a run."""
        return sum(one.score(run) for one in self.objectives)

    def at(self, point: Sequence[float]) -> PlannerConfiguration:
        """Return the configuration at a point of the space: the base with these values."""
        values = values_at(self.space, point)
        assignments: dict[bool, list[str]] = {True: [], False: []}
        for one in self.space:
            assignments[one.is_setting].append(f"{one.name}={values[one.name]!r}")
        return changed_configuration(self.base, None, assignments[False], assignments[True])[0]

    def cell(self, scenario: ChosenScenario, configuration: PlannerConfiguration) -> Cell:
        """Return the run of a scenario under a configuration."""
        modes = (self.arguments.prediction, self.arguments.traffic)
        return Cell(scenario.scenario_id, scenario.problem_id, configuration, *modes, world=self.world)


@dataclass
class _Search:
    """A study in progress: its trials in order, and progress for calls that do not wait."""

    plan: _Plan
    context: WorkflowContext
    progress: JobProgress
    trials: list[_Trial] = field(default_factory=list)
    driven: int = 0

    @property
    def left(self) -> int:
        """The number of configurations that may still be run."""
        return self.plan.arguments.max_trials - self.driven

    @property
    def candidates(self) -> int:
        """The number of candidates: the budget without the held-out runs and the reserve for reverting changes.

        If the limit is too small for a search, all configurations are candidates, and the result is not judged.
        """
        most = self.plan.arguments.max_trials
        if most < _LOOK + 2:
            return most
        return most - _LOOK - min(len(self.plan.space), int(_REVERTING_SHARE * (most - _LOOK)))

    async def run(self) -> StudyRecord:
        """Run the whole search and return its record."""
        first = await self.tried([(self.plan.base, point_of(self.plan.space, self.plan.base))], prune=False)
        if not first[0].valid:
            raise NotPossible(
                "the base could not run on any training scenario", next_step="analyze_results of run_planner on them"
            )
        presets = self._presets()
        if presets:
            await self.tried(presets, prune=not self.plan.arguments.pareto)
        enqueued, rounds = [self._evaluated(trial) for trial in self.trials], list[tuple[EvaluatedTrial, ...]]()
        while (count := min(_ROUND, self._count_to_try())) > 0:
            points = await self._proposed(enqueued, rounds, count)
            made = await self.tried(
                [(self.plan.at(point), point) for point in points], prune=not self.plan.arguments.pareto
            )
            rounds.append(tuple(self._evaluated(trial) for trial in made))
        return await self._ended()

    def _count_to_try(self) -> int:
        """Return how many more candidates to try, including the reserve for reverting while no candidate is better."""
        wanted = self.candidates - len(self.trials)
        return max(wanted, self.left - _LOOK) if self.best().number == 0 else wanted

    def _presets(self) -> list[tuple[PlannerConfiguration, tuple[float, ...]]]:
        """Return the other presets with the base's settings; empty if only some weights are varied."""
        if self.plan.arguments.vary:
            return []
        base = self.plan.base
        made = [changed_configuration(base, name, [])[0] for name in tuning_of(base.planner).presets]
        new = {one.config_id: one for one in made if one.config_id != base.config_id}
        return [(one, point_of(self.plan.space, one)) for one in new.values()][: self.candidates - 1]

    async def _proposed(
        self, enqueued: Sequence[EvaluatedTrial], rounds: Sequence[tuple[EvaluatedTrial, ...]], count: int
    ) -> tuple[tuple[float, ...], ...]:
        method = self.plan.arguments.method
        if method in ("morris", "sobol"):
            raise InvalidRequest(f"{method} is not a search method", valid=["tpe", "cmaes", "random"])
        request = ProposeRequest(
            method=method,
            seed=self.plan.arguments.seed,
            names=tuple(one.name for one in self.plan.space),
            start=point_of(self.plan.space, self.plan.base),
            objectives=self.plan.count,
            enqueued=tuple(enqueued),
            rounds=tuple(rounds),
            count=count,
        )
        return (await self.context.services.workers.run(PROPOSE, request)).points

    def _evaluated(self, trial: _Trial) -> EvaluatedTrial:
        """Return a trial for the sampler. A broken constraint costs more than any success is worth."""
        broken = 0.0 if self.is_within(trial) else _BROKEN
        point = trial.point or point_of(self.plan.space, trial.configuration)
        values = self.values(trial)
        return EvaluatedTrial(point=point, values=tuple(max(value, -10.0) - broken for value in values))

    def values(self, trial: _Trial) -> tuple[float, ...]:
        """Return the objectives of a trial.

        For an abandoned trial, these are the base's values on all scenarios plus the difference on those that it ran,
        because the first scenarios may be easier than the rest.
        """
        if not trial.is_pruned:
            return self.plan.values(trial.valid)
        base = self.trials[0]
        same = [run for run in base.runs[: len(trial.runs)] if run is not None and run.outcome != "invalid"]
        parts = (self.plan.values(base.valid), self.plan.values(trial.valid), self.plan.values(same))
        return tuple(whole + own - other for whole, own, other in zip(*parts, strict=True))

    async def tried(
        self, candidates: Sequence[tuple[PlannerConfiguration, tuple[float, ...]]], *, prune: bool
    ) -> list[_Trial]:
        """Run candidates on the training scenarios in parts, abandon those that fall behind, and return all trials."""
        training, best = self.plan.training, self.best() if self.trials else None
        runs: list[list[RunRecord | None]] = [[] for _ in candidates]
        alive, done = list(range(len(candidates))), 0
        for rung in _RUNGS if prune else (1.0,):
            until = max(done, math.ceil(rung * len(training)))
            cells = [
                self.plan.cell(scenario, candidates[index][0]) for index in alive for scenario in training[done:until]
            ]
            records = await self._run(cells)
            for place, index in enumerate(alive):
                runs[index] += records[place * (until - done) : (place + 1) * (until - done)]
            done = until
            if best is not None and done < len(training):
                alive = [index for index in alive if not self._is_behind(runs[index], best.runs)]
        made = [
            _Trial(len(self.trials) + index, configuration, point, tuple(runs[index]), index not in alive)
            for index, (configuration, point) in enumerate(candidates)
        ]
        self.trials += made
        self.driven += len(made)
        self._report()
        return made

    def _is_behind(self, runs: Sequence[RunRecord | None], best: Sequence[RunRecord | None]) -> bool:
        """Return whether a candidate is worse than the best one by over one standard error on the same scenarios."""
        paired = [
            self.plan.score(one) - self.plan.score(other)
            for one, other in zip(runs, best, strict=False)
            if one is not None and other is not None and "invalid" not in (one.outcome, other.outcome)
        ]
        if len(paired) < 2:
            return False
        mean = fmean(paired)
        error = math.sqrt(sum((one - mean) ** 2 for one in paired) / (len(paired) - 1) / len(paired))
        return mean < 0 and mean + error <= 0

    async def _run(self, cells: Sequence[Cell]) -> list[RunRecord | None]:
        """Return the runs of the cells in order; lost runs are None."""
        if not cells:
            return []
        for configuration in {cell.configuration.config_id: cell.configuration for cell in cells}.values():
            self._store(configuration)
        results = await run_grid(self.context, cells, lambda _: None)
        return [result.record for result in results]

    def _store(self, configuration: PlannerConfiguration) -> None:
        """Store a configuration; the recipe of a candidate names the search, and its base as the parent."""
        base_id = self.plan.base.config_id
        arguments = {"base": base_id, "id": configuration.config_id}
        searched = Recipe(tool=BY_SEARCH, arguments=arguments, parents=(base_id,))
        store_configuration(self.context, configuration, None if configuration.config_id == base_id else searched)

    def is_within(self, trial: _Trial) -> bool:
        """Return whether a trial satisfies the constraints, relative to the base on the same scenarios."""
        base = [run for run in self.trials[0].runs[: len(trial.runs)] if run is not None and run.outcome != "invalid"]
        return all(one.holds(trial.valid, base) for one in self.plan.constraints)

    def best(self) -> _Trial:
        """The complete trial within the constraints with the highest summed objectives.

        If trials are equal, the first one wins, so the base stays unless another trial is better.
        """
        whole = [trial for trial in self.trials if not trial.is_pruned and self.is_within(trial)]
        return max(whole or self.trials[:1], key=lambda trial: (sum(self.plan.values(trial.valid)), -trial.number))

    def line(self, trial: _Trial) -> TrialLine:
        """Return a trial as a line of the record."""
        return TrialLine(
            number=trial.number,
            config_id=trial.configuration.config_id,
            name=trial.configuration.name,
            values=tuple(round(value, 6) for value in self.values(trial)),
            runs=len(trial.valid),
            pruned=trial.is_pruned,
            within=self.is_within(trial),
        )

    def _report(self) -> None:
        best, most = self.best(), self.plan.arguments.max_trials
        if best.configuration.config_id not in self.progress.results:
            self.progress.add_result(best.configuration.config_id)
        base = sum(self.plan.values(self.trials[0].valid))
        found = f"objective: best {sum(self.plan.values(best.valid)):.3f}, base {base:.3f}"
        self.progress.report(0.9 * self.driven / most, f"{self.driven} of at most {most} configurations run, {found}")

    async def _ended(self) -> StudyRecord:
        """Revert useless changes, evaluate once on the held-out scenarios, and return the record of the study."""
        lines = tuple(self.line(trial) for trial in self.trials)
        best, front = self.best(), self._front()
        changes: tuple[ChangeShare, ...] = ()
        notes: tuple[str, ...] = ()
        held_out = None
        if best.number != 0:
            best, changes, notes = await self._ablated(best)
            known = {line.config_id for line in lines}
            lines += (self.line(best),) if best.configuration.config_id not in known else ()
            if self.left >= _LOOK:
                self.progress.report(0.95, "held-out scenarios")
                held_out = await self._judged(best.configuration)
        return _study_record(
            self.plan,
            lines,
            best.configuration,
            changes=changes,
            held_out=held_out,
            front=tuple(map(self.line, front)),
            driven=self.driven,
            notes=notes,
        )

    def _front(self) -> list[_Trial]:
        """Return the trials that no other trial beats in every objective."""
        if not self.plan.arguments.pareto:
            return []
        whole = [trial for trial in self.trials if self.is_within(trial)]
        values = {trial.number: self.plan.values(trial.valid) for trial in whole}

        def is_beaten(trial: _Trial) -> bool:
            own = values[trial.number]
            return any(
                all(a >= b for a, b in zip(other, own, strict=True)) and (other != own or number < trial.number)
                for number, other in values.items()
                if number != trial.number
            )

        return [trial for trial in whole if not is_beaten(trial)][:_MOST_FRONT]

    async def _ablated(self, best: _Trial) -> tuple[_Trial, tuple[ChangeShare, ...], tuple[str, ...]]:
        """Return the best configuration without useless changes, the gain of each other change, and a note.

        The changes are reverted one after the other (backward elimination). A change without a gain in training stays
        reverted. Enough budget remains for the held-out half. The note counts changes that could not be tried.
        """
        shares = list[ChangeShare]()
        changes = differences(self.plan.base, best.configuration)
        tried = changes[: max(self.left - _LOOK, 0)]
        for change in tried:
            configuration = self._without(best.configuration, [change.name])
            if configuration.config_id == self.plan.base.config_id:
                shares.append(ChangeShare(change=change, gain=round(self._gain(best, self.trials[0]), 6)))
                continue
            without = await self._separate_trial(configuration)
            gain = self._gain(best, without)
            if gain <= 0 and self.is_within(without):
                best = without
            else:
                shares.append(ChangeShare(change=change, gain=round(gain, 6)))
        untried = len(changes) - len(tried)
        note = (
            f"{untried} of {counted(len(changes), 'change')} could not be tested alone, because max_trials was used up"
        )
        return best, tuple(shares), (note,) if untried else ()

    def _gain(self, trial: _Trial, other: _Trial) -> float:
        """Return how much the summed objectives of a trial exceed those of another."""
        return sum(self.plan.values(trial.valid)) - sum(self.plan.values(other.valid))

    def _without(self, configuration: PlannerConfiguration, names: Sequence[str]) -> PlannerConfiguration:
        """Return a configuration with the named weights and settings reset to the base's values."""
        weights = configuration.weights | configuration.external_weights
        changes = differences(self.plan.base, configuration)
        assignments = [f"{one.name}={one.before!r}" for one in changes if one.name in names]
        return changed_configuration(
            configuration,
            None,
            [word for word in assignments if word.partition("=")[0] in weights],
            [word for word in assignments if word.partition("=")[0] not in weights],
        )[0]

    async def _separate_trial(self, configuration: PlannerConfiguration) -> _Trial:
        """Return a configuration's trial on all training scenarios, outside of the search."""
        runs = await self._run([self.plan.cell(scenario, configuration) for scenario in self.plan.training])
        self.driven += 1
        self._report()
        return _Trial(len(self.trials), configuration, None, tuple(runs), is_pruned=False)

    async def _judged(self, found: PlannerConfiguration) -> HeldOut:
        """Compare the base and the found configuration on the held-out scenarios, with the tests of compare_results."""
        cells = [
            self.plan.cell(one, configuration)
            for configuration in (self.plan.base, found)
            for one in self.plan.held_out
        ]
        for configuration in (self.plan.base, found):
            self._store(configuration)
        self.driven += _LOOK
        results = await run_grid(self.context, cells, lambda _: None)
        batch = store_batch(self.context, cells, results)
        self.progress.add_result(batch.batch_id)
        half = len(self.plan.held_out)
        records = [result.record for result in results]
        pairs = [
            (before, after)
            for before, after in zip(records[:half], records[half:], strict=True)
            if before is not None and after is not None and "invalid" not in (before.outcome, after.outcome)
        ]
        if not pairs:
            raise NotPossible(f"no held-out scenario could run ({batch.batch_id})", next_step="name more scenarios")
        apart = tuple(
            (self.plan.roots[one.scenario_id], self.plan.score(two) - self.plan.score(one)) for one, two in pairs
        )
        gain = await self.context.services.workers.run(JUDGE_GAIN, GainRequest(differences=apart))
        compared = await compare_results(
            CompareResultsArguments(results=[batch.batch_id]), WorkflowContext(self.context.services)
        )
        comparison = compared.comparisons[0]
        success = comparison.success
        is_success = self.plan.arguments.objective == ["success"]
        if is_success and None not in (success.low, success.high):
            gain = gain.model_copy(update={"low": success.low, "high": success.high})
        return HeldOut(
            batch_id=batch.batch_id,
            scenarios=gain.scenarios,
            gain=gain,
            success_difference=success.difference,
            success_low=success.low,
            success_high=success.high,
            p=success.p,
            collisions_before=sum(one.outcome == "collision" for one, _ in pairs),
            collisions_after=sum(two.outcome == "collision" for _, two in pairs),
            verdict=comparison.verdict,
            headline_code=comparison.headline_code,
            run_ids=comparison.run_ids,
            shown=not is_success or comparison.headline_code in ("better", "worse", "mixed"),
        )


def _study_record(
    plan: _Plan,
    trials: tuple[TrialLine, ...],
    best: PlannerConfiguration,
    *,
    changes: tuple[ChangeShare, ...] = (),
    held_out: HeldOut | None = None,
    front: tuple[TrialLine, ...] = (),
    effects: tuple[Effect, ...] = (),
    driven: int = 0,
    notes: tuple[str, ...] = (),
) -> StudyRecord:
    """Return the record of a study."""
    return StudyRecord(
        study_id=f"study_{_recipe(plan).digest}",
        method=plan.arguments.method,
        objective=tuple(plan.arguments.objective),
        constraints=tuple(plan.arguments.constraints),
        prediction=plan.arguments.prediction,
        traffic=plan.arguments.traffic,
        world=plan.world,
        base_id=plan.base.config_id,
        base_name=shown_name(plan.base.name),
        best_id=best.config_id,
        best_name=shown_name(best.name),
        training_scenarios=len(plan.training),
        training=plan.places[0],
        held_out_places=plan.places[1],
        trials=trials,
        changes=changes,
        held_out=held_out,
        front=front,
        effects=effects,
        notes=(*plan.notes, *notes),
        driven=driven,
        max_trials=plan.arguments.max_trials,
    )


async def optimize_planner(arguments: OptimizePlannerArguments, context: WorkflowContext) -> OptimizePlannerResult:
    """Search, or return the stored study; while the search runs, answer with the best candidate so far."""
    plan = _plan(arguments, context)
    recipe = _recipe(plan)
    stored = context.workspace.find_by_recipe("study", recipe)
    if stored is not None:
        return _finished(stored.read(StudyRecord), context)

    async def work(progress: JobProgress) -> None:
        search = _Search(plan, WorkflowContext(context.services), progress)
        study = await (_effects(search) if arguments.method in _SENSITIVITY else search.run())
        context.workspace.put("study", study.study_id, recipe=recipe, record=study, name=_study_name(study))
        progress.add_result(study.study_id)
        progress.report(1.0, f"{counted(len(study.trials), 'candidate')}")

    job = context.start_job("study", recipe, work)
    context.made("job", job.job_id)
    job = await context.wait_for(job.job_id, arguments.wait_s)
    stored = context.workspace.find_by_recipe("study", recipe)
    if stored is not None:
        return _finished(stored.read(StudyRecord), context)
    best = [key for key in job.results if key.startswith("cfg_")]
    return OptimizePlannerResult(
        state=job.state,
        job_id=job.job_id,
        best_so_far=best[-1] if best else None,
        message=job.error or job.message,
        next_step=f"get_job with job_id '{job.job_id}', then repeat optimize_planner with scenarios ['{job.job_id}']: "
        "finished runs are kept",
    )


_METHODS = {"tpe": "TPE", "cmaes": "CMA-ES", "random": "random"}
"""The names of search methods in titles."""


def _study_name(study: StudyRecord) -> str:
    return f"{_METHODS.get(study.method, study.method)} search for {' + '.join(study.objective)} from {study.base_name}"


def _finished(study: StudyRecord, context: WorkflowContext) -> OptimizePlannerResult:
    better = study.held_out is not None and study.held_out.is_better
    context.made("study", study.study_id)
    if better:
        context.made("config", study.best_id)
    or_more_trials = " or a larger max_trials" if study.driven >= study.max_trials else ""
    following = (
        f"export_artifacts of {study.best_id} as yaml"
        if better
        else f"use more scenarios{or_more_trials}, or vary settings too"
    )
    if study.headline_code == "effects_shown":
        following = "optimize_planner with vary limited to the weights that matter"
    elif study.effects:
        following = f"use more scenarios{or_more_trials}: the effects are too uncertain"
    return OptimizePlannerResult(state="done", study=study, headline_code=study.headline_code, next_step=following)


async def _effects(search: _Search) -> StudyRecord:
    """Return a sensitivity analysis: every point of a design on all scenarios."""
    plan, arguments = search.plan, search.plan.arguments
    design = DesignRequest(
        method="morris" if arguments.method == "morris" else "sobol",
        names=tuple(one.name for one in plan.space),
        most=arguments.max_trials - 1,  # the base is run too
        seed=arguments.seed,
    )
    points = (await search.context.services.workers.run(SENSITIVITY_DESIGN, design)).points
    await search.tried([(plan.base, point_of(plan.space, plan.base))], prune=False)
    for start in range(0, len(points), _ROUND):
        await search.tried([(plan.at(point), point) for point in points[start : start + _ROUND]], prune=False)
    values = tuple(sum(plan.values(trial.valid)) for trial in search.trials[1:])
    at_points = search.trials[1:]
    request = EffectsRequest(
        design=design,
        values=values,
        scores=tuple(
            tuple(None if run is None or run.outcome == "invalid" else plan.score(run) for run in trial.runs)
            for trial in at_points
        ),
        units=tuple(plan.roots[one.scenario_id] for one in plan.training),
    )
    found = await search.context.services.workers.run(SENSITIVITY_EFFECTS, request)
    effects = tuple(_with_runs(effect, at_points) for effect in found.effects)
    lines = tuple(map(search.line, search.trials))
    return _study_record(plan, lines, plan.base, effects=effects, driven=search.driven)


def _with_runs(effect: Effect, trials: Sequence[_Trial]) -> Effect:
    """Return the effect with the two runs between which the weight changed the objective most."""
    if effect.largest is None:
        return effect
    first, second, scenario = effect.largest
    runs = (trials[first].runs[scenario], trials[second].runs[scenario])
    return effect.model_copy(update={"largest": None, "run_ids": tuple(run.run_id for run in runs if run is not None)})


def _plan(arguments: OptimizePlannerArguments, context: WorkflowContext) -> _Plan:
    """Return the resolved arguments of a call.

    Raises:
        PlannerForgeError: there are unknown or malformed arguments; all are reported together.
    """
    faults = Faults()
    objectives, constraints = list[Objective](), list[Constraint]()
    world = PERFECT
    with faults.collecting():
        world = world_of(arguments.world)
    with faults.collecting():
        check_modes(arguments.traffic, arguments.prediction, world)
    for text in arguments.objective:
        with faults.collecting():
            objectives.append(parse_objective(text))
    for text in arguments.constraints:
        with faults.collecting():
            constraints.append(parse_constraint(text))
    with faults.collecting():
        base = resolve_configuration(arguments.base, context)
        space = dimensions(base.planner, arguments.vary)
        check_world(base.planner, world)
        if arguments.method == "morris" or arguments.method == "sobol":
            _check_design(arguments.method, len(space), arguments.max_trials)
    with faults.collecting():
        choice = choose_scenarios(arguments.scenarios, context)
        lineage = {
            one.scenario_id: one.root for one in lineages((one.scenario_id for one in choice.scenarios), context)
        }
        roots = {one.scenario_id: lineage.get(one.scenario_id, one.scenario_id) for one in choice.scenarios}
        strata = _strata(choice.scenarios, roots, context)
        if arguments.method in _SENSITIVITY:
            parts: _Parts = (tuple(choice.scenarios), ()), ((), ()), ()
        else:
            parts = _divided(choice.scenarios, roots, arguments.seed, strata)
    with faults.collecting():
        if arguments.pareto and (arguments.method not in ("tpe", "random") or len(arguments.objective) < 2):
            raise InvalidRequest(
                "pareto needs at least two objectives and the method tpe or random",
                valid=["method=tpe", "method=random", "pareto=false"],
                remedies=[with_values(method="tpe") if len(arguments.objective) > 1 else with_values(pareto=None)],
            )
    faults.raise_all()
    (training, held_out), places, notes = parts
    store_configuration(context, base)
    return _Plan(
        arguments=arguments,
        base=base,
        objectives=tuple(objectives),
        constraints=tuple(constraints),
        space=space,
        training=training,
        held_out=held_out,
        places=places,
        roots=strata or roots,
        notes=(*choice.notes, *notes),
        world=world,
    )


def _check_design(method: Literal["morris", "sobol"], weights: int, most: int) -> None:
    """Refuse a sensitivity analysis if its smallest design needs more runs than allowed.

    Raises:
        InvalidRequest: the design is too large; the error gives the number of runs needed and the number of weights
            that fit.
    """
    needed = 1 + fewest_configurations(method, weights)
    if needed > most:
        fewer = max(
            (count for count in range(1, weights) if 1 + fewest_configurations(method, count) <= most), default=0
        )
        valid = [f"max_trials={needed}", *([f"vary with at most {counted(fewer, 'weight')}"] if fewer else [])]
        raise InvalidRequest(
            f"{method} with {counted(weights, 'weight')} needs {needed} configurations, more than max_trials={most}",
            valid=valid,
        )


_Parts = tuple[
    tuple[tuple[ChosenScenario, ...], tuple[ChosenScenario, ...]],
    tuple[tuple[str, ...], tuple[str, ...]],
    tuple[str, ...],
]
"""Training and held-out scenarios, the places of each, and notes."""


def _strata(
    scenarios: Sequence[ChosenScenario], roots: Mapping[str, str], context: WorkflowContext
) -> dict[str, str] | None:
    """Return the strata of failures that a search found near one base, by scenario; None for other scenarios."""
    if len(set(roots.values())) != 1:
        return None
    cells = found_failures(context)
    if any(one.scenario_id not in cells for one in scenarios):
        return None
    return {one.scenario_id: cells[one.scenario_id].counterpart for one in scenarios}


def _divided(
    scenarios: Sequence[ChosenScenario], roots: Mapping[str, str], seed: int, strata: Mapping[str, str] | None = None
) -> _Parts:
    """Return the scenarios in two halves with no place in common, each in an order drawn from the seed.

    If all are in one place, maps are split instead; if all are failures near one base, their strata.

    Raises:
        NotPossible: there is only one map.
    """
    notes: tuple[str, ...] = ()
    groups = _grouped(scenarios, roots, by_map=False)
    if len(groups) < 2:
        groups = _grouped(scenarios, roots, by_map=True)
        notes = ("all scenarios are in one place, so its maps were split; they may be alike",)
    if len(groups) < 2 and strata is not None and len(set(strata.values())) > 1:
        groups = _by_stratum(scenarios, strata)
        notes = ("all scenarios are failures near one base, so the result is judged on other strata of its search",)
    if len(groups) < 2:
        raise NotPossible(
            f"the search judges its result on a map of its own, but {_on_one_map(len(scenarios))}",
            valid=["scenarios of two places or more, such as preset:100"],
            next_step="add scenarios of another place",
            complete=True,
        )
    choice = random.Random(seed)  # noqa: S311 - not a secret
    drawn = sorted(groups)
    choice.shuffle(drawn)
    halves: tuple[list[ChosenScenario], list[ChosenScenario]] = ([], [])
    places: tuple[list[str], list[str]] = ([], [])
    for place in drawn:
        index = 0 if len(halves[0]) <= len(halves[1]) else 1
        halves[index].extend(groups[place])
        places[index].append(place)
    for half in halves:
        choice.shuffle(half)
    return (tuple(halves[0]), tuple(halves[1])), (tuple(sorted(places[0])), tuple(sorted(places[1]))), notes


def _by_stratum(scenarios: Sequence[ChosenScenario], strata: Mapping[str, str]) -> dict[str, list[ChosenScenario]]:
    groups: dict[str, list[ChosenScenario]] = {}
    for one in sorted(scenarios, key=lambda one: (one.scenario_id, one.problem_id or 0)):
        groups.setdefault(strata[one.scenario_id], []).append(one)
    return groups


def _on_one_map(count: int) -> str:
    return "the only scenario is on one map" if count == 1 else f"all {count} scenarios are on one map"


def _grouped(
    scenarios: Sequence[ChosenScenario], roots: Mapping[str, str], *, by_map: bool
) -> dict[str, list[ChosenScenario]]:
    """Return scenarios by place (``DEU_Aachen`` of ``DEU_Aachen-2_7_T-1``) or by map (``DEU_Aachen-2``)."""
    groups: dict[str, list[ChosenScenario]] = {}
    for one in sorted(scenarios, key=lambda one: (one.scenario_id, one.problem_id or 0)):
        name = roots[one.scenario_id].removeprefix("C-")
        place, _, rest = name.partition("-")
        groups.setdefault(f"{place}-{rest.partition('_')[0]}" if by_map else place, []).append(one)
    return groups


def _recipe(plan: _Plan) -> Recipe:
    """Return the recipe of a study; it leaves out how long a call waits."""
    arguments = plan.arguments.model_dump(mode="json", exclude={"wait_s", "scenarios", "base", "seed", "world"})
    arguments |= {} if plan.world.is_perfect else {"world": plan.world.stated}
    scenarios = [[one.scenario_id, one.problem_id] for one in (*plan.training, *plan.held_out)]
    packages = ("optuna", "cmaes", "SALib", "frenetix", "commonroad-io", "commonroad-drivability-checker")
    return Recipe(
        tool="optimize_planner",
        arguments=arguments | {"scenarios": scenarios, "base": plan.base.config_id},
        parents=(plan.base.config_id,),
        seed=plan.arguments.seed,
        versions=versions_of(*packages) | own_versions([plan.base.planner]),
    )
