"""Drawing with a memory: what was drawn of the same artifacts before is not drawn again."""

import hashlib
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import versions_of
from plannerforge.schemas.errors import ResourceFailure
from plannerforge.schemas.rendering import PictureKind, Rendered, RenderedImage, RenderRequest
from plannerforge.tools.call import ToolCall
from plannerforge.tools.result_choice import config_weights, run_sources, scenario_sources

TIMEOUT_S = 50.0
FOLDER = "pictures"


async def draw(
    call: ToolCall,
    kind: PictureKind,
    *,
    scenario_ids: Sequence[str] = (),
    run_ids: Sequence[str] = (),
    time_s: float | None = None,
) -> Rendered:
    """Draw scenarios and runs; the images lie in the workspace's pictures, named after what they show.

    Raises:
        NotPossible: the kind needs what is not there.
        ResourceFailure: the pictures cannot be written.
    """
    runs = run_sources(run_ids, call)
    drawn_on = [*scenario_ids, *(run.record.scenario_id for run in runs)]
    request = RenderRequest(
        kind=kind,
        scenarios=scenario_sources(drawn_on, call),
        runs=runs,
        configs=config_weights(runs, call),
        time_s=time_s,
        folder="",
    )
    note = call.workspace.root / FOLDER / f"{_digest(request)}.json"
    if note.is_file():
        return Rendered.model_validate_json(note.read_text(encoding="utf-8"))
    with call.workspace.scratch() as folder:
        made = await call.run(
            "plannerforge.engine.rendering.render:render",
            request.model_copy(update={"folder": str(folder)}),
            Rendered,
            timeout_s=TIMEOUT_S,
        )
        return _kept(made, note, call.workspace)


def _digest(request: RenderRequest) -> str:
    content = request.model_dump_json() + repr(versions_of("matplotlib", "pillow"))
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def _kept(made: Rendered, note: Path, workspace: Workspace) -> Rendered:
    """Move the images into the workspace, whole; the note that says so comes last."""
    images: list[RenderedImage] = []
    try:
        note.parent.mkdir(parents=True, exist_ok=True)
        for image in made.images:
            source = Path(image.path)
            target = note.with_name(f"{source.stem}_{note.stem}{source.suffix}")
            whole = target.with_name(f".{target.name}.{os.getpid()}")
            shutil.copyfile(source, whole)
            whole.replace(target)
            images.append(image.model_copy(update={"path": str(target)}))
        kept = made.model_copy(update={"images": tuple(images)})
        whole = note.with_name(f".{note.name}.{os.getpid()}")
        whole.write_text(kept.model_dump_json(), encoding="utf-8")
        whole.replace(note)
    except OSError as error:
        raise ResourceFailure(
            f"{workspace.root / FOLDER} cannot be written: {error.strerror or error}", next_step="free disk space"
        ) from error
    return kept
