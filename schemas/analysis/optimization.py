"""Searches for better configurations: arguments, worker requests, the record of a study, and the answer."""

from typing import Literal

from pydantic import Field

from ..base import Answer, Arguments, Model, Result
from ..jobs import JobState, state_in_words
from ..planning import WeightChange
from ..results import figure
from ..runs import Prediction, Traffic
from ..text import counted, p_in_words
from ..worlds import PERFECT, PERFECT_NAME, World
from .comparison import HeadlineCode

StudyCode = Literal[
    "better", "worse", "no_gain_shown", "nothing_better", "not_judged", "effects_shown", "no_effect_shown"
]
"""The result of a study.

For a search, it states how the found configuration does on unseen scenarios, that nothing was better in training, or
that ``max_trials`` left no runs for unseen scenarios. For a sensitivity analysis, it states whether a weight
matters."""
SearchMethod = Literal["tpe", "cmaes", "random"]
"""How candidates are drawn: tree-structured Parzen estimators, covariance matrix adaptation, or uniformly."""
_SHOWN = 5
"""How many changes, weights or front members the brief answer shows (chosen)."""


class OptimizePlannerArguments(Arguments):
    """Search better weights on half of the roads, judge them on the rest (job); morris, sobol: which weights matter."""

    scenarios: list[str] = Field(["preset:100"], min_length=1, description="as in run_planner; many, of several places")
    base: str = Field("current", description="config id, PLANNER[:PRESET]: to beat")
    objective: list[str] = Field(
        ["success"], min_length=1, description="success, collisions, risk, comfort, time; summed, with 'comfort*0.2'"
    )
    pareto: bool = Field(False, description="a front of the objectives instead of their sum")
    constraints: list[str] = Field([], description="'success>=base', 'collisions<=0.1'")
    vary: list[str] = Field([], description="'jerk', 'horizon_s=2..5'; default: all weights")
    method: Literal["tpe", "cmaes", "random", "morris", "sobol"] = "tpe"
    """How to draw candidates; `morris` and `sobol` do not search, but show which weights matter."""
    max_trials: int = Field(40, ge=1, le=2000)
    """The maximum number of configurations to run: candidates, reverted changes, and both on the held-out half."""
    prediction: Prediction = "constant_velocity"
    """As in `run_planner`."""
    traffic: Traffic = "recorded"
    """As in `run_planner`."""
    world: str = PERFECT_NAME
    """As in `run_planner`."""
    wait_s: float = Field(45, ge=0, le=50)
    """How long to wait for the study, in s. Afterwards the answer gives the job's id."""
    seed: int = 0
    """The seed of the split into halves and of the method's draws."""


class EvaluatedTrial(Model):
    """An evaluated candidate: its position in [0, 1] per dimension, and its objectives (higher is better)."""

    point: tuple[float, ...]
    values: tuple[float, ...]


class ProposeRequest(Model):
    """The state of a search: ``enqueued`` points are tried first, and ``rounds`` holds the results round by round.

    ``start`` is the point of the base, ``count`` the number of new points requested, ``objectives`` the number of
    objectives.
    """

    method: SearchMethod
    seed: int
    names: tuple[str, ...]
    start: tuple[float, ...]
    objectives: int
    enqueued: tuple[EvaluatedTrial, ...]
    rounds: tuple[tuple[EvaluatedTrial, ...], ...]
    count: int


class Proposals(Model):
    """Points in [0, 1], one number per dimension."""

    points: tuple[tuple[float, ...], ...]


class DesignRequest(Model):
    """A design for a sensitivity analysis with at most ``most`` points, or the smallest possible design."""

    method: Literal["morris", "sobol"]
    names: tuple[str, ...]
    most: int
    seed: int


class EffectsRequest(Model):
    """The objective at each point of a design, in order.

    ``scores`` holds the objective of each scenario at each point, None if absent. ``units`` maps each scenario to the
    original scenario that it belongs to. If ``units`` is empty, the scenarios are not tested.
    """

    design: DesignRequest
    values: tuple[float, ...]
    scores: tuple[tuple[float | None, ...], ...] = ()
    units: tuple[str, ...] = ()


class Effect(Model):
    """How much a weight matters to the objective on these scenarios.

    ``effect`` is Morris's μ* (the mean absolute change over the weight's range) or Sobol's total index. ``margin`` is
    half of its 95% interval (bootstrap). ``p`` is the chance that random signs of scenarios give at least this effect,
    and ``p_adjusted`` accounts for the number of tested weights. ``verdict`` is ``matters`` if ``p_adjusted`` is below
    5% and the adjusted interval is above 0, and ``none`` if no change of the weight had an effect. ``largest`` gives
    the two points and the scenario with the largest change, and ``run_ids`` their runs.
    """

    name: str = Field(description="the weight or setting")
    effect: float
    margin: float
    verdict: Literal["matters", "none", "unclear"]
    p: float | None = None
    p_adjusted: float | None = None
    largest: tuple[int, int, int] | None = Field(None, exclude_if=lambda largest: largest is None)
    run_ids: tuple[str, ...] = ()


class Effects(Model):
    """The effects of the weights, most important first."""

    effects: tuple[Effect, ...]


class GainRequest(Model):
    """Differences of an objective on held-out scenarios, each with the original scenario that it belongs to."""

    differences: tuple[tuple[str, float], ...]


class Gain(Model):
    """The mean difference over scenarios with its 95% interval, which has no width if all differences are equal."""

    difference: float = Field(description="mean of after − before, in the objective's unit")
    low: float = Field(description="lower end of its 95% interval")
    high: float = Field(description="upper end of its 95% interval")
    scenarios: int = Field(description="scenarios averaged")


class TrialLine(Model):
    """One candidate: its configuration, mean objectives over the training scenarios, and number of runs.

    ``pruned`` means that it was abandoned before it ran on all training scenarios; its values are then the base's plus
    the difference on the scenarios that it ran. ``within`` means that it breaks no constraint.
    """

    number: int = Field(description="number of the trial, from 0")
    config_id: str = Field(description="id of its configuration")
    name: str = Field(description="name of its configuration")
    values: tuple[float, ...] = Field(description="mean of each objective over the training scenarios, in their order")
    runs: int = Field(description="number of its runs")
    pruned: bool
    within: bool


class ChangeShare(Model):
    """A change of the found configuration, and the training gain that is lost if only this change is reverted."""

    change: WeightChange = Field(description="the changed weight or setting")
    gain: float = Field(
        description="training gain of the first objective that is lost without it, in the objective's unit"
    )


class HeldOut(Model):
    """The only evaluation on unseen scenarios: the found configuration compared with the base, by the tests of
    compare_results.
    """

    batch_id: str = Field(description="id of the batch of the held-out runs")
    scenarios: int = Field(description="held-out scenarios compared")
    gain: Gain = Field(description="difference of the objective, found − base")
    success_difference: float | None = Field(description="difference of the success rates, found − base, from -1 to 1")
    success_low: float | None = Field(description="lower end of its 95% interval")
    success_high: float | None = Field(description="upper end of its 95% interval")
    p: float | None = Field(description="exact two-sided p of the difference of success")
    collisions_before: int = Field(description="runs of the base that ended in a collision")
    collisions_after: int = Field(description="the same of the found configuration")
    verdict: str = Field(description="the verdict in one sentence")
    headline_code: HeadlineCode | None = Field(None, description="code of what the pairs show about success")
    run_ids: tuple[str, ...] = Field((), description="runs to check it with, at most eight")
    shown: bool = Field(True, description="false if the comparison does not show it after adjusting for all its tests")

    @property
    def is_better(self) -> bool:
        """Whether the comparison shows a significant gain."""
        return self.gain.low > 0 and self.shown

    @property
    def is_worse(self) -> bool:
        """Whether the comparison shows a significant loss."""
        return self.gain.high < 0 and self.shown


class StudyRecord(Model):
    """A search or a sensitivity analysis: the evaluated candidates and the result.

    ``training`` and ``held_out_places`` are the places (or maps) of the two parts. ``best`` is the found configuration,
    or the base if nothing was better in training.
    """

    study_id: str
    method: str = Field(description="how candidates were chosen")
    objective: tuple[str, ...] = Field(description="objectives, the most important first")
    constraints: tuple[str, ...] = Field(description="constraints on every candidate")
    prediction: Prediction
    traffic: Traffic
    world: World = Field(
        PERFECT, exclude_if=lambda world: world.is_perfect, description="the sensors of its runs; absent: perfect"
    )
    base_id: str = Field(description="id of the initial configuration")
    base_name: str = Field(description="its name")
    best_id: str = Field(description="id of the found configuration")
    best_name: str = Field(description="name of the found configuration")
    training_scenarios: int = Field(description="scenarios used by the search")
    training: tuple[str, ...] = Field(description="their places (or maps)")
    held_out_places: tuple[str, ...]
    trials: tuple[TrialLine, ...] = Field(description="all candidates in their order")
    changes: tuple[ChangeShare, ...] = Field((), description="gain of each change of the found configuration")
    held_out: HeldOut | None = Field(None, description="the comparison on unseen scenarios; null without one")
    front: tuple[TrialLine, ...] = Field((), description="candidates that no other beats in all objectives")
    effects: tuple[Effect, ...] = Field((), description="effect of each weight; only for a sensitivity analysis")
    notes: tuple[str, ...] = ()
    driven: int = Field(0, description="configurations run; 0: an older version made the study")
    max_trials: int = Field(0, description="the maximum number of these")

    @property
    def headline_code(self) -> StudyCode:
        """The result as a code."""
        if self.effects:
            return "effects_shown" if any(one.verdict == "matters" for one in self.effects) else "no_effect_shown"
        if self.held_out is not None:
            if self.held_out.is_better:
                return "better"
            return "worse" if self.held_out.is_worse else "no_gain_shown"
        return "nothing_better" if self.best_id == self.base_id else "not_judged"


class OptimizePlannerResult(Result):
    """The finished study, or the job and the best candidate so far."""

    state: JobState
    job_id: str | None = None
    study: StudyRecord | None = Field(None, description="the study; null until it is done")
    headline_code: StudyCode | None = Field(None, description="stable code of the result; null until it is done")
    best_so_far: str | None = Field(None, description="configuration id")
    message: str = Field("", description="progress in words")
    next_step: str

    def answer(self) -> Answer:
        """Return what was found and whether it holds on unseen scenarios."""
        if self.study is None:
            found = [] if self.best_so_far is None else [f"Best so far: {self.best_so_far}."]
            headline = state_in_words(self.job_id, self.state, self.message)
            return Answer(headline, decided=found, next_step=self.next_step)
        study = self.study
        notes = [f"Note: {note}" for note in study.notes]
        notes += [] if study.world.is_perfect else [f"World of the runs: {study.world.in_words()}."]
        if study.effects:
            return Answer(_effects_headline(study), figures=_effects(study), listed=notes, next_step=self.next_step)
        return Answer(
            _headline(study),
            decided=[_searched(study)],
            figures=_figures(study),
            listed=notes,
            next_step=self.next_step,
        )


def _values(values: tuple[float, ...]) -> str:
    return "training score " + ", ".join(figure(value) for value in values)


def _headline(study: StudyRecord) -> str:
    held_out, code = study.held_out, study.headline_code
    found = f"{study.best_id} ({study.best_name})"
    if held_out is None:
        if code == "not_judged":
            result = "scored higher in training, but max_trials left no runs for the held-out half, so no gain is shown"
            return f"{study.study_id}: {found} {result}."
        return f"{study.study_id}: no candidate scored better than {study.base_name} in training."
    result = {"better": "is better than", "worse": "is worse than"}.get(code, "is not shown to be better than")
    gain = held_out.gain
    return (
        f"{study.study_id}: {found} {result} {study.base_name} on {held_out.scenarios} held-out scenarios: objective"
        f" {gain.difference:+.3f} (95% {gain.low:+.3f} to {gain.high:+.3f})."
    )


_METHOD_NAMES = {"tpe": "Tree-structured Parzen estimator (TPE)", "cmaes": "CMA-ES", "random": "Random"}


def _searched(study: StudyRecord) -> str:
    pruned = sum(trial.pruned for trial in study.trials)
    driven = (
        f"; ran {study.driven} of at most {study.max_trials} configurations, including the base and tests"
        if study.driven
        else ""
    )
    return (
        f"{_METHOD_NAMES.get(study.method, study.method)} search for {' + '.join(study.objective)}:"
        f" {counted(len(study.trials), 'candidate')}{f' ({pruned} stopped early)' if pruned else ''} on"
        f" {counted(study.training_scenarios, 'scenario')} from {counted(len(study.training), 'place')}; held"
        f" out: {counted(len(study.held_out_places), 'other place')}{driven}."
    )


def _figures(study: StudyRecord) -> list[str]:
    base = next(trial for trial in study.trials if trial.config_id == study.base_id)
    others = [trial for trial in study.trials if trial.config_id != study.base_id]
    best = next((trial for trial in others if trial.config_id == study.best_id), None)
    lines = [f"Base: {_values(base.values)}" + (f"; found: {_values(best.values)}." if best is not None else ".")]
    held_out = study.held_out
    if held_out is not None:
        collisions = f"collisions {held_out.collisions_before} → {held_out.collisions_after}"
        lines.append(f"Held out ({held_out.batch_id}): {held_out.verdict.rstrip('.')}; {collisions}.")
    if study.changes:
        shown = sorted(study.changes, key=lambda share: -share.gain)[:_SHOWN]
        changes = [f"{one.change.name} {one.change.before:g} → {one.change.after:g} ({one.gain:+.3f})" for one in shown]
        more = len(study.changes) - len(shown)
        rest = f" and {more} more" if more else ""
        lines.append(f"Changes, with the training score each adds: {', '.join(changes)}{rest}.")
    if study.front:
        members = [f"{one.config_id} {', '.join(figure(value) for value in one.values)}" for one in study.front]
        lines.append(f"Pareto front ({', '.join(study.objective)}), {len(members)}: {'; '.join(members[:_SHOWN])}.")
    return lines


def _effects_headline(study: StudyRecord) -> str:
    matters = [one.name for one in study.effects if one.verdict == "matters"]
    verb = "matters" if len(matters) == 1 else "matter"
    result = f"{', '.join(matters)} {verb}" if matters else "no weight is shown to matter"
    most = f" of at most {study.max_trials}" if study.max_trials else ""
    return (
        f"{study.study_id}: on {counted(study.training_scenarios, 'scenario')} {result} to"
        f" {' + '.join(study.objective)} ({study.method}, {len(study.trials)}{most} configurations)."
    )


def _effects(study: StudyRecord) -> list[str]:
    name = "Mean absolute effect (μ*)" if study.method == "morris" else "Total index"

    def line(one: Effect) -> str:
        p = "" if one.p_adjusted is None else f", {p_in_words(one.p_adjusted)}"
        runs = f"; {' '.join(one.run_ids)}" if one.run_ids and one.verdict == "matters" else ""
        return f"{one.name} {figure(one.effect)} ± {figure(one.margin)} (95%{p}{runs})"

    shown = [line(one) for one in study.effects if one.verdict == "matters"]
    unclear = [line(one) for one in study.effects if one.verdict == "unclear"]
    idle = [one.name for one in study.effects if one.verdict == "none"]
    return [
        *([f"{name} of weights that matter: {', '.join(shown)}."] if shown else []),
        *([f"{name} of weights with an unclear effect: {', '.join(unclear)}."] if unclear else []),
        *([f"No effect: {', '.join(idle)}."] if idle else []),
    ]
