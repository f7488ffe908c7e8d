"""The scene as the edits so far leave it, for the edits that follow and for the simulation."""

from dataclasses import replace

from plannerforge.engine.edits.changes import Changes
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
