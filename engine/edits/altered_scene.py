"""The scene as the edits so far leave it, for the edits that follow and for the simulation."""

from dataclasses import replace

from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.lane_matching import LaneMatch
from plannerforge.engine.edits.scene import Scene


def altered(base: Scene, changes: Changes) -> Scene:
    """The base scene with recordings moved in time, with added walkers, and with another start of the ego."""
    if not changes.replays and changes.ego is None:
        return base
    tracks = base.tracks | {key: replay.track for key, replay in changes.replays.items()}
    matches = {key: match for key, match in base.matches.items() if key not in changes.replays}
    matches |= {key: replay.match for key, replay in changes.replays.items() if replay.match is not None}
    return replace(
        base, tracks=dict(sorted(tracks.items())), matches=dict(sorted(matches.items())), ego=changes.ego or base.ego
    )


def populated(scene: Scene, changes: Changes) -> Scene:
    """An altered scene with the vehicles that edits put in, where they enter, and without those that edits took out.

    It says who is meant by a word and who is in the way, as a description of the edited scenario would. It is not for
    a simulation, which drives the added vehicles and has no recording of them.
    """
    added = {key: plan for key, plan in changes.driven.items() if plan.cause == "added"}
    if not added and not changes.removed:
        return scene
    tracks = {key: track for key, track in scene.tracks.items() if key not in changes.removed}
    tracks |= {key: plan.start for key, plan in added.items()}
    standing = {key: track for key, track in scene.standing.items() if key not in changes.removed}
    matches = {key: match for key, match in scene.matches.items() if key not in changes.removed}
    matches |= {key: LaneMatch((0,), plan.lanelets[:1]) for key, plan in added.items()}
    return replace(scene, tracks=dict(sorted(tracks.items())), standing=standing, matches=dict(sorted(matches.items())))
