"""Describing a scenario in words and ids, so that an edit can be written from it."""

from collections.abc import Mapping

import numpy as np

from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.kept_scene import scene_of
from plannerforge.engine.edits.lane_order import ego_lane, is_own_recording, leader_and_follower
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import select
from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.scenarios.describe_checks import checks_of
from plannerforge.engine.scenarios.describe_ego import describe_ego
from plannerforge.engine.scenarios.describe_lanelets import describe_lanelets
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.scenarios.where_words import EgoLane
from plannerforge.schemas.errors import UnknownName, closest
from plannerforge.schemas.scenarios import DescribedVehicle, DescribeRequest, Description, Detail

VEHICLES_SHOWN: Mapping[Detail, int] = {"brief": 8, "vehicles": 40, "lanelets": 0, "checks": 0, "recipe": 0}
LANELETS_SHOWN: Mapping[Detail, int] = {"brief": 6, "vehicles": 0, "lanelets": 30, "checks": 0, "recipe": 0}
OWN_RECORDING = "where the ego starts, as fast: its own recording, which counts as a collision until it is removed"


def describe(request: DescribeRequest, report: ProgressReporter) -> Description:
    """Ego, vehicles and lanelets near the focus; how many depends on the detail.

    Raises:
        UnknownName: a focus that is no vehicle, lanelet or selector.
        UnsafeInput: the file is broken.
    """
    report(0.0, "reading the scenario")
    scene = scene_of(request.path, request.problem_id).scene
    ego = describe_ego(scene)
    center, name = _center(scene, request.focus)
    vehicles = _vehicles(scene, center)
    near = [vehicle for vehicle in vehicles if vehicle.distance_m <= request.radius_m]
    lanelets, total = describe_lanelets(scene, ego, center, request.radius_m, LANELETS_SHOWN[request.detail])
    return Description(
        ego=ego,
        focus=name,
        vehicles=tuple(near[: VEHICLES_SHOWN[request.detail]]),
        vehicles_total=len(vehicles),
        lanelets=lanelets,
        lanelets_total=total,
        checks=checks_of(scene) if request.detail == "checks" else (),
    )


def _center(scene: Scene, focus: str | None) -> tuple[Points, str]:
    """The point that everything is listed around, and its name."""
    tracks = scene.tracks | scene.standing
    word = (focus or "ego").strip()
    if word.lower() == "ego":
        if scene.ego is not None:
            return scene.ego.position, "the ego"
        vertices = np.vstack([lanelet.center_vertices for lanelet in scene.network.lanelets])
        return np.asarray(vertices.mean(axis=0)), "the middle of the map"
    if word.isdigit() and int(word) not in tracks:
        lanelet = scene.network.find_lanelet_by_id(int(word))
        if lanelet is None:
            known = [*(str(key) for key in tracks), *(str(lane.lanelet_id) for lane in scene.network.lanelets)]
            raise UnknownName(f"'{word}' is neither a vehicle nor a lanelet", valid=["ego", *closest(word, known)])
        middle = lanelet.center_vertices[len(lanelet.center_vertices) // 2]
        return np.asarray(middle, dtype=float), f"lanelet {word}"
    chosen = select([word], scene, Changes(next_id=0, driven={}))[0]
    index = tracks[chosen].index_at(scene.ego.step if scene.ego else 0) or 0
    return tracks[chosen].positions[index], f"vehicle {chosen}"


def _vehicles(scene: Scene, center: Points) -> list[DescribedVehicle]:
    """All vehicles by their distance to the centre; each where it is at the ego's start, or first appears."""
    lane = ego_lane(scene, scene.ego) if scene.ego else None
    begin, roles = scene.ego.step if scene.ego else 0, _roles(scene)
    described = [
        _vehicle(scene, lane, track, begin, center, moves=key in scene.tracks)
        for key, track in sorted((scene.tracks | scene.standing).items())
    ]
    said = [_with_role(scene, vehicle, roles) for vehicle in described]
    return sorted(said, key=lambda vehicle: (vehicle.distance_m, vehicle.vehicle_id))


def _with_role(scene: Scene, vehicle: DescribedVehicle, roles: Mapping[int, str]) -> DescribedVehicle:
    """Say who is the ego's own recording, and whom ``lead`` or ``follow`` mean who is not in the ego's lane."""
    track = scene.tracks.get(vehicle.vehicle_id)
    if track is not None and scene.ego is not None and is_own_recording(track, scene.ego):
        return vehicle.model_copy(update={"where": OWN_RECORDING, "gap_m": None})
    role = roles.get(vehicle.vehicle_id)
    if role is None or vehicle.gap_m is not None:
        return vehicle
    return vehicle.model_copy(update={"where": f"{vehicle.where}, {role}"})


def _roles(scene: Scene) -> dict[int, str]:
    lead, follow = leader_and_follower(scene, scene.ego) if scene.ego else (None, None)
    found = {lead: "nearest ahead along lanelets: 'lead'", follow: "nearest behind along lanelets: 'follow'"}
    return {key: role for key, role in found.items() if key is not None}


def _vehicle(
    scene: Scene, lane: EgoLane | None, track: Track, begin: int, center: Points, *, moves: bool
) -> DescribedVehicle:
    index = track.index_at(begin) or 0
    match = scene.matches.get(track.obstacle_id)
    lanelet = match.at(index) if match else None
    where = lane.where(track, index, lanelet) if lane else None
    distance = float(np.linalg.norm(track.positions[index] - center))
    speed = float(track.speeds_mps[index])
    return DescribedVehicle(
        vehicle_id=track.obstacle_id,
        kind=track.kind,
        where=where.words if where else f"{distance:.0f} m away",
        lanelet=lanelet,
        speed_mps=round(speed, 2),
        distance_m=round(distance, 1),
        ahead_m=where.ahead_m if where else None,
        gap_m=where.gap_m if where else None,
        from_s=round(max(track.first_step - begin, 0) * scene.step_s, 2),
        until_s=round((track.last_step - begin) * scene.step_s, 2),
        moves=moves and float(track.speeds_mps.max(initial=0.0)) > 0.1,
    )
