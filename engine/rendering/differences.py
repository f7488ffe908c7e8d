"""Where scenarios that are drawn side by side differ, so that a picture of before and after shows what was changed."""

from collections.abc import Sequence

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.rendering.scene_content import SceneContent
from plannerforge.engine.rendering.scene_view import SceneView
from plannerforge.engine.rendering.viewport import MARGIN_M, Viewport, union

MOVED_M = 0.5
LARGEST_COMPARED_M = 400.0
"""A difference that would widen a picture beyond this is left outside: nothing could be recognised in it."""


def widened(viewport: Viewport, views: Sequence[SceneView]) -> Viewport:
    """The viewport with every goal and vehicle that is elsewhere, or only in one of the views, the nearest first."""
    middle = np.array([viewport.x_min + viewport.x_max, viewport.y_min + viewport.y_max]) / 2
    points = [point for view in views[1:] for point in _differing(views[0], view)]
    for point in sorted(points, key=lambda one: (float(np.linalg.norm(one - middle)), *one.tolist())):
        x, y = point.tolist()
        larger = union(viewport, Viewport(x - MARGIN_M, y - MARGIN_M, x + MARGIN_M, y + MARGIN_M))
        if max(larger.width_m, larger.height_m) <= LARGEST_COMPARED_M:
            viewport = larger
    return viewport


def _differing(first: SceneView, second: SceneView) -> list[Points]:
    before, after = _positions(first), _positions(second)
    found = []
    for key in sorted({*before, *after}):
        places = [positions[key] for positions in (before, after) if key in positions]
        if len(places) == 1 or float(np.linalg.norm(places[0] - places[1])) > MOVED_M:
            found += places
    goals = [_goal_centers(view.content) for view in (first, second)]
    same = len(goals[0]) == len(goals[1]) and np.allclose(goals[0], goals[1], atol=MOVED_M)
    return found if same else [*found, *goals[0], *goals[1]]


def _positions(view: SceneView) -> dict[int, Points]:
    tracks = view.content.tracks.items()
    return {key: track.positions[index] for key, track in tracks if (index := track.index_at(view.step)) is not None}


def _goal_centers(content: SceneContent) -> Points:
    centers = [polygon.mean(axis=0) for goal in content.goals for polygon in goal.polygons]
    return np.array(centers).reshape(-1, 2)
