"""What is to be drawn of a scenario, and what of it needs an entry in the legend."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from plannerforge.engine.rendering.driven_path import DrivenPath
from plannerforge.engine.rendering.palette import EGO_COLOUR, series_style
from plannerforge.engine.rendering.scene_content import SceneContent
from plannerforge.engine.rendering.traffic_layer import vehicles_at
from plannerforge.engine.rendering.viewport import Viewport


@dataclass(frozen=True)
class SceneView:
    """One scenario to draw: its content, the runs over it and the step that is shown."""

    content: SceneContent
    paths: tuple[DrivenPath, ...] = ()
    step: int = 0

    @property
    def time_s(self) -> float:
        """The moment in seconds."""
        return self.step * self.content.step_s

    def ego_colour(self, number: int) -> str:
        """Colour of the ego of the n-th run: its path's where several are to be told apart."""
        return EGO_COLOUR if len(self.paths) == 1 else series_style(self.paths[number].series)[0]


@dataclass(frozen=True)
class Inventory:
    """What a scene shows; everything named here gets an entry in the legend; ``runs``: label and series."""

    kinds: tuple[str, ...]
    signals: tuple[str, ...]
    runs: tuple[tuple[str, int], ...]
    has_ego: bool
    has_goal: bool
    has_stop_lines: bool
    has_collision: bool

    @property
    def columns(self) -> int:
        """Entries beside each other; runs have long names."""
        return 4 if self.runs else 7

    @property
    def rows(self) -> int:
        """Lines of the legend."""
        flags = (self.has_ego, self.has_goal, self.has_stop_lines, self.has_collision)
        entries = len(self.kinds) + len(self.signals) + len(self.runs) + sum(flags)
        return max(math.ceil(entries / self.columns), 1)


def inventory(
    views: Sequence[SceneView], viewports: Sequence[Viewport], steps: Iterable[int] | None = None
) -> Inventory:
    """What these views show at their own step, or at any of ``steps``."""
    moments = None if steps is None else list(steps)
    kinds, signals = set(), set()
    runs: dict[int, str] = {}
    stop_lines = collision = False
    for view, viewport in zip(views, viewports, strict=True):
        shown = [view.step] if moments is None else moments
        for step in shown:
            kinds |= {vehicle.kind for vehicle in vehicles_at(view.content, step) if viewport.contains(vehicle.corners)}
            signals |= {
                signal.state_at(step) for signal in view.content.signals if viewport.contains(signal.position[None, :])
            }
        for path in view.paths:
            runs.setdefault(path.series, path.label if len(views) == 1 else path.name)
        stop_lines |= any(viewport.contains(line) for line in view.content.stop_lines)
        collided = [path.record.collision for path in view.paths if path.record.collision is not None]
        collision |= any(found.step <= max(shown) for found in collided)
    return Inventory(
        kinds=tuple(sorted(kinds)),
        signals=tuple(sorted(signals)),
        runs=tuple((label, series) for series, label in sorted(runs.items())),
        has_ego=any(view.content.ego_position is not None and len(view.paths) < 2 for view in views),
        has_goal=any(len(view.content.goal_points()) for view in views),
        has_stop_lines=stop_lines,
        has_collision=collision,
    )
