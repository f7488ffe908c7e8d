"""A run's driven path, ready to be drawn over its scenario."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from plannerforge.engine.analysis.run_steps import driven_tracks, read_steps
from plannerforge.engine.geometry.polyline import Points, Values
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.results import RunSource
from plannerforge.schemas.runs import RunRecord


@dataclass(frozen=True)
class DrivenPath:
    """Centre of the ego (n, 2), headings, speeds (n,), from ``first_step`` on.

    ``name``: what the picture calls the run; ``series``: number of its colour and dash pattern, the same for one
    configuration in all pictures of a request. ``others``: how the obstacles moved that reacted to the ego, by id.
    """

    record: RunRecord
    first_step: int
    positions: Points
    headings_rad: Values
    speeds_mps: Values
    name: str
    series: int = 0
    others: dict[int, Track] = field(default_factory=dict)

    @property
    def last_step(self) -> int:
        """The last step that was driven."""
        return self.first_step + len(self.positions) - 1

    def index_at(self, step: int) -> int:
        """Index for a time step, clamped to what was driven: the ego stays where its run ended."""
        return int(np.clip(step - self.first_step, 0, len(self.positions) - 1))

    @property
    def label(self) -> str:
        """Configuration and outcome, as in a legend."""
        return f"{self.name}: {self.record.outcome.replace('_', ' ')}"


def driven_path(source: RunSource, name: str = "", series: int = 0) -> DrivenPath | None:
    """The path of a run, by default with its configuration's name; None where it has no steps."""
    steps = read_steps(source)
    if steps is None or not steps.x_m:
        return None
    return DrivenPath(
        record=source.record,
        first_step=steps.first_step,
        positions=np.column_stack([steps.x_m, steps.y_m]),
        headings_rad=np.asarray(steps.heading_rad, dtype=float),
        speeds_mps=np.asarray(steps.speed_mps, dtype=float),
        name=name or source.record.config_name,
        series=series,
        others=driven_tracks(steps),
    )


def short_names(runs: Sequence[RunSource]) -> dict[str, str]:
    """Names of configurations by id, without the planner where all runs are of one."""
    one_planner = len({run.record.planner for run in runs}) == 1
    return {
        run.record.config_id: run.record.config_name.removeprefix(f"{run.record.planner}:" if one_planner else "")
        for run in runs
    }
