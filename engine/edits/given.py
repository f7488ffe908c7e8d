"""The scenario that a call edits: the reference for what the call's answer says about its edits.

Earlier edits are applied to their base again, so the stages of a request start from other scenarios. The answer
compares with the scenario that the call names, in which an ordinary driver drives the ego. Edits that move the whole
scene move this reference too. Distances are in m.
"""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...schemas.modification import Edit, EditCollision, ModificationOutcome, ModificationRequest
from ..commonroad import Track
from ..cosimulation import SimulationSetup
from .edited_scene import NEAR_STEPS, SimulatedEdits, overlap_steps
from .ego_risk import EgoDrive, EgoRisk, is_unchanged, risk_against
from .scene_cache import KeptScene, scene_of

_CHANGES_EGO = ("set_ego", "set_goal")


@dataclass(frozen=True)
class GivenScenario:
    """The scenario that a call edits, in the coordinates and times of the edited scenario.

    ``before``: the drive of its ego, unmoved. ``drive``: the ego's motion to compare along. ``tracks``: its moving road
    users by id. ``own``: these tracks before the call's edits. ``ids``: all its road users.
    """

    before: EgoDrive | None
    drive: Track | None
    tracks: Mapping[int, Track]
    own: Mapping[int, Track]
    ids: frozenset[int]

    @classmethod
    def of(cls, request: ModificationRequest) -> "GivenScenario":
        """Return the scenario that a request's new edits start from."""
        kept = scene_of(request.given or request.xml, request.problem_id)
        before, scene = _drive(kept, request.seed), kept.scene
        ids = {*scene.tracks, *scene.standing, *(region.obstacle_id for region in scene.regions)}
        return cls(before, None if before is None else before.track, scene.tracks, scene.tracks, frozenset(ids))

    def after(self, edit: Edit, xml: Path, request: ModificationRequest) -> "GivenScenario":
        """Return the reference after an edit of the whole scene, which has written the file.

        A mirrored ego drives as before. With other lights or in another period of time, it is simulated again.
        """
        if edit.op == "mirror":
            tracks = {key: _mirrored(track) for key, track in self.tracks.items()}
            return replace(self, drive=None if self.drive is None else _mirrored(self.drive), tracks=tracks)
        if edit.op == "set_weather" or (edit.op == "crop" and edit.time_s is None and edit.duration_s is None):
            return self
        kept = scene_of(xml, request.problem_id)
        drive = _drive(kept, request.seed)
        return replace(self, drive=None if drive is None else drive.track, tracks=kept.scene.tracks)

    def risk_after(self, request: ModificationRequest, edited: SimulatedEdits) -> EgoRisk | None:
        """Return the ego's risk among the road users after the edits, along its motion in the given scenario.

        If the call's edits change its start or goal, the risk is along its new motion.
        """
        is_moved = any(edit.op in _CHANGES_EGO for edit in request.edits[request.earlier :])
        drive = edited.ego if is_moved else self.drive
        return None if drive is None else risk_against(drive, edited, self.tracks)

    def compared(
        self, outcome: ModificationOutcome, request: ModificationRequest, edited: SimulatedEdits
    ) -> ModificationOutcome:
        """Return an outcome without what the given scenario already had, if it was edited before."""
        if request.given is None:
            return outcome
        now = {track.obstacle_id: track for track in edited.tracks}
        unchanged = {key for key, track in self.tracks.items() if key in now and is_unchanged(now[key], track)}
        return outcome.model_copy(
            update={
                "touched": tuple(
                    one for one in outcome.touched if one.vehicle_id in now and one.vehicle_id not in unchanged
                ),
                "removed": tuple(key for key in outcome.removed if key in self.ids),
                "collisions": tuple(
                    hit for hit in outcome.collisions if not self._has(hit, unchanged, edited.scene.step_s)
                ),
                "untouched": len(unchanged),
            }
        )

    def _has(self, hit: EditCollision, unchanged: set[int], step_s: float) -> bool:
        """Return whether two road users already collide in the given scenario."""
        first, second = (self.own.get(key) for key in hit.vehicles)
        if first is None or second is None:
            return False
        if unchanged.issuperset(hit.vehicles):
            return True
        return any(abs(step - hit.time_s / step_s) <= NEAR_STEPS for step in overlap_steps(first, second))


def _drive(kept: KeptScene, seed: int) -> EgoDrive | None:
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / "scenario.net.xml"
        net.write_text(kept.scene.sumo_net, encoding="utf-8")
        return kept.ego_before(SimulationSetup(net, net.parent, kept.scene.step_s, kept.scene.last_step, seed))


def _mirrored(track: Track) -> Track:
    """Return a track mirrored at the east-west axis."""
    positions = track.positions * np.array([1.0, -1.0])
    return replace(track, positions=positions, headings_rad=-track.headings_rad)
