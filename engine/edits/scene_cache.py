"""A worker's cache of scenes: a scenario is edited repeatedly, and reading it takes longer than an edit."""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path

from ..commonroad import RecordedScenario, kept_recording
from ..cosimulation import SimulationSetup
from ..scene import Scene, leader_and_follower
from .ego_risk import EgoDrive, base_drive

_KEPT = 4
"""Scenes kept by a worker, tens of MB each (chosen)."""


@dataclass(frozen=True)
class KeptScene:
    """A scene, and the ego's drive in it before any edit, which is a simulation independent of the edits."""

    scene: Scene
    _drives: dict[int, EgoDrive | None] = field(default_factory=dict)

    @cached_property
    def neighbours(self) -> tuple[int | None, int | None]:
        """The nearest vehicles ahead and behind along the ego's lane at its start; None if there is no such vehicle."""
        return leader_and_follower(self.scene, self.scene.ego) if self.scene.ego else (None, None)

    def ego_before(self, setup: SimulationSetup) -> EgoDrive | None:
        """Return the ego's drive by an ordinary driver among the recorded vehicles, up to the end of the recording.

        The last seed's drive is cached.
        """
        if setup.seed not in self._drives:
            drive = base_drive(self.scene, replace(setup, last_step=self.scene.last_step))
            self._drives.clear()
            self._drives[setup.seed] = drive
        return self._drives[setup.seed]


def scene_of(path: Path, problem_id: int | None = None) -> KeptScene:
    """Return the scene of a file with its lanes and SUMO network; built once per content, and never changed.

    Args:
        path: the CommonRoad file.
        problem_id: the planning problem of the ego; None for the first.

    Raises:
        UnknownName: the file has no such planning problem.
        UnsafeInput: the file is not readable.
    """
    return _scene(kept_recording(path), problem_id)


@lru_cache(maxsize=_KEPT)
def _scene(recorded: RecordedScenario, problem_id: int | None) -> KeptScene:
    return KeptScene(Scene.of(recorded.loaded, problem_id))
