"""The runs that an analysis looks at, with all that is known about them; step files are read when first asked for."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ...schemas.errors import ResourceFailure
from ...schemas.results import ConfigWeights, RunSource, ScenarioSource
from ...schemas.runs import RunRecord, RunSteps
from ..commonroad import Track


@dataclass(frozen=True)
class RunSet:
    """A set of runs with their steps, their configurations and their scenarios' traffic."""

    sources: tuple[RunSource, ...]
    configs: tuple[ConfigWeights, ...] = ()
    scenarios: tuple[ScenarioSource, ...] = ()

    @property
    def records(self) -> tuple[RunRecord, ...]:
        """All records, in the given order."""
        return tuple(source.record for source in self.sources)

    @property
    def valid(self) -> tuple[RunRecord, ...]:
        """Runs that could be attempted: the denominator of every rate."""
        return tuple(record for record in self.records if record.outcome != "invalid")

    @property
    def failures(self) -> tuple[RunRecord, ...]:
        """Valid runs that did not reach the goal."""
        return tuple(record for record in self.valid if record.outcome != "goal_reached")

    @property
    def successes(self) -> tuple[RunRecord, ...]:
        """Runs that reached the goal."""
        return tuple(record for record in self.valid if record.outcome == "goal_reached")

    @cached_property
    def steps(self) -> dict[str, RunSteps]:
        """Steps by run id; runs without steps are not in it."""
        read = ((source.record.run_id, read_steps(source)) for source in self.sources)
        return {run_id: steps for run_id, steps in read if steps is not None}

    @cached_property
    def obstacles(self) -> dict[str, dict[str, int]]:
        """Numbers of obstacles by type, by scenario id; only where they are known."""
        known = ((source.scenario_id, source.obstacles) for source in self.scenarios)
        return {scenario_id: obstacles for scenario_id, obstacles in known if obstacles is not None}

    def obstacle_count(self, record: RunRecord) -> int | None:
        """The number of obstacles in the scenario of a run; None where it is not known."""
        by_type = self.obstacles.get(record.scenario_id)
        return None if by_type is None else sum(by_type.values())

    def weights(self, config_id: str) -> dict[str, float]:
        """The weights of a configuration by name; empty where it is unknown."""
        return next((config.weights for config in self.configs if config.config_id == config_id), {})

    def by_config(self, records: Iterable[RunRecord]) -> dict[str, list[RunRecord]]:
        """The records by configuration id, in order of appearance."""
        groups: dict[str, list[RunRecord]] = {}
        for record in records:
            groups.setdefault(record.config_id, []).append(record)
        return groups


def read_steps(source: RunSource) -> RunSteps | None:
    """The steps of a run; None where none were kept.

    Raises:
        ResourceFailure: the file is named but cannot be read.
    """
    if source.steps_path is None:
        return None
    try:
        return RunSteps.model_validate_json(Path(source.steps_path).read_bytes())
    except OSError as error:
        raise ResourceFailure(f"The steps of {source.record.run_id} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ResourceFailure(f"The steps of {source.record.run_id} are damaged", next_step="run it again") from error


def driven_tracks(steps: RunSteps) -> dict[int, Track]:
    """How the obstacles of reactive traffic moved, by id; empty where all followed their recordings."""
    return {
        other.obstacle_id: Track(
            obstacle_id=other.obstacle_id,
            kind=other.kind,
            length_m=other.length_m,
            width_m=other.width_m,
            first_step=other.first_step,
            positions=np.column_stack([other.x_m, other.y_m]),
            headings_rad=np.asarray(other.heading_rad, dtype=float),
            speeds_mps=np.asarray(other.speed_mps, dtype=float),
        )
        for other in steps.others
    }


def country_of(scenario_id: str) -> str:
    """The country code of a CommonRoad benchmark id (``C-`` marks cooperative scenarios)."""
    return scenario_id.removeprefix("C-")[:3]


def place_of(scenario_id: str) -> str:
    """The place of a CommonRoad benchmark id: ``Antwerp`` of ``BEL_Antwerp-1_9_T-1``."""
    return scenario_id.removeprefix("C-").partition("_")[2].partition("-")[0]
