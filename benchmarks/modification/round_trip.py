"""Checks that SUMO holds all road users as recorded: inserts them and reads them back, step by step."""

import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from plannerforge.engine.commonroad import Track
from plannerforge.engine.cosimulation import Actor, SimulationSetup, replayed_actor
from plannerforge.engine.cosimulation.replay import ShownState, replayed_states
from plannerforge.engine.network import sumo_net
from plannerforge.engine.scene import LaneMatch, Scene


@dataclass(frozen=True)
class RoundTrip:
    """Largest differences over all road users and steps; ``missing``: (id, step) of those that SUMO did not show."""

    road_users: int
    position_error_m: float
    speed_error_mps: float
    missing: tuple[tuple[int, int], ...]


def round_trip(scene: Scene, seed: int = 0) -> RoundTrip:
    """Replay a scenario's trajectories and static obstacles in SUMO, and compare the result with the recording.

    Raises:
        WorkerFailure: SUMO refused the network or a vehicle.
    """
    everybody = tuple(_participant(scene, key) for key in sorted(scene.tracks | scene.standing))
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / "scenario.net.xml"
        net.write_text(sumo_net(scene.layout, scene.lane_speeds_mps, scene.signals), encoding="utf-8")
        setup = SimulationSetup(net, net.parent, scene.step_s, scene.last_step, seed)
        seen = replayed_states(setup, everybody)
    errors: list[tuple[float, float]] = []
    missing: list[tuple[int, int]] = []
    for one in everybody:
        for index, step in enumerate(range(one.track.first_step, one.track.last_step + 1)):
            if step <= scene.last_step and (one.key, step) not in seen:
                missing.append((one.track.obstacle_id, step))
            elif step <= scene.last_step:
                errors.append(_errors(one.track, index, seen[one.key, step]))
    largest = np.max(np.array(errors).reshape(-1, 2), axis=0, initial=0.0)
    return RoundTrip(len(everybody), float(largest[0]), float(largest[1]), tuple(missing))


def _errors(track: Track, index: int, shown: ShownState) -> tuple[float, float]:
    """Return the distance in m between centres, and the difference in m/s between speeds."""
    heading = math.radians(90.0 - shown.angle_deg)
    center = np.array(shown.front) - track.length_m / 2 * np.array([math.cos(heading), math.sin(heading)])
    away = float(np.linalg.norm(center - track.positions[index]))
    return away, abs(shown.speed_mps - float(track.speeds_mps[index]))


def _participant(scene: Scene, key: int) -> Actor:
    """Return a road user as in a re-simulation; one off the lanes is put at its recorded position too."""
    track = (scene.tracks | scene.standing)[key]
    match = scene.matches.get(key)
    if match is not None:
        return replayed_actor(scene, track, match)
    anywhere = LaneMatch((0,), (next(iter(scene.layout.edges.values()))[0],))
    return replace(replayed_actor(scene, track, anywhere), hints=(("", -1),) * len(track.positions))
