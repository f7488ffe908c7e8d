"""What the modification bench judges: the base, the file that was written, and what SUMO held meanwhile."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.scenarios.reader import LoadedScenario, read_scenario
from plannerforge.engine.scenarios.tracks import Track, recorded_tracks
from plannerforge.evals.modification_sumo import SumoRecord
from plannerforge.schemas.modification import ModificationOutcome

Truth = Mapping[str, Any]
"""The ground truth of an edit in the corpus's form."""


@dataclass(frozen=True)
class Written:
    """The base as read, the ground truth of all edits, what was reported, the file that came of it, and SUMO's record.

    ``old`` and ``new``: the trajectories of both files.
    """

    base: Path
    scene: Scene
    truths: tuple[Truth, ...]
    outcome: ModificationOutcome
    xml: Path
    loaded: LoadedScenario
    old: Mapping[int, Track]
    new: Mapping[int, Track]
    sumo: SumoRecord

    @classmethod
    def of(cls, base: Path, scene: Scene, truths: tuple[Truth, ...], outcome: ModificationOutcome) -> "Written":
        """Read the new file and what was kept beside it."""
        if outcome.xml is None:
            raise ValueError("a dry run wrote nothing to check")
        loaded = read_scenario(outcome.xml)
        tracks = recorded_tracks(loaded.scenario)
        return cls(
            base, scene, truths, outcome, outcome.xml, loaded, scene.tracks, tracks, SumoRecord.of(outcome.xml.parent)
        )

    def added(self) -> tuple[int, ...]:
        """Ids of the road users that the base has not."""
        return tuple(key for key in self.new if key not in self.old)

    def meant_by(self, index: int) -> frozenset[int]:
        """Ids of the vehicles that the edit at an index is about, by the ground truth.

        Only where that leaves it open, as for a vehicle that another edit adds, the report is asked whom it took.
        """
        truth, reports = self.truths[index], self.outcome.edits
        if "vehicle_id" in truth:
            return frozenset([int(truth["vehicle_id"])])
        selector = truth.get("selector", {})
        added = [*selector.get("include_new", ()), *([selector["edit"]] if selector.get("by") == "new" else ())]
        named = truth.get("vehicle_ids")
        if named is None:
            return frozenset(reports[index].vehicles)
        return frozenset(named).union(*(reports[edit].vehicles for edit in added))

    def meant_to_go(self) -> frozenset[int]:
        """Ids of all that are to be removed."""
        going = [index for index, truth in enumerate(self.truths) if truth["op"] == "remove_vehicle"]
        return frozenset().union(*(self.meant_by(index) for index in going))
