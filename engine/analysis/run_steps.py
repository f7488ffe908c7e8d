"""The steps of a run, from their file."""

from pathlib import Path

from plannerforge.schemas.errors import ResourceFailure
from plannerforge.schemas.results import RunSource
from plannerforge.schemas.runs import RunSteps


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
