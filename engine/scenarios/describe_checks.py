"""What a look over a scenario finds: is the file valid, can the goal be reached, does anything overlap at the start."""

import numpy as np

from plannerforge.engine.edits.scene import EGO_SIZE_M, Scene
from plannerforge.engine.geometry.polyline import oriented_rectangle, rectangles_overlap
from plannerforge.engine.scenarios.ego_route import ego_route, goal_lanelets
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.scenarios.validate import schema_errors

SHOWN = 3


def checks_of(scene: Scene) -> tuple[str, ...]:
    """A sentence for each check, beginning with ``ok`` or ``problem``."""
    return (_schema(scene), _goal(scene), _overlaps(scene), _off_the_road(scene))


def _schema(scene: Scene) -> str:
    found = schema_errors(scene.loaded.path)
    if not found:
        return "ok: valid by CommonRoad's XML schema 2020a"
    return f"problem: {len(found)} violations of CommonRoad's XML schema 2020a, first: {found[0][:200]}"


def _goal(scene: Scene) -> str:
    if scene.ego is None:
        return "problem: no planning problem"
    problem = scene.loaded.problem(scene.ego.problem_id)
    if not goal_lanelets(scene.network, problem):
        return "ok: the goal states no place on a lanelet"
    if ego_route(scene.network, scene.lanelet_graph, problem) is None:
        return "problem: no way leads from the ego's start to its goal"
    return "ok: lanelets lead from the ego's start to its goal"


def _overlaps(scene: Scene) -> str:
    if scene.ego is None:
        return "ok: no ego that could overlap"
    own = oriented_rectangle(np.asarray(scene.ego.position), scene.ego.heading_rad, EGO_SIZE_M)
    step = scene.ego.step
    hit = [key for key, track in sorted((scene.tracks | scene.standing).items()) if _overlaps_at(track, step, own)]
    if not hit:
        return "ok: nobody overlaps the ego at its start"
    return f"problem: the ego overlaps vehicle {', '.join(map(str, hit[:SHOWN]))} at its start"


def _overlaps_at(track: Track, step: int, own: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> bool:
    index = track.index_at(step)
    if index is None:
        return False
    size = (track.length_m, track.width_m)
    return rectangles_overlap(own, oriented_rectangle(track.positions[index], float(track.headings_rad[index]), size))


def _off_the_road(scene: Scene) -> str:
    lost = sorted(set(scene.tracks) - set(scene.matches))
    if not lost:
        return "ok: every moving vehicle is on or near a lanelet"
    return f"problem: {len(lost)} moving vehicles are on no lanelet: {', '.join(map(str, lost[:SHOWN]))}"
