"""What is known about a scenario: its metadata layers, and what ``describe_scenario`` takes and answers."""

from pathlib import Path

from pydantic import Field

from plannerforge.schemas.base import Model
from plannerforge.schemas.vocabulary import GoalForm


class LocationFacts(Model):
    """Where the scenario is: country and place of the benchmark id; coordinates where the file states real ones."""

    country: str = Field(description="ISO 3166-1 alpha-3, ZAM for artificial networks")
    place: str
    latitude_deg: float | None = None
    longitude_deg: float | None = None


class RoadFacts(Model):
    """Signs, lights and posted limits: on the lanelets under the ego's start, and anywhere in the file.

    Signs are keys of the vocabulary, sorted; limits in km/h, ascending.
    """

    lanelets: int
    signs_ego: tuple[str, ...] = ()
    signs_map: tuple[str, ...] = ()
    traffic_light_ego: bool = False
    traffic_lights_map: int = 0
    limits_ego_kmh: tuple[float, ...] = ()
    limits_map_kmh: tuple[float, ...] = ()


class ParticipantFacts(Model):
    """Counts by CommonRoad obstacle type; environment and phantom obstacles are not counted."""

    dynamic: dict[str, int] = {}
    static: dict[str, int] = {}

    @property
    def counts(self) -> dict[str, int]:
        """Static and dynamic together, by type in alphabetical order."""
        kinds = sorted({*self.dynamic, *self.static})
        return {kind: self.dynamic.get(kind, 0) + self.static.get(kind, 0) for kind in kinds}

    @property
    def total(self) -> int:
        """All obstacles."""
        return sum(self.dynamic.values()) + sum(self.static.values())


class EgoFacts(Model):
    """One planning problem: where the ego starts and what its goal states.

    ``lanes``: lanelets side by side in the ego's direction at its start, 0 where it stands on none;
    ``route``: lanelets to the goal, empty where the goal has no place or cannot be reached.
    """

    problem_id: int
    speed_mps: float
    x_m: float
    y_m: float
    heading_rad: float
    lanes: int
    lanelets: tuple[int, ...]
    goal_forms: tuple[GoalForm, ...]
    goal_first_step: int | None
    goal_last_step: int | None
    route: tuple[int, ...] = ()


class ScenarioFacts(Model):
    """The four metadata layers of the paper (location, roadside, participants, ego) and the computed features.

    Counts, signs and lanes on the ego's lanelets belong to the first planning problem.
    """

    scenario_id: str
    format_version: str
    step_s: float
    horizon_steps: int = Field(description="last time step of any recording or goal")
    location: LocationFacts
    tags: tuple[str, ...] = Field(description="tags in the file, sorted; computed features stay apart")
    features: tuple[str, ...] = Field(description="computed from the geometry, sorted")
    roads: RoadFacts
    participants: ParticipantFacts
    egos: tuple[EgoFacts, ...] = Field(description="one per planning problem, by ascending id")

    @property
    def ego(self) -> EgoFacts | None:
        """The first planning problem's."""
        return self.egos[0] if self.egos else None


class ReadFactsRequest(Model):
    """Which file to read the facts from."""

    path: Path
