"""The results of ``make bench-generation``: verdicts on single scenarios, and their table."""

import statistics
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from plannerforge.evals.ground_truth.generation import BenchRequest, Refusal
from plannerforge.evals.results.rates import rate_text
from plannerforge.evals.scoring.made_files import DensityVerdict

from ..harness import Spent, print_figures, share
from .motion import MotionFigures

_VERDICTS = ("executable", "road_type", "vehicles", "place")
DEFECT = "defect: "
"""Prefix of a fault for an exception other than a refusal."""
READING = "reading the map"
"""The message with which a generation reports that stage."""
PAPER_COLLISIONS, FACTORY_COLLISIONS = 0.200, 0.061
"""The paper's shares of collisions for its own scenarios and for those of Scenario Factory 2.0."""


@dataclass
class Stages:
    """Time by stage, from the messages of a generation's progress, which name the stages.

    ``first_read``: this process has not used the map before, so reading it does not count.
    """

    first_read: bool = False
    spent: dict[str, Spent] = field(default_factory=dict)
    _began: Spent = field(default_factory=Spent.now)
    _stage: str = ""

    def __call__(self, share: float, message: str = "") -> None:
        """Start a new stage."""
        del share
        now = Spent.now()
        if self._stage:
            self.spent[self._stage] = self.spent.get(self._stage, Spent()) + (now - self._began)
        self._began, self._stage = now, message

    @property
    def counted(self) -> Spent:
        """All stages, the first reading of the map left out."""
        left_out = (READING,) if self.first_read else ()
        return sum((spent for stage, spent in self.spent.items() if stage not in left_out), Spent())


@dataclass(frozen=True)
class Made:
    """A requested scenario and its verdicts; ``fault`` if it was not generated.

    ``road_type`` is None if nothing independent of the generator determines it; ``notes`` are those of the answer.
    """

    request: BenchRequest
    fault: str = ""
    executable: bool = False
    outcome: str = ""
    road_type: bool | None = False
    vehicles: bool = False
    place: bool = False
    density: DensityVerdict | None = None
    motion: MotionFigures | None = None
    stages: Stages | None = None
    notes: tuple[str, ...] = ()


def print_generation(
    converted: Mapping[str, str], requests: int, made: Sequence[Made], refusals: Sequence[tuple[Refusal, str]]
) -> None:
    """Print every fault, the table and the figures; ``converted`` and ``refusals`` hold faults in words, or empty."""
    whole = [one for one in made if not one.fault]
    densities = [one.density for one in whole if one.density is not None]
    faults = {f"map {name}": fault for name, fault in converted.items()}
    faults |= {f"to be refused {refusal.name} ({refusal.reason})": fault for refusal, fault in refusals}
    sys.stderr.writelines(f"{what}: {fault}\n" for what, fault in faults.items() if fault)
    outcomes = Counter(one.outcome for one in whole)
    figures: dict[str, float | int | str] = {
        "maps": len(converted),
        "maps_converted": sum(not fault for fault in converted.values()),
        "requests": requests,
        **{key: share(getattr(one, key) for one in made) for key in _VERDICTS},
        "density": ratio(sum(verdict.honest for verdict in densities), len(made)),
        "refused_right": share(not fault for _, fault in refusals),
        **motion_figures(one.motion for one in whole),
    }
    for density in ("low", "high"):
        counted = [stages.counted for stages in _timed(whole, density)]
        figures[f"median_{density}_s"] = _median([spent.processor_s for spent in counted])
        figures[f"median_{density}_wall_s"] = _median([spent.wall_s for spent in counted])
    collisions = rate_text(outcomes["collision"], len(whole))
    rows = [
        ("scenarios", str(len(made))),
        ("tracks checked", str(sum(one.motion.checked for one in whole if one.motion is not None))),
        ("density within 25 % of its target", f"{sum(verdict.met for verdict in densities)} of {len(made)}"),
        *((f"refused: {reason}", counts) for reason, counts in _by_reason(refusals)),
        *((f"outcome {name}", str(count)) for name, count in outcomes.most_common()),
        (
            "the default planner collides",
            f"{collisions}; paper {PAPER_COLLISIONS:.1%}, SF 2.0 {FACTORY_COLLISIONS:.1%}",
        ),
    ]
    for density in ("low", "high"):
        rows += [
            (f"{density}: {stage}", f"{spent.processor_s:.3f} s, on the clock {spent.wall_s:.3f} s")
            for stage, spent in _stages(whole, density)
        ]
    print_figures("Generation", figures, more_rows=rows)


def motion_figures(found: Iterable[MotionFigures | None]) -> dict[str, float]:
    """Summarise the traffic of scenarios: shares of feasible tracks and of positions on lanelets, overlapping pairs."""
    motions = [motion for motion in found if motion is not None]
    return {
        "feasible": ratio(sum(motion.feasible for motion in motions), sum(motion.checked for motion in motions)),
        "inside_lanelets": ratio(sum(motion.inside for motion in motions), sum(motion.positions for motion in motions)),
        "overlaps": sum(motion.overlapping_pairs for motion in motions),
    }


def print_verdict(one: Made) -> None:
    """Print a line on a scenario as soon as it is judged, because a whole run takes long and may be broken off."""
    wrong = [f"not {key}" for key in _VERDICTS if getattr(one, key) is False]
    if one.density is not None and not one.density.met:
        stated = "told" if one.density.stated else "not told"
        wrong.append(f"{one.density.found:g} vehicles per lane-km instead of {one.density.target:g}, {stated}")
    motion = one.motion
    if motion is not None:
        wrong += [f"{name} cannot be driven" for name in motion.infeasible_names]
        wrong += ["overlaps"] if motion.overlapping_pairs else []
    arguments = one.request.arguments
    what = f"{one.request.name} {one.request.map_name} {arguments.scenario_type} {arguments.density}"
    sys.stderr.write(f"{what}: {one.fault or ', '.join([one.outcome, *wrong])}\n")
    sys.stderr.flush()


def _by_reason(refusals: Sequence[tuple[Refusal, str]]) -> list[tuple[str, str]]:
    """Count the refused requests for each reason of the ones that must be refused."""
    asked = Counter(refusal.reason for refusal, _ in refusals)
    right = Counter(refusal.reason for refusal, fault in refusals if not fault)
    return [(reason, f"{right[reason]} of {count}") for reason, count in sorted(asked.items())]


def ratio(part: int, whole: int) -> float:
    """Return a share, rounded to four digits; 0 if the total is 0."""
    return round(part / whole, 4) if whole else 0.0


def _timed(made: Sequence[Made], density: str) -> list[Stages]:
    fitting = (one for one in made if one.request.arguments.density == density)
    return [one.stages for one in fitting if one.stages is not None and one.request.arguments.duration_s == 20]


def _median(times_s: Sequence[float]) -> float:
    return round(statistics.median(times_s), 3) if times_s else 0.0


def _stages(made: Sequence[Made], density: str) -> list[tuple[str, Spent]]:
    """Return the mean of every stage in order of first occurrence, without first readings of a map."""
    timed = _timed(made, density)
    names = dict.fromkeys(name for stages in timed for name in stages.spent)
    sums = {
        name: sum((s.spent.get(name, Spent()) for s in timed if name != READING or not s.first_read), Spent())
        for name in names
    }
    return [(name, Spent(one.wall_s / len(timed), one.processor_s / len(timed))) for name, one in sums.items()]
