"""The runs of an analysis, with everything known about them: metrics, steps and cost terms.

Step files are read on first use. ``METRICS`` lists the metrics of a run with their units and directions.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from ...schemas.errors import ResourceFailure
from ...schemas.measures import MEASURES, Basis
from ...schemas.planning import PlannerSettings
from ...schemas.results import ConfigWeights, CostShare, MetricName, Rate
from ...schemas.reviews import Contact, RunLook
from ...schemas.runs import Lineage, RunRecord, RunSeries, RunSource, RunSteps, ScenarioSource
from ...schemas.text import shown_name
from ..commonroad import Track, kept_recording, static_tracks
from ..vehicles import VehicleParameters, vehicle_classes, vehicle_of
from .statistics import rate_by_scenario

_Name = TypeVar("_Name", bound=str)


def reached_goal(record: RunRecord) -> bool:
    """Return True if a run reached its goal."""
    return record.outcome == "goal_reached"


def hit_another(record: RunRecord) -> bool:
    """Return True if a run ended in a collision with another road user; leaving the road does not count."""
    return record.collision is not None and record.collision.obstacle_id is not None


@dataclass(frozen=True)
class RunSet:
    """A set of runs with their steps and configurations, and the traffic of their scenarios."""

    sources: tuple[RunSource, ...]
    configs: tuple[ConfigWeights, ...] = ()
    scenarios: tuple[ScenarioSource, ...] = ()
    lineage: tuple[Lineage, ...] = ()

    @property
    def records(self) -> tuple[RunRecord, ...]:
        """All records, in the given order."""
        return tuple(source.record for source in self.sources)

    @property
    def valid(self) -> tuple[RunRecord, ...]:
        """The runs that could be attempted: the denominator of every rate."""
        return tuple(record for record in self.records if record.outcome != "invalid")

    @property
    def failures(self) -> tuple[RunRecord, ...]:
        """The valid runs that did not reach the goal."""
        return tuple(record for record in self.valid if record.outcome != "goal_reached")

    @property
    def successes(self) -> tuple[RunRecord, ...]:
        """The runs that reached the goal."""
        return tuple(record for record in self.valid if record.outcome == "goal_reached")

    @cached_property
    def steps(self) -> dict[str, RunSteps]:
        """The steps by run id; runs that have no steps are left out."""
        read = ((source.record.run_id, read_steps(source)) for source in self.sources)
        return {run_id: steps for run_id, steps in read if steps is not None}

    @cached_property
    def _looks(self) -> dict[str, RunLook]:
        return {source.record.run_id: source.look for source in self.sources if source.look is not None}

    @cached_property
    def contacts(self) -> dict[str, Contact | None]:
        """The contacts computed so far, by run id: each collision is examined once."""
        return {}

    def look(self, record: RunRecord) -> RunLook | None:
        """Return the stored review of a run, or None."""
        return self._looks.get(record.run_id)

    @cached_property
    def obstacles(self) -> dict[str, dict[str, int]]:
        """The number of obstacles of each type, by scenario id; scenarios for which it is unknown are left out."""
        known = ((source.scenario_id, source.obstacles) for source in self.scenarios)
        return {scenario_id: obstacles for scenario_id, obstacles in known if obstacles is not None}

    @cached_property
    def _roots(self) -> dict[str, str]:
        return {lineage.scenario_id: lineage.root for lineage in self.lineage}

    def root(self, record: RunRecord) -> str:
        """Return the scenario under which a run is counted: its own, or the one that it was edited from."""
        return self._roots.get(record.scenario_id, record.scenario_id)

    def rate(self, of: Iterable[RunRecord], counted: Callable[[RunRecord], bool] = reached_goal) -> Rate:
        """Return the share of counted runs, by default those that reached the goal; the scenario is the unit."""
        return rate_by_scenario((self.root(record), counted(record)) for record in of)

    def with_sources(self, sources: tuple[RunSource, ...]) -> "RunSet":
        """Return a set of other runs that shares the configurations and scenarios."""
        return replace(self, sources=sources)

    @cached_property
    def _known(self) -> dict[str, ScenarioSource]:
        return {source.scenario_id: source for source in self.scenarios}

    def scenario(self, record: RunRecord) -> ScenarioSource | None:
        """Return what is known about the scenario of a run, or None."""
        return self._known.get(record.scenario_id)

    def scenario_path(self, record: RunRecord) -> Path | None:
        """Return the file of a run's scenario, or None if it is unknown."""
        known = self.scenario(record)
        return None if known is None else Path(known.path)

    def obstacle_count(self, record: RunRecord) -> int | None:
        """Return the number of obstacles in the scenario of a run, or None if it is unknown."""
        by_type = self.obstacles.get(record.scenario_id)
        return None if by_type is None else sum(by_type.values())

    def weights(self, config_id: str) -> dict[str, float]:
        """Return the weights of a configuration by name; empty if it is unknown."""
        return next((config.weights for config in self.configs if config.config_id == config_id), {})

    def cost_weights(self, config_id: str) -> dict[str, float]:
        """Return the weights of a configuration that are factors on cost terms, by name."""
        parameters = {name for config in self.configs if config.config_id == config_id for name in config.parameters}
        return {name: value for name, value in self.weights(config_id).items() if name not in parameters}

    def cost_terms(self, config_id: str) -> dict[str, str]:
        """Return the recorded cost term of each of a configuration's weights that scales a term."""
        terms = next((config.terms for config in self.configs if config.config_id == config_id), {})
        return {name: terms.get(name, name) for name in self.cost_weights(config_id)}

    def vehicle(self, record: RunRecord) -> VehicleParameters:
        """Return the parameters of the ego's vehicle; CommonRoad's vehicle 2 if its configuration is unknown."""
        settings = next((config.settings for config in self.configs if config.config_id == record.config_id), {})
        vehicle = vehicle_of(PlannerSettings.model_validate(settings), record.ego_class)
        sized = replace(vehicle, length_m=record.ego_length_m, width_m=record.ego_width_m)
        return sized.on_road(record.friction)

    @cached_property
    def is_of_one_configuration(self) -> bool:
        """Whether all runs have one configuration, so that a rate over them does not pool several."""
        return len({record.config_id for record in self.records}) < 2

    @cached_property
    def by_configuration(self) -> "dict[str, RunSet]":
        """The runs of each configuration as a separate set; the sets share what was read and examined."""
        apart: dict[str, RunSet] = {}
        for config_id, records in self.by_config(self.records).items():
            chosen = {record.run_id for record in records}
            own = self.with_sources(tuple(source for source in self.sources if source.record.run_id in chosen))
            steps = {run_id: steps for run_id, steps in self.steps.items() if run_id in chosen}
            vars(own).update(steps=steps, contacts=self.contacts)
            apart[config_id] = own
        return apart

    def by_config(self, records: Iterable[RunRecord]) -> dict[str, list[RunRecord]]:
        """Return the records by configuration id, in order of appearance."""
        groups: dict[str, list[RunRecord]] = {}
        for record in records:
            groups.setdefault(record.config_id, []).append(record)
        return groups


def read_steps(source: RunSource) -> RunSteps | None:
    """Return the steps of a run, or None if they were not kept.

    Raises:
        ResourceFailure: the file cannot be read or is damaged.
    """
    if source.steps_path is None:
        return None
    try:
        return _with_shown_names(RunSteps.model_validate_json(Path(source.steps_path).read_bytes()))
    except OSError as error:
        raise ResourceFailure(f"The steps of {source.record.run_id} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ResourceFailure(f"The steps of {source.record.run_id} are damaged", next_step="run it again") from error


def read_series(source: RunSource) -> RunSeries | None:
    """Return a run's series, stored next to its steps, or None if the run was stored without series.

    Raises:
        ResourceFailure: the file exists but cannot be read.
    """
    path = None if source.steps_path is None else Path(source.steps_path).with_name("series.json")
    if path is None or not path.is_file():
        return None
    try:
        return RunSeries.model_validate_json(path.read_bytes())
    except OSError as error:
        raise ResourceFailure(f"The series of {source.record.run_id} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ResourceFailure(f"The series of {source.record.run_id} are damaged", next_step="run it again") from error


def _with_shown_names(steps: RunSteps) -> RunSteps:
    """Return the steps with a planner's terms and constraints renamed to the names that answers show."""
    words = {name: shown_name(name) for name in (*steps.costs, *steps.rejected)}
    if all(shown == name for name, shown in words.items()):
        return steps
    return steps.model_copy(
        update={
            "costs": {words[name]: values for name, values in steps.costs.items()},
            "rejected": {words[name]: values for name, values in steps.rejected.items()},
        }
    )


def driven_tracks(steps: RunSteps) -> dict[int, Track]:
    """Return the tracks of the obstacles of reactive traffic by id; empty if all followed their recordings."""
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


def tracks_in(runs: RunSet, record: RunRecord, steps: RunSteps) -> dict[int, Track]:
    """Return the tracks of a run's other road users by id, static ones too; without a file, only reactive traffic."""
    path = runs.scenario_path(record)
    if path is None:
        return driven_tracks(steps)
    recording = kept_recording(path)
    standing = static_tracks(recording.loaded.scenario, steps.first_step + len(steps.x_m))
    return standing | recording.tracks | driven_tracks(steps)


def ego_track(record: RunRecord, steps: RunSteps) -> Track:
    """Return the driven states as a track with the ego's size; its id belongs to no obstacle."""
    return Track(
        obstacle_id=-1,
        kind=vehicle_classes()[record.ego_class].commonroad_type,
        length_m=record.ego_length_m,
        width_m=record.ego_width_m,
        first_step=steps.first_step,
        positions=np.column_stack([steps.x_m, steps.y_m]),
        headings_rad=np.asarray(steps.heading_rad, dtype=float),
        speeds_mps=np.asarray(steps.speed_mps, dtype=float),
    )


def most_frequent_first(counts: Counter[_Name]) -> list[tuple[_Name, int]]:
    """Return names with their counts, largest count first; equal counts are ordered by name."""
    return sorted(counts.items(), key=lambda item: (-item[1], item[0]))


_NOISE = 1e-9
"""Relative difference up to which two values are equal: rounding, far below any measurement."""


@dataclass(frozen=True)
class MetricSpec:
    """A metric of a run, stored as in ``schemas/measures.py``; ``why_none``: why a run may lack the metric."""

    name: MetricName
    unit: str
    better: Literal["lower", "higher"] | None
    basis: Basis
    within_one_configuration: bool = False
    tolerance: float = 0.0
    why_none: str = ""

    def difference(self, before: float, after: float) -> float:
        """Return after − before; 0 if the difference is within the tolerance or rounding."""
        least = max(self.tolerance, _NOISE * max(abs(before), abs(after)))
        return 0.0 if abs(after - before) <= least else after - before

    def value(self, record: RunRecord) -> float | None:
        """Return the value of the metric in a run, or None if it is not defined."""
        if self.name == "risk_score" and record.outcome == "off_road":
            return None  # older runs have the score of the nearby road users
        value: float | None = getattr(record.metrics, self.name, None)
        return value


METRICS: tuple[MetricSpec, ...] = tuple(
    MetricSpec(one.name, one.unit, one.better, one.basis, one.within_one_configuration, one.tolerance, one.none)
    for one in MEASURES
    if one.stored
)
"""The stored measures in display order: one for each field of ``RunMetrics``."""


def cost_shares(runs: RunSet) -> tuple[CostShare, ...]:
    """Return each cost term's share by configuration, largest share first; terms that are always 0 are left out."""
    shares: list[CostShare] = []
    for config_id, records in runs.by_config(runs.valid).items():
        terms = config_terms(runs, records)
        shares += [
            CostShare(
                config_id=config_id,
                config_name=records[0].config_name,
                term=term,
                mean_weighted=mean,
                share=share_of(terms, [term]),
                runs=sum(record.run_id in runs.steps for record in records),
            )
            for term, mean in sorted(terms.items(), key=lambda item: (-item[1], item[0]))
            if mean != 0
        ]
    return tuple(shares)


def config_terms(runs: RunSet, records: Sequence[RunRecord]) -> dict[str, float]:
    """Return the mean over the runs of each term's mean; every run counts the same, regardless of its length."""
    means = [mean_terms(runs.steps[record.run_id]) for record in records if record.run_id in runs.steps]
    terms = sorted({term for mean in means for term in mean})
    return {term: float(np.mean([mean.get(term, 0.0) for mean in means])) for term in terms}


def mean_terms(steps: RunSteps, since_step: int | None = None) -> dict[str, float]:
    """Return each term's mean weighted cost over planning steps from ``since_step`` on; empty if there are none."""
    chosen = [i for i, step in enumerate(steps.plan_steps) if since_step is None or step >= since_step]
    return {
        term: float(np.mean([values[i] for i in chosen if i < len(values)]))
        for term, values in sorted(steps.costs.items())
        if any(i < len(values) for i in chosen)
    }


def share_of(terms: dict[str, float], wanted: Sequence[str]) -> float | None:
    """Return the share of the wanted terms in the total cost, or None if the total is 0."""
    total = sum(terms.values())
    return sum(terms.get(term, 0.0) for term in wanted) / total if total > 0 else None
