"""A track that grows step by step, for others whose motion is not known before."""

import numpy as np

from plannerforge.engine.scenarios.tracks import Track

FIRST_CAPACITY = 64


class GrowingTrack:
    """The states of one road user so far; its size and type are those of ``like``."""

    def __init__(self, like: Track, first_step: int) -> None:
        self.like, self.first_step = like, first_step
        self._rows = np.empty((FIRST_CAPACITY, 4))
        self._count = 0

    @property
    def last_step(self) -> int:
        """The last step that was added; the one before the first without any."""
        return self.first_step + self._count - 1

    def add(self, x_m: float, y_m: float, heading_rad: float, speed_mps: float) -> None:
        """Centre, heading and speed at the next step."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self._count] = x_m, y_m, heading_rad, speed_mps
        self._count += 1

    def track(self) -> Track:
        """What was added so far, without copying."""
        rows = self._rows[: self._count]
        return Track(
            obstacle_id=self.like.obstacle_id,
            kind=self.like.kind,
            length_m=self.like.length_m,
            width_m=self.like.width_m,
            first_step=self.first_step,
            positions=rows[:, :2],
            headings_rad=rows[:, 2],
            speeds_mps=rows[:, 3],
        )
