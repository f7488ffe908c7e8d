"""Edits carried out: simulated, and once more where an added vehicle would collide as it enters."""

from dataclasses import dataclass, replace

from plannerforge.engine.edits.altered_scene import altered
from plannerforge.engine.edits.cascade import Resimulated, resimulate_until_clear
from plannerforge.engine.edits.changes import Changes, EditStep
from plannerforge.engine.edits.entry_conflicts import slower_entries
from plannerforge.engine.edits.operations import resolve_edits
from plannerforge.engine.edits.ordinary_ego import EgoDrive, drive_after, ego_participant
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.sumo_process import SimulationSetup
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.modification import ModificationRequest


@dataclass(frozen=True)
class CarriedOut:
    """What edits come to once they are simulated.

    ``ego``: how an ordinary driver drives the ego after them; None without one. ``notes``: sentences on what was done
    besides.
    """

    scene: Scene
    changes: Changes
    steps: tuple[EditStep, ...]
    ego: Track | None
    result: Resimulated
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class EditRun:
    """What the edits of a request are carried out with; ``ego_before``: the ego's drive in the base scenario."""

    request: ModificationRequest
    base: Scene
    setup: SimulationSetup
    ego_before: EgoDrive | None

    def carry_out(self, changes: Changes, steps: tuple[EditStep, ...], first_id: int) -> CarriedOut:
        """Simulate the edits as they were resolved.

        Where an added vehicle collides as it enters although the request left its speed open, it enters slower, as long
        as fewer collide so. ``first_id``: the id that the first added vehicle gets.
        """
        usual = self._simulated(changes, steps)
        slower = slower_entries(self.request.edits, usual.scene, changes, usual.result)
        if slower is None:
            return usual
        edits, notes = slower
        try:
            other = self._simulated(*resolve_edits(edits, self.base, first_id, self.request.earlier))
        except InvalidRequest:  # an edit that goes by speeds ("fastest") may find nobody then
            other = usual
        if len(other.result.overlaps) < len(usual.result.overlaps):
            return replace(other, notes=notes)
        # The last simulation leaves its files behind; they have to be those of the motion that is written.
        return self._simulated(changes, steps)

    def _simulated(self, changes: Changes, steps: tuple[EditStep, ...]) -> CarriedOut:
        scene = altered(self.base, changes)
        ego = drive_after(self.ego_before, self.base, scene, changes, self.setup)
        return CarriedOut(scene, changes, steps, ego, self._result(scene, changes, ego))

    def _result(self, scene: Scene, changes: Changes, ego: Track | None) -> Resimulated:
        """Re-simulate if anything is driven; removals and goals alone leave all recordings as they are."""
        everybody = self.request.traffic == "reactive"
        if not changes.driven and not changes.replays and not everybody:
            return Resimulated({}, {}, (), ())
        seen_ego = None if ego is None else ego_participant(scene, ego)
        shown = () if seen_ego is None else (seen_ego,)
        return resimulate_until_clear(scene, changes, self.setup, shown, everybody=everybody)
