"""Planners and their configurations: arguments and results of list_planners, configure_planner and run_planner."""

import hashlib
import json
import re
from typing import Annotated, Literal

from pydantic import Field, StringConstraints, field_validator, model_validator

from .base import Answer, Arguments, Model, Result
from .reviews import RuleVerdict, RunReview, broken_in_words
from .runs import (
    Bounded,
    BoundedCost,
    LostCell,
    Outcome,
    Prediction,
    RunRecord,
    RunSeries,
    RunSteps,
    RunTiming,
    Traffic,
    ending,
)
from .text import without_shared_clauses
from .worlds import PERFECT, PERFECT_NAME, World

PLANNERS_VARIABLE = "PLANNERFORGE_PLANNERS"
"""The environment variable of the setting that names planner programs; workers read it too."""
WEIGHT_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
"""Valid names of weights in assignments."""
LONGEST_NAME = 60
"""The maximum length of the name of a weight, cost term, constraint or debug value."""
PrintedName = Annotated[str, StringConstraints(pattern=rf"^[A-Za-z0-9_][A-Za-z0-9_ .:/-]{{0,{LONGEST_NAME - 1}}}$")]
"""The name that a program gives to a cost term, a constraint or a debug value.

It is printable and fits on a line, because tables, the player and answers show it."""
MOST_TERMS = 64
"""The maximum number of cost terms or constraints of a plan. Frenetix has 13, the most of the built-in planners."""
LISTED_RUNS, LISTED_FAILURES, LISTED_CONFIGURATIONS = 20, 3, 8
"""The number of runs, failures and configurations that an answer lists (chosen)."""


class PlannerSettings(Model):
    """The settings of a run; ``engine/tuning/settings.py`` states ranges and meanings.

    ``vehicle`` is CommonRoad's vehicle 1 to 4, and a parameter of None has that vehicle's value. Without ``vehicle``,
    the ego's class decides, with vehicle 2 for a car. ``vehicle_stated`` is True if the configuration names vehicle 2
    itself. Lengths are in m, speeds in m/s, accelerations in m/s², angles in rad. The planner replans every
    ``replan_steps`` time steps of the scenario. ``search`` is one of FISS's four searches. Its default is not written,
    so the ids of older configurations stay the same.
    """

    vehicle: int = 2
    vehicle_stated: bool = Field(False, exclude_if=lambda stated: not stated)
    length_m: float | None = None
    width_m: float | None = None
    wheelbase_m: float | None = None
    rear_axle_behind_center_m: float | None = None
    maximum_acceleration_mps2: float | None = None
    maximum_speed_mps: float | None = None
    switching_speed_mps: float | None = None
    maximum_steering_rad: float | None = None
    maximum_steering_rate_radps: float | None = None
    horizon_s: float = 3.0
    replan_steps: int = 3
    sampling_level: int = 2
    search: int = Field(2, exclude_if=lambda number: number == 2)

    @property
    def states_vehicle(self) -> bool:
        """Whether the configuration names the vehicle, so the ego's class does not decide."""
        return self.vehicle_stated or self.vehicle != 2

    @property
    def stated_values(self) -> dict[str, float]:
        """The settings by name, in the notation of a file or call, except those that the ego's class determines."""
        left_out = {"vehicle_stated"} if self.states_vehicle else {"vehicle_stated", "vehicle"}
        return self.model_dump(exclude_none=True, exclude=left_out)


class PlannerConfiguration(Model):
    """An immutable planner configuration: cost weights and settings, with an id that is a digest of its content.

    ``base`` is the configuration that ``assignments`` changed. ``template`` is the user's file that it comes from.
    """

    config_id: str
    planner: str
    name: str
    preset: str = Field(description="the preset that set all weights before the assignments")
    base: str | None = None
    assignments: tuple[str, ...] = ()
    weights: dict[str, float]
    external_weights: dict[str, float] = Field(default_factory=dict)
    settings: PlannerSettings = PlannerSettings()
    template: str = Field("", exclude_if=lambda text: not text)

    @property
    def content_id(self) -> str:
        """The id that follows from the content. It differs from ``config_id`` only if the record is forged.

        Default settings and a missing file do not enter the digest, so ids from before these existed stay valid.
        """
        return configuration_id_of(self.planner, self.weights, self.external_weights, self.settings, self.template)


def configuration_id_of(
    planner: str, weights: dict[str, float], external: dict[str, float], settings: PlannerSettings, template: str
) -> str:
    """Return the id of a configuration with this content."""
    stated = settings.model_dump(exclude_defaults=True)
    parts = [planner, weights, external, *([stated] if stated or template else []), *([template] if template else [])]
    return f"cfg_{hashlib.sha256(json.dumps(parts, separators=(',', ':')).encode()).hexdigest()[:12]}"


class RunMoment(Model):
    """The ego at a step of a run: its centre in m, heading in rad, speed, acceleration and yaw rate."""

    step: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float = 0.0
    yaw_rate_radps: float = 0.0


class RunRequest(Model):
    """The request of one planner run, as a worker receives it."""

    run_id: str
    scenario_path: str
    scenario_id: str
    problem_id: int | None = Field(None, description="None means the first planning problem")
    configuration: PlannerConfiguration
    prediction: Prediction = "constant_velocity"
    traffic: Traffic = "recorded"
    seed: int = 0
    planner_version: str = Field("", description="for an external planner: the version that the run is stored under")
    begins_at: RunMoment | None = Field(None, description="the ego's start; None means that of the planning problem")
    world: World = PERFECT


class RunResponse(Model):
    """The result of a run: the record, the driven steps, and the measured times."""

    record: RunRecord
    steps: RunSteps
    timing: RunTiming
    series: RunSeries | None = Field(None, description="None if the run has no driven motion on a route")
    planner_log: str = Field("", description="the end of a command-line planner's standard error")


class ReplayRequest(Model):
    """A stored run to replay: how to replay it, the path of its steps, and the path to write its plans to."""

    run: RunRequest
    steps_path: str
    path: str


class Replayed(Model):
    """The path of a run's plans (``RunPlans``), or an empty path with the reason if there is nothing to show."""

    path: str = ""
    note: str = ""


class ShownPlan(Model):
    """The plan of a planner at one step, as lines x, y, x, y, … in m.

    ``plan`` is the chosen trajectory, and ``predictions`` are the expected positions of others.
    """

    step: int
    plan: tuple[float, ...]
    candidates: tuple[tuple[float, ...], ...] = ()
    predictions: tuple[tuple[float, ...], ...] = ()


class RunPlans(Model):
    """The planning steps of a run."""

    plans: tuple[ShownPlan, ...]


class ListPlannersArguments(Arguments):
    """Planners, weights (value, meaning, effect of raising), presets, settings, configurations."""

    planner: str | None = None
    """Only this planner."""
    config_id: str | None = Field(None, description="default: current")


class WeightInfo(Model):
    """A cost weight: its current value, the meaning of its term, the effect of raising it, and whether it acts."""

    name: str = Field(description="name of the weight")
    value: float = Field(description="current value, without unit")
    meaning: str = Field(description="what its cost term measures")
    raising: str = Field(description="effect of raising it")
    acts: bool = Field(description="whether it acts on the cost")
    computed_by: str = Field(description="code that computes its term")
    lowest: float = Field(description="smallest valid value")
    highest: float = Field(description="largest valid value")


class PresetInfo(Model):
    """A preset: its name, the paper's short name, its purpose, and the weights that are not 0."""

    name: str = Field(description="name of the preset")
    short_name: str = Field(description="the paper's short name")
    intent: str = Field(description="its purpose")
    weights: dict[str, float] = Field(description="its weights that are not 0")


class SettingInfo(Model):
    """A setting other than a weight: its current value, its range with the unit, and its meaning."""

    name: str = Field(description="name of the setting")
    value: float = Field(description="current value, in the unit of `range`")
    range: str = Field(description="valid values, with their unit")
    meaning: str = Field(description="its effect")


class PlannerInfo(Model):
    """An available planner and its presets."""

    name: str = Field(description="name of the planner")
    summary: str = Field(description="description in one sentence")
    presets: tuple[str, ...] = Field(description="names of its presets")


class ConfigurationInfo(Model):
    """A configuration created in this workspace."""

    config_id: str
    name: str = Field(description="name of the configuration")
    base: str | None = Field(description="id of the configuration it was derived from; null if from a file")


class ListPlannersResult(Result):
    """The planners, and the adjustable values of the planner of one configuration."""

    planners: tuple[PlannerInfo, ...] = Field(description="available planners")
    predictions: tuple[Prediction, ...] = Field(description="available predictions of others")
    config_id: str = Field(description="id of the configuration whose values are shown")
    config_name: str = Field(description="its name")
    weights: tuple[WeightInfo, ...] = Field(description="cost weights of its planner")
    presets: tuple[PresetInfo, ...] = Field(description="presets of its planner")
    settings: tuple[SettingInfo, ...] = Field(description="other settings of its planner")
    configurations: tuple[ConfigurationInfo, ...] = Field(description="newest first, at most eight")

    def answer(self) -> Answer:
        """Return planners with presets, the active weights with their effects, settings, and configurations."""
        lines = [
            "; presets ".join([f"{item.name}: {item.summary}", *([", ".join(item.presets)] if item.presets else [])])
            for item in self.planners
        ]
        lines.append(f"Predictions: {', '.join(self.predictions)}.")
        acting = [weight for weight in self.weights if weight.acts]
        owner = f"{self.config_id} ({self.config_name})"
        usual = ", each from 0 (off) to 1,000,000 unless another range is given:" if acting else ": none"
        lines.append(f"Weights of {owner}{usual}")
        for item in acting:
            ranged = "" if (item.lowest, item.highest) == (0, 1e6) else f" ({item.lowest:g} to {item.highest:g})"
            lines.append(f"  {item.name}={item.value:g}{ranged}: {item.meaning}; higher: {item.raising}")
        intents = [
            f"{preset.name}{f' or {preset.short_name}' if preset.short_name != preset.name else ''} ({preset.intent})"
            for preset in self.presets
        ]
        lines.append(f"Presets: {'; '.join(intents)}.")
        lines.append(f"Settings: {'; '.join(f'{item.name}={item.value:g} ({item.range})' for item in self.settings)}.")
        made = [
            f"{entry.config_id} ({entry.name}{f' from {entry.base}' if entry.base else ''})"
            for entry in self.configurations
        ]
        lines.append(f"Configurations in this workspace: {', '.join(made) or 'none'}.")
        return Answer(lines[0], listed=lines[1:])


class ConfigurePlannerArguments(Arguments):
    """New planner configuration: preset (replaces all weights), then changes."""

    planner: str | None = Field(None, description="default: the base's")
    preset: str | None = Field(None, description="Default, Comfort, Balanced, Sporty, Safety")
    weights: list[str] = Field([], description="'jerk=0.5', 'jerk*2', 'jerk+0.1', 'jerk=lateral_jerk'")
    settings: list[str] = Field([], description="'vehicle=1', horizon_s, replan_steps, sampling_level, length_m …")
    base: str = Field("current", description="config id")


class WeightChange(Model):
    """A weight or setting with its values before and after."""

    name: str = Field(description="name of the weight or setting")
    before: float = Field(description="its value before")
    after: float = Field(description="its value after")


class ConfigurePlannerResult(Result):
    """The new configuration, which is now the current one; ``notes`` state changes without effect.

    ``base`` is the configuration it was derived from. ``changes`` are relative to ``against``: the preset if it was
    changed too, otherwise the base.
    """

    config_id: str = Field(description="id of the new configuration")
    name: str = Field(description="its name")
    planner: str = Field(description="its planner")
    base: str
    against: str = Field(description="name of what `changes` refer to")
    changes: tuple[WeightChange, ...]
    notes: tuple[str, ...]
    yaml: str = Field(description="the configuration as a file")
    reused: bool = Field(description="whether the same weights were already stored under this id")

    def answer(self) -> Answer:
        """Return the id and the differences.

        ``export_artifacts`` writes the file, which the structured answer contains.
        """
        again = " (already stored)" if self.reused else ""
        changes = ", ".join(f"{item.name} {item.before:g} → {item.after:g}" for item in self.changes)
        return Answer(
            headline=f"{self.config_id} ({self.name}){again} is now current.",
            decided=[f"Changes from {self.against}: {changes or 'none'}.", *self.notes],
            next_step="run_planner",
        )


class RunPlannerArguments(Arguments):
    """Run scenarios x configurations; large grids give a job id."""

    scenarios: list[str] = Field(
        ["latest"],
        min_length=1,
        description="scenario ids or ID#problem, a search id or search:latest (all hits), preset:N",
    )
    configs: list[str] = Field(["current"], min_length=1, description="config ids, PLANNER[:PRESET]")
    prediction: Prediction = "constant_velocity"
    """The prediction of others that the planner receives."""
    traffic: Traffic = "recorded"
    """Whether others follow their recording or react to the ego."""
    world: str = Field(PERFECT_NAME, description="sensors: lidar, camera, fog …, missed=0.1")
    wait_s: float = Field(45, ge=0, le=50)
    """How long to wait for the runs, in s. Afterwards the answer gives the job's id."""
    seed: int = 0
    """The seed of reactive traffic and of the sensors."""


class RunLine(Model):
    """One run in a list."""

    run_id: str
    scenario_id: str
    problem_id: int
    config_id: str
    outcome: Outcome
    reason: str = Field(description="reason for the outcome")
    duration_s: float | None = Field(description="length of the drive; null if it could not be attempted")
    minimum_distance_m: float | None = Field(
        description="smallest distance to another road user; null if no road user was near"
    )
    config_name: str = ""
    review: RunReview | None = Field(None, description="for a single run and for listed failures")
    broken_rules: tuple[RuleVerdict, ...] = Field(
        (), exclude_if=lambda rules: not rules, description="for a single run: all traffic rules that it broke"
    )

    def in_words(self, modes: str = "") -> str:
        """Return the run, scenario, configuration and ``modes`` (unusual conditions), and how it ended."""
        return f"{self.run_id} on {self.scenario_id} under {self.config_name}{modes}: {self._ending}."

    @property
    def _ending(self) -> str:
        return ending(self.outcome, self.reason, self.review)


class ConfigurationSummary(Model):
    """The outcomes of one configuration's finished runs; ``invalid`` problems are not failures of the planner."""

    config_id: str
    config_name: str
    outcomes: dict[Outcome, int] = Field(description="finished runs by outcome")


_SHOWN_RULES = 3
"""The number of broken traffic rules that the answer to a single run states (chosen)."""
_TOLD_RULES = ("R_IN1", "R_IN2")
"""The rules on stop signs and red lights, which the answer to a single run states.

A run that reaches its goal past a red light looks like any other. Rules on distance, braking and speed are often broken
slightly, and the answer already has the moments that matter.
"""


class RunPlannerResult(Result):
    """The finished runs, with ``job_id`` while others are still running, and ``batch_id`` once a grid is complete."""

    state: Literal["done", "running", "failed", "cancelled", "interrupted"]
    total: int = Field(description="runs requested")
    finished: int = Field(description="runs finished")
    reused: int = Field(description="runs already stored")
    prediction: Prediction
    traffic: Traffic
    batch_id: str | None = Field(
        None, description="id of the batch; null until its grid is complete, and for a single run"
    )
    job_id: str | None = None
    summary: tuple[ConfigurationSummary, ...] = Field(description="outcomes by configuration")
    runs: tuple[RunLine, ...] = Field(description="at most 20")
    failures: tuple[RunLine, ...] = Field((), description="the first valid runs that did not reach the goal")
    lost: tuple[LostCell, ...] = Field((), description="at most 10: internal errors, not failures of the planner")
    notes: tuple[str, ...] = ()
    next_step: str
    world: str = Field(
        PERFECT_NAME,
        exclude_if=lambda world: world == PERFECT_NAME,
        description="what the planner's sensors miss and distort; absent: nothing",
    )

    def answer(self) -> Answer:
        """Return how one run ended with its key moments, or a grid's goal rates by configuration and first failures."""
        names = {item.config_id: item.config_name for item in self.summary}
        lost = [
            f"{cell.scenario_id} under {names.get(cell.config_id, cell.config_id)} was not run: {cell.error}"
            for cell in self.lost
        ]
        if self.total == 1 and self.runs:
            told = [rule for rule in self.runs[0].broken_rules if rule.rule in _TOLD_RULES]
            broken = broken_in_words(told, _SHOWN_RULES, "analyze_results with detail=rules")
            return Answer(
                self._single(),
                figures=self._moments(),
                listed=self._noted(),
                warnings=[broken] if broken else [],
                next_step=self.next_step,
            )
        before = f", {self.reused} already stored" if self.reused else ""
        name = self.batch_id or (f"{self.job_id} ({self.state})" if self.job_id else "")
        head = f"{f'{name}: ' if name else ''}{self.finished} of {self.total} runs finished{before}{self._modes()}."
        return Answer(
            head,
            figures=[_rate_line(item) for item in self.summary],
            listed=[*self._failed(), *self._noted()],
            warnings=lost,
            next_step=self.next_step,
        )

    def _modes(self) -> str:
        """Return the traffic, prediction and world that differ from the defaults."""
        default = RunPlannerArguments()
        modes = [f"traffic {self.traffic}"] if self.traffic != default.traffic else []
        modes += [f"prediction {self.prediction}"] if self.prediction != default.prediction else []
        modes += [f"world {self.world}"] if self.world != PERFECT_NAME else []
        return f" ({', '.join(modes)})" if modes else ""

    def _noted(self) -> list[str]:
        return [f"Note: {note}" for note in self.notes]

    def _single(self) -> str:
        run = self.runs[0]
        return f"{run.in_words(self._modes())}{' This run was already stored.' if self.reused else ''}"

    def _moments(self) -> list[str]:
        """Return the closest time of a run without a collision, or only the smallest gap if its steps are missing."""
        run, review = self.runs[0], self.runs[0].review
        if run.outcome == "invalid" or (review and review.contact and review.contact.obstacle_id is not None):
            return []
        if review is not None and (review.closest or run.minimum_distance_m is None):
            return [review.nearness_in_words()]
        return [] if run.minimum_distance_m is None else [f"Closest: {run.minimum_distance_m:.2f} m."]

    def _failed(self) -> list[str]:
        others = ("goal_reached", "invalid")
        count = sum(n for item in self.summary for outcome, n in item.outcomes.items() if outcome not in others)
        if not count:
            return []
        more = count - len(self.failures)
        rest = [f"… {more} more: analyze_results with where=['!outcome=goal_reached'], detail=rows"] if more > 0 else []
        lines, shared = without_shared_clauses([run.in_words().removesuffix(".") for run in self.failures])
        same = [f"Same for all of these: {'; '.join(shared)}."] if shared else []
        return [f"{count} failed:", *(f"- {line}." for line in lines), *same, *rest]


def _rate_line(item: ConfigurationSummary) -> str:
    """Return text such as ``frenetix:Default (cfg_…): goal 3 of 4; collision 1; invalid, not counted: 2``.

    If the benchmark refused a motion that reached the goal, the paper's rate follows in brackets.
    """
    counts = dict(item.outcomes)
    invalid, reached = counts.pop("invalid", 0), counts.pop("goal_reached", 0)
    valid, refused = reached + sum(counts.values()), counts.get("goal_refused", 0)
    by_paper = f" ({reached + refused} of {valid} with the refused motions)" if refused else ""
    parts = [
        f"goal {reached} of {valid}{by_paper}",
        *(f"{key.replace('_', ' ')} {count}" for key, count in counts.items()),
    ]
    parts += [f"invalid, not counted: {invalid}"] if invalid else []
    return f"{item.config_name} ({item.config_id}): {'; '.join(parts)}"


class DeclaredWeight(Model):
    """A weight or parameter of a user's planner: its default, its range, and a description of its effect.

    A ``weight`` of the cost acts on every choice between candidates. A ``parameter``, such as a threshold or a gain,
    may act only in some situations.
    """

    meaning: str = Field(min_length=1)
    kind: Literal["weight", "parameter"] = "weight"
    raising: str = Field("", description="effect of a larger value")
    default: float
    lowest: float = 0.0
    highest: float = 1e6

    @model_validator(mode="after")
    def _default_in_range(self) -> "DeclaredWeight":
        if not self.lowest <= self.default <= self.highest:
            raise ValueError(f"default {self.default:g} is outside {self.lowest:g} to {self.highest:g}")
        return self


class DeclaredPreset(Model):
    """A preset: its purpose, and the weights that differ from their defaults."""

    intent: str = ""
    weights: dict[str, float] = Field(default_factory=dict)


class PlannerDeclaration(Model):
    """What a user's planner declares in addition to its code. The preset Default contains the weights' defaults."""

    summary: str = Field(min_length=1, description="one line, for list_planners")
    weights: dict[str, DeclaredWeight] = Field(default_factory=dict)
    presets: dict[str, DeclaredPreset] = Field(default_factory=dict, description="in addition to Default")
    version: str = Field("", exclude_if=lambda text: not text, description="the author's name for it, such as v1.2")
    uses_prediction: bool = Field(
        False,
        description="whether it plans on predictions of others; only then can a collision be attributed to prediction",
    )

    @model_validator(mode="after")
    def _presets_fit(self) -> "PlannerDeclaration":
        wrong = [name for name in self.weights if not WEIGHT_NAME.fullmatch(name)]
        if wrong:
            raise ValueError(f"weight '{wrong[0]}': use only lower-case letters, digits and _, as in time_gap_s")
        if "Default" in self.presets:
            raise ValueError("preset Default consists of the weights' defaults; choose another name")
        for name, preset in self.presets.items():
            for weight, value in preset.weights.items():
                known = self.weights.get(weight)
                if known is None:
                    raise ValueError(
                        f"preset {name} sets {weight}, which is not a weight; valid: {', '.join(self.weights)}"
                    )
                if not known.lowest <= value <= known.highest:
                    raise ValueError(
                        f"preset {name}: {weight}={value:g} is outside {known.lowest:g} to {known.highest:g}"
                    )
        return self


class CommandPlanner(PlannerDeclaration):
    """A planner that is an external program: ``[planners.NAME]`` in the settings file; see docs/own_planner.md."""

    command: tuple[str, ...] = Field(min_length=1, description="program and arguments; paths are absolute")
    protocol: Literal["one_shot", "stepwise"] = Field(
        "one_shot", description="one_shot: called once for the whole run; stepwise: called at every planning step"
    )
    stays: bool = Field(
        False, description="one process for many runs, one request per line; otherwise one process per run"
    )
    time_s: float = Field(60.0, gt=0, le=3600, description="time limit of one run, all its steps together")
    start_time_s: float = Field(10.0, gt=0, le=3600, description="stepwise: time limit until it is ready")
    step_time_s: float = Field(1.0, gt=0, le=3600, description="stepwise: time limit of one step")
    memory_mb: int = Field(2048, ge=16, description="address space of each of its processes")
    folder_mb: int = Field(64, ge=1, description="largest file, and all files together in its working folder")
    output_mb: int = Field(
        16, ge=1, le=256, description="largest answer on standard output; stepwise: log of a run, too"
    )
    environment: dict[str, str] = Field(
        default_factory=dict, description="variables in addition to PATH, HOME, LANG, TMPDIR"
    )

    @field_validator("command")
    @classmethod
    def _absolute(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        program = value[0]
        if not program or ("/" in program and not program.startswith("/")):
            raise ValueError(f"program '{program}': use a name on PATH or an absolute path")
        return value


class EgoStart(Model):
    """The ego's centre at the first step, in m, rad, m/s and m/s²."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float


class CommandRequest(Model):
    """The request that a command-line planner reads from standard input, as one line of JSON.

    ``scenario_file`` is a copy of the CommonRoad XML file. ``folder`` contains it, and the run may write there.
    ``last_step`` ends the goal's time. ``step_s`` is the time step of scenario and trajectory.
    """

    version: Literal[1] = 1
    scenario_id: str
    scenario_file: str
    problem_id: int
    folder: str
    planner: str
    config_id: str
    weights: dict[str, float]
    settings: dict[str, float] = Field(description="all settings, with the ego's size and limits")
    ego: EgoStart
    ego_class: str = Field("car", description="class of the ego: car, truck, bus, motorcycle …")
    first_step: int
    last_step: int
    step_s: float


class CommandTrajectory(Model):
    """States of the ego's centre, one per time step from the present on. All lists have the same length."""

    x_m: tuple[Bounded, ...]
    y_m: tuple[Bounded, ...]
    heading_rad: tuple[Bounded, ...]
    speed_mps: tuple[Bounded, ...]

    @model_validator(mode="after")
    def _same_lengths(self) -> "CommandTrajectory":
        lengths = {name: len(values) for name, values in self}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(f"the lists have different lengths: {found}")
        return self


class CommandAnswer(Model):
    """The answer that a command-line planner writes to standard output, as one line of JSON and nothing else.

    ``trajectory`` is the whole drive in one plan, or null if the planner finds no plan; ``rejected`` then says why.
    """

    version: Literal[1] = 1
    scenario_id: str = Field(description="as in the request")
    problem_id: int = Field(description="as in the request")
    trajectory: CommandTrajectory | None
    costs: dict[PrintedName, BoundedCost] = Field(
        default_factory=dict, max_length=MOST_TERMS, description="weighted cost term: value"
    )
    rejected: dict[PrintedName, Annotated[int, Field(ge=0)]] = Field(
        default_factory=dict, max_length=MOST_TERMS, description="constraint: candidates that it rejected"
    )
    candidates: int = Field(1, ge=0)
