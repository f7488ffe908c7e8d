"""A map of a boundary as the product makes it, without a workspace: points of the lattice, evaluated in batches."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from plannerforge.engine.execution import silent
from plannerforge.engine.exploration import BoundarySearch
from plannerforge.engine.exploration.logical import logical_scenario
from plannerforge.engine.exploration.points import evaluate_points
from plannerforge.engine.exploration.roads import write_road
from plannerforge.engine.tuning import preset_configuration
from plannerforge.schemas.boundaries import LATTICE, PointsRequest
from plannerforge.workflows.boundaries import BATCH, RANKS

Place = tuple[int, int]


@dataclass
class MapCase:
    """The boundary of a planner in a logical scenario, over its first two parameters; points are evaluated once."""

    scenario: str
    planner: str
    folder: Path
    known: dict[Place, str] = field(default_factory=dict)

    def evaluate(self, places: Sequence[Place]) -> dict[Place, str]:
        """Return the outcomes at places."""
        logical = logical_scenario(self.scenario)
        xml = self.folder / f"{logical.base}.xml"
        if not xml.exists():
            write_road(logical.base, xml)
        axes = logical.parameters[:2]
        at = {one.name: one.base_value for one in logical.parameters[2:]}
        missing = [place for place in places if place not in self.known]
        for begin in range(0, len(missing), BATCH):
            batch = missing[begin : begin + BATCH]
            request = PointsRequest(
                xml=xml,
                configuration=preset_configuration(self.planner, None),
                traffic=logical.traffic,
                horizon_s=logical.horizon_s,
                logical=logical,
                points=tuple(
                    at | {axis.name: round(axis.at_share(k / LATTICE), 4) for axis, k in zip(axes, place, strict=True)}
                    for place in batch
                ),
            )
            done = evaluate_points(request, silent).evaluations
            self.known.update((place, one.outcome) for place, one in zip(batch, done, strict=True))
        return {place: self.known[place] for place in places}

    def adaptive(self, points: int) -> BoundarySearch:
        """Return the adaptive search with at most so many points."""
        search = BoundarySearch(points, RANKS, 0)
        while places := search.ask():
            search.tell(self.evaluate(places))
        return search
