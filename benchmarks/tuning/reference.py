"""Compares the product with Frenetix-Motion-Planner, the public loop around the same core, on scenarios and weights.

The reference runs from a checkout (``--reference``) in its own environment (``--reference-python``, from
``reference_requirements.txt``), in one process that drives one scenario after the other (``reference_driver.py``). The
seed draws the scenarios from the public ones. The weights of our presets replace its own.

Both use the recording as prediction (``ground_truth``), the only one that both loops have, and alternate in driving
first. The reference by default leaves out followers behind the ego under any prediction, and our loop only if it
guesses. The reference therefore drives again with its cone for that set to 0 (``seeing``), and our loop drives again by
two rules of the reference: it leaves followers out, and keeps its speed in a goal without one (``alike``). Ends of runs
fall into the same five classes. :func:`cause_of` classifies a differing pair from the logs: it separates the drive from
its verdict by driving the reference's motion again through our loop.

Keys:

- ``reference_scenarios``: attempted by both (no other counts); ``reference_agree``: share that end in the same class.
- ``reference_trap``, ``reference_prediction``, ``reference_goal_rule``, ``reference_road_check``,
  ``reference_sampling``: number that end differently, by cause; ``reference_from_behind``: those in which another
  vehicle hit the reference's ego from behind.
- ``reference_success``, ``own_success``, ``own_alike_success``: shares that reach the goal.
- ``reference_seeing_agree`` and so on: the same if the reference sees followers; ``reference_alike_agree`` and so on:
  the same if our loop has its two rules.
- ``reference_time_ratio``: processor time, theirs over ours, of all runs together (default settings);
  ``reference_time_ratio_clock``: the same by the clock; ``reference_run_s``, ``own_run_s``: medians of processor time.
"""

import math
import random
import statistics
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.execution import silent
from plannerforge.engine.geometry import Points
from plannerforge.engine.planners import Observation, Plan, PlannedTrajectory, PlanningTask, run_planner, simulate
from plannerforge.engine.planners.driving.desired_speed import ReferenceDesiredSpeed
from plannerforge.engine.planners.frenetix.planner import Frenetix
from plannerforge.engine.planners.prediction import follows
from plannerforge.engine.planners.runs import run_steps
from plannerforge.engine.planners.traffic.recorded import RecordedTraffic
from plannerforge.engine.vehicles import vehicle_of
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import CollisionRecord, Outcome, Prediction, RunSteps

from ..harness import Figures, LeftOut, LineProcess, NoAnswer, SeededBench, Spent, process_pool, scenario_files, share
from ..planners.failure_causes import is_wrap
from ..tracks import ahead_and_left_m
from .optimised import DEFAULT

SCENARIOS = 64
"""Number of drawn public scenarios (chosen)."""
LIMIT_S = 600.0
"""Wall time of one reference run after which it counts as a fault (chosen)."""
Ending = Literal["goal reached", "goal passed", "collision", "infeasible", "time limit", "not attempted"]
"""Ends of a run in both loops' terms. A collision may be with the road's edge, because the reference does not
distinguish them. A goal is passed if the ego was in its place at another time, or went by. ``not attempted``: our loop
finds the problem unsolvable.
"""
OUR_ENDINGS: Mapping[Outcome, Ending] = {
    "goal_reached": "goal reached",
    "goal_refused": "goal reached",
    "goal_early": "goal passed",
    "goal_late": "goal passed",
    "goal_missed": "goal passed",
    "timeout": "time limit",
    "infeasible": "infeasible",
    "off_road": "collision",
    "collision": "collision",
    "invalid": "not attempted",
}
THEIR_ENDINGS: Mapping[str, Ending] = {
    "COMPLETED_SUCCESS": "goal reached",
    "COMPLETED_OUT_OF_TIME": "goal passed",
    "COMPLETED_FASTER": "goal passed",
    "MAX_S_POSITION": "goal passed",
    "TIMELIMIT": "time limit",
    "ERROR": "infeasible",
    "COLLISION": "collision",
}
"""Its states of an agent that has ended, by name."""
Cause = Literal["trap", "prediction", "goal_rule", "road_check", "sampling"]
CAUSES: tuple[Cause, ...] = ("trap", "prediction", "goal_rule", "road_check", "sampling")
_FORESEEN_M = 0.5
"""Largest distance between a predicted and a recorded place that counts as foreseen (chosen: just over a quarter of a
car's width).
"""
_HORIZON_STEPS = 30


@dataclass(frozen=True)
class TuningBench(SeededBench):
    """The input of the parts of ``make bench-tuning``.

    ``reference``: a checkout of Frenetix-Motion-Planner; ``reference_python``: the interpreter of its environment.
    """

    reference: Path | None = None
    reference_python: Path | None = None


@dataclass(frozen=True)
class PlanLog:
    """One plan of the reference.

    ``kind``: ``regular`` (its checks found a free candidate), ``fallback`` (stopping or standing without a free one),
    ``none``. ``rejected``: candidates by constraint. ``predicted``: for the last plans, by obstacle, the positions that
    its check assumed for the plan's following steps.
    """

    step: int
    kind: Literal["regular", "fallback", "none"]
    candidates: int
    feasible: int
    rejected: Mapping[str, int]
    desired_mps: float
    predicted: Mapping[str, Sequence[tuple[float, float]]] = field(default_factory=dict)


@dataclass(frozen=True)
class ReferenceRun:
    """The driver's answer for one run.

    ``fault``: the exception of its loop; empty if it finished. ``met``: for a collision, whether its check found the
    road's edge or a static obstacle (``still``), or a ``moving`` one; otherwise empty.
    """

    fault: str
    status: str
    message: str
    met: str = ""
    plans: tuple[PlanLog, ...] = ()
    steps: RunSteps | None = None
    spent: Spent = field(default_factory=Spent)

    @classmethod
    def of(cls, answer: Mapping[str, Any]) -> "ReferenceRun":
        """Return the run in a line of the driver."""
        steps = None
        if "x_m" in answer:
            names = ("first_step", "x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2")
            steps = RunSteps(**{name: answer[name] for name in names}, plan_steps=(), costs={})
        plans = tuple(PlanLog(**plan) for plan in answer["plans"])
        spent = Spent(answer["wall_s"], answer["processor_s"])
        return cls(answer["fault"], answer["status"], answer["message"], answer["met"], plans, steps, spent)

    @property
    def ending(self) -> Ending:
        """How it ended; a loop that raised found no trajectory."""
        return "infeasible" if self.fault else THEIR_ENDINGS[self.status]

    @property
    def reason(self) -> str:
        """In its words."""
        return self.fault or self.message


@dataclass(frozen=True)
class OwnRun:
    """A run in our loop."""

    outcome: Outcome
    reason: str
    steps: RunSteps
    spent: Spent

    @property
    def ending(self) -> Ending:
        """How it ended."""
        return OUR_ENDINGS[self.outcome]


@dataclass(frozen=True)
class Judged:
    """Our judge's verdict on the states that the reference drove.

    ``ending``: None if the judge would have let the run continue. ``contact``: the collision that it sees.
    ``missed_m``: by the step of a plan, the distance between the obstacle's predicted and recorded position at the
    contact; None if the plan did not predict it, or not for so long. ``from_behind``: the obstacle's centre is behind
    the ego's rear then.
    """

    ending: Ending | None = None
    contact: CollisionRecord | None = None
    from_behind: bool = False
    missed_m: Mapping[int, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Pair:
    """Both loops on one scenario."""

    scenario: Path
    ours: OwnRun
    theirs: ReferenceRun
    judged: Judged = field(default_factory=Judged)

    @property
    def agrees(self) -> bool:
        """True if both end in the same class."""
        return self.ours.ending == self.theirs.ending


def cause_of(pair: Pair) -> tuple[Cause, str]:
    """Return why the two end differently, and the evidence in the logs. The first rule that applies decides:

    1. ``trap``: the reference's loop raises an error, or the last attempt of either is rejected as at a heading wrap.

    2. Our judge gives the reference's motion the same verdict as our own run, or would have let it continue: only the
    rules differ. A contact with the road's edge that only one of the two sees is ``road_check``, one with an obstacle
    is a ``trap`` (both know its recorded position); everything else is ``goal_rule``.

    3. They drove differently, and the failed run (the reference's if both failed) decides. A contact with an obstacle
    is ``prediction`` if the reference took the path to be free, or its last plan of that kind predicted the obstacle
    elsewhere; otherwise, and in our run, which knows the recording, it is ``sampling``. Leaving the road is
    ``road_check``. No trajectory is ``road_check`` if the edge rejected the most, otherwise ``sampling``.

    4. Both drove freely and reached the goal at different times: ``goal_rule``.
    """
    ours, theirs, judged = pair.ours, pair.theirs, pair.judged
    if theirs.fault:
        return "trap", theirs.fault
    last = theirs.plans[-1].rejected if theirs.plans else {}
    for run, rejected in ((theirs, last), (ours, _last_rejected(ours.steps))):
        if run.ending == "infeasible" and is_wrap(rejected):
            return "trap", f"heading wrap: {dict(rejected)}"
    by_rule = judged.ending is None and theirs.ending != "infeasible"
    if by_rule or judged.ending == ours.ending:
        what = f"theirs is {theirs.reason}; of the same drive our judge says {judged.ending or 'nothing yet'}"
        return _rule(pair), what
    failing = judged.ending or theirs.ending
    if failing == "collision":
        return _contact_cause(pair)
    if failing == "infeasible":
        return _infeasible_cause(last)
    if ours.ending == "collision":
        return ("sampling" if ours.outcome == "collision" else "road_check"), f"ours {ours.reason}"
    if ours.ending == "infeasible":
        return _infeasible_cause(_last_rejected(ours.steps))
    return "goal_rule", f"theirs is {theirs.reason}, ours {ours.reason}"


def _rule(pair: Pair) -> Cause:
    """Return which rule differs if both judge the same drive."""
    contact = pair.judged.contact
    if pair.theirs.ending == "collision":
        return "road_check" if pair.theirs.met == "still" else "trap"
    if contact is not None:
        return "road_check" if contact.obstacle_id is None else "trap"
    return "goal_rule"


def _contact_cause(pair: Pair) -> tuple[Cause, str]:
    contact, plans = pair.judged.contact, pair.theirs.plans
    if contact is None or contact.obstacle_id is None:
        return "road_check", f"theirs left the road: {pair.theirs.reason}"
    before = [plan for plan in plans if plan.step < contact.step]
    free = [plan for plan in before if plan.kind == "regular" and contact.step - plan.step <= _HORIZON_STEPS]
    side = " from behind" if pair.judged.from_behind else ""
    who = f"theirs met {contact.kind} {contact.obstacle_id}{side} at step {contact.step}"
    if not free:
        return "sampling", f"{who}, no candidate was free for {_HORIZON_STEPS} steps"
    missed_m = pair.judged.missed_m.get(free[-1].step)
    where = "unforeseen" if missed_m is None else f"foreseen {missed_m:.1f} m off"
    what = f"{who}, {where} from its last free plan at step {free[-1].step}"
    unforeseen = missed_m is None or missed_m > _FORESEEN_M
    return ("prediction" if unforeseen or free[-1] is before[-1] else "sampling"), what


def _infeasible_cause(rejected: Mapping[str, int]) -> tuple[Cause, str]:
    most = max(rejected, key=lambda name: rejected[name], default="nothing")
    return ("road_check" if most == "road_edge" else "sampling"), f"no trajectory: {dict(rejected)}"


def _last_rejected(steps: RunSteps) -> dict[str, int]:
    return {name: counts[-1] for name, counts in steps.rejected.items() if counts}


def measure(bench: TuningBench) -> Figures:
    """Measure the keys above; a limit restricts the number of scenarios.

    Raises:
        LeftOut: no checkout or no interpreter was given.
    """
    with both_loops(bench, "reference") as loops:
        loops.warm_up(bench)
        pairs = [loops.pair(path, theirs_first=bool(at % 2)) for at, path in enumerate(drawn_scenarios(bench))]
        pairs = [pair for pair in pairs if pair.ours.ending != "not attempted"]
        alike = [loops.alike(pair) for pair in pairs]
        seeing = [loops.seeing(pair) for pair in pairs]
    for what, group in (("as it is configured", pairs), ("seeing all", seeing), ("by its rules", alike)):
        sys.stderr.writelines(f"{what}: {line}\n" for line in _differences(group))
    return figures(pairs, seeing, alike)


def _differences(pairs: Iterable[Pair]) -> Iterator[str]:
    for pair in pairs:
        if not pair.agrees:
            cause, why = cause_of(pair)
            yield f"{pair.scenario.stem}: theirs {pair.theirs.ending}, ours {pair.ours.ending}: {cause} ({why})"


def figures(pairs: Sequence[Pair], seeing: Sequence[Pair], alike: Sequence[Pair]) -> dict[str, float | int | str]:
    """Compute the module's keys from pairs that both attempted, from ``seeing`` pairs, and from ``alike`` pairs."""
    theirs = sum((pair.theirs.spent for pair in pairs), Spent())
    ours = sum((pair.ours.spent for pair in pairs), Spent())
    return {
        "reference_scenarios": len(pairs),
        **_agreement("reference", pairs),
        **_agreement("reference_seeing", seeing),
        **_agreement("reference_alike", alike),
        "own_success": share(pair.ours.ending == "goal reached" for pair in pairs),
        "own_alike_success": share(pair.ours.ending == "goal reached" for pair in alike),
        "reference_time_ratio": round(theirs.processor_s / ours.processor_s, 2),
        "reference_time_ratio_clock": round(theirs.wall_s / ours.wall_s, 2),
        "reference_run_s": round(statistics.median(pair.theirs.spent.processor_s for pair in pairs), 3),
        "own_run_s": round(statistics.median(pair.ours.spent.processor_s for pair in pairs), 3),
    }


def _agreement(begin: str, pairs: Sequence[Pair]) -> dict[str, float | int]:
    causes = Counter(cause_of(pair)[0] for pair in pairs if not pair.agrees)
    return {
        f"{begin}_agree": share(pair.agrees for pair in pairs),
        **{f"{begin}_{cause}": causes[cause] for cause in CAUSES},
        f"{begin}_from_behind": sum(pair.judged.from_behind for pair in pairs if not pair.agrees),
        f"{begin}_success": share(pair.theirs.ending == "goal reached" for pair in pairs),
    }


def drawn_scenarios(bench: TuningBench) -> list[Path]:
    """Return public scenarios drawn by the seed; a limit takes the first of the same ones."""
    files = scenario_files(bench.shared / "data" / "commonroad", None)
    return random.Random(bench.seed).sample(files, len(files))[: bench.limit or SCENARIOS]  # noqa: S311 - no secret


@contextmanager
def both_loops(bench: TuningBench, name: str) -> Iterator["Loops"]:
    """Open both loops, each in its own process; the reference's log stays in the scratch folder.

    Raises:
        LeftOut: no checkout or no interpreter was given.
    """
    if bench.reference is None or bench.reference_python is None:
        raise LeftOut("give a checkout of Frenetix-Motion-Planner (--reference) and its Python (--reference-python)")
    driver = Path(__file__).with_name("reference_driver.py")
    command = [str(bench.reference_python), "-P", str(driver), str(bench.reference)]
    with (
        (bench.folder(name) / "reference.log").open("w") as log,
        LineProcess(command, log, LIMIT_S) as reference,
        process_pool(1) as own,
    ):
        yield Loops(reference, own)


@dataclass(frozen=True)
class Loops:
    """Both loops, each in a process of its own that drives one scenario after the other."""

    reference: LineProcess
    own: ProcessPoolExecutor

    def warm_up(self, bench: TuningBench) -> None:
        """Make a run of each that does not count, so that libraries are loaded, if possible on a scenario that is not
        drawn.

        Raises:
            RuntimeError: the reference cannot drive it: its environment is at fault, and every run would fail.
        """
        files = scenario_files(bench.shared / "data" / "commonroad", None)
        first = min(set(files) - set(drawn_scenarios(bench)), default=files[0])
        fault = self.theirs(first, DEFAULT, "ground_truth").fault
        if fault:
            raise RuntimeError(f"the reference does not run in {bench.reference_python}: {fault}")
        self.ours(first, DEFAULT, "ground_truth")

    def pair(self, path: Path, *, theirs_first: bool) -> Pair:
        """Drive Default with a known future in both; if they end differently, judge the reference's motion here."""
        theirs = self.theirs(path, DEFAULT, "ground_truth") if theirs_first else None
        ours = self.ours(path, DEFAULT, "ground_truth")
        pair = Pair(path, ours, theirs or self.theirs(path, DEFAULT, "ground_truth"))
        ends = [f"{run.ending} in {run.spent.processor_s:.2f} s" for run in (pair.theirs, ours)]
        sys.stderr.write(f"{path.stem}: theirs {ends[0]}, ours {ends[1]}\n")
        return self._judged(pair)

    def seeing(self, pair: Pair) -> Pair:
        """Return the pair with a reference that also sees followers behind the ego."""
        theirs = self.theirs(pair.scenario, DEFAULT, "ground_truth", sees_behind=True)
        return self._judged(Pair(pair.scenario, pair.ours, theirs))

    def alike(self, pair: Pair) -> Pair:
        """Return the pair with the reference's two rules in our loop."""
        ours = self.own.submit(drive_alike_here, pair.scenario).result()
        return self._judged(replace(pair, ours=ours, judged=Judged()))

    def _judged(self, pair: Pair) -> Pair:
        if pair.agrees or pair.ours.ending == "not attempted":
            return pair
        return replace(pair, judged=self.own.submit(judge_here, pair.scenario, pair.theirs).result())

    def theirs(
        self, path: Path, config: str, prediction: Literal["ground_truth", "walenet"], *, sees_behind: bool = False
    ) -> ReferenceRun:
        """Return a run of the reference; a timeout or the end of its process is a fault.

        By default it does not see followers in a cone behind the ego.
        """
        asked = {
            "scenario": str(path.resolve()),
            "weights": dict(built_in(config).weights),
            "prediction": prediction,
            "sees_behind": sees_behind,
        }
        try:
            return ReferenceRun.of(self.reference.answer(asked))
        except NoAnswer as reason:
            return ReferenceRun(str(reason), "", "")

    def ours(self, path: Path, config: str, prediction: Prediction) -> OwnRun:
        """Return a run of our loop."""
        return self.own.submit(drive_here, path, config, prediction).result()


def drive_here(path: Path, config: str, prediction: Prediction) -> OwnRun:
    """Return a run of our loop from the file on, with its time."""
    request = RunRequest(
        run_id="run_beside",
        scenario_path=str(path),
        scenario_id=path.stem,
        configuration=built_in(config),
        prediction=prediction,
    )
    began = Spent.now()
    response = run_planner(request, silent)
    return OwnRun(response.record.outcome, response.record.reason, response.steps, Spent.now() - began)


def drive_alike_here(path: Path) -> OwnRun:
    """Return a run of our loop by the reference's two rules, the future known."""
    began, loaded = Spent.now(), read_scenario(path)
    planner, configuration = AsTheReference(), built_in(DEFAULT)
    driven = simulate(loaded.scenario, loaded.problem(None), configuration, planner, "ground_truth", silent)
    return OwnRun(driven.final.outcome, driven.final.reason, run_steps(driven), Spent.now() - began)


class AsTheReference(Frenetix):
    """Our planner with the known differences of the reference's default configuration.

    It also leaves followers behind the ego out of a known future, and uses the reference's desired speed.
    """

    def __init__(self) -> None:
        super().__init__(desired_speed=ReferenceDesiredSpeed.of)

    def plan(self, observation: Observation) -> Plan:
        """Return the plan of Frenetix without the followers."""
        seen = [one for one in observation.obstacles if not follows(one.positions[0], observation.ego)]
        return super().plan(replace(observation, obstacles=tuple(seen)))


def judge_here(path: Path, theirs: ReferenceRun) -> Judged:
    """Return our judge's verdict on the reference's motion, and its predictions of the other party."""
    if theirs.steps is None or len(theirs.steps.x_m) < 2:
        return Judged()
    loaded = read_scenario(path)
    configuration, replay = built_in(DEFAULT), _Replay(theirs.steps)
    driven = simulate(loaded.scenario, loaded.problem(None), configuration, replay, "ground_truth", silent)
    verdict = driven.final
    contact = verdict.collision
    ending = None if verdict.outcome == "infeasible" else OUR_ENDINGS[verdict.outcome]
    if contact is None or contact.obstacle_id is None:
        return Judged(ending, contact)
    traffic, last = RecordedTraffic.of(loaded), driven.states[-1]
    track = next(one for one in (*traffic.moving, *traffic.standing) if one.obstacle_id == contact.obstacle_id)
    place = track.positions[track.index_at(contact.step) or 0]
    ahead_m, _ = ahead_and_left_m(place, last.position, last.heading_rad)
    behind = ahead_m < -vehicle_of(configuration.settings).length_m / 2
    return Judged(ending, contact, behind, _missed_m(place, contact, theirs.plans))


class _Replay:
    """A planner that drives the states of a log, and finds no trajectory after its end."""

    def __init__(self, log: RunSteps) -> None:
        self._first = log.first_step
        self._positions = np.column_stack([log.x_m, log.y_m])
        self._values = [np.array(values) for values in (log.heading_rad, log.speed_mps, log.acceleration_mps2)]

    def reset(self, task: PlanningTask) -> None:
        """Do nothing."""

    def plan(self, observation: Observation) -> Plan:
        """Return the rest of the log."""
        begin = observation.ego.step - self._first
        if begin + 1 >= len(self._positions):
            return Plan(None, rejected={"log_over": 1})
        return Plan(PlannedTrajectory(self._positions[begin:], *(values[begin:] for values in self._values)))


def _missed_m(place: Points, contact: CollisionRecord, plans: Iterable[PlanLog]) -> dict[int, float | None]:
    """Return by plan the distance between the obstacle's predicted and recorded position at a contact."""
    missed: dict[int, float | None] = {}
    for plan in plans:
        if plan.step < contact.step:
            ahead = contact.step - plan.step - 1  # its check takes the first predicted place for that of the next step
            places = plan.predicted.get(str(contact.obstacle_id), ())
            missed[plan.step] = math.dist(places[ahead], tuple(place)) if ahead < len(places) else None
    return missed
