"""The steps of a run, from their file."""

from pathlib import Path

import numpy as np

from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.errors import ResourceFailure
from plannerforge.schemas.results import RunSource
from plannerforge.schemas.runs import RunSteps


def driven_tracks(steps: RunSteps) -> dict[int, Track]:
    """How the obstacles of reactive traffic moved, by id; empty where all followed their recordings."""
    return {
        other.obstacle_id: Track(
            obstacle_id=other.obstacle_id,
            kind=other.kind,
            length_m=other.length_m,
            width_m=other.width_m,
            first_step=other.first_step,
            positions=np.column_stack([other.x_m, other.y_m]),
            headings_rad=np.asarray(other.heading_rad, dtype=float),
            speeds_mps=np.asarray(other.speed_mps, dtype=float),
        )
        for other in steps.others
    }


def read_steps(source: RunSource) -> RunSteps | None:
    """The steps of a run; None where none were kept.

    Raises:
        ResourceFailure: the file is named but cannot be read.
    """
    if source.steps_path is None:
        return None
    try:
        return RunSteps.model_validate_json(Path(source.steps_path).read_bytes())
    except OSError as error:
        raise ResourceFailure(f"The steps of {source.record.run_id} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ResourceFailure(f"The steps of {source.record.run_id} are damaged", next_step="run it again") from error
