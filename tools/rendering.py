"""The tool that draws."""

import hashlib
import os
import shutil
from pathlib import Path

from plannerforge.engine.workspace.artifacts import Artifact, Workspace
from plannerforge.resources.templates import SCHEME
from plannerforge.schemas.errors import InvalidRequest, ResourceFailure, UnknownName
from plannerforge.schemas.rendering import RenderArguments, Rendered, RenderedImage, RenderRequest
from plannerforge.tools.call import Image, ImageAnswer, ToolCall
from plannerforge.tools.result_choice import WORDS, choose_results, config_weights, run_sources, scenario_sources

TIMEOUT_S = 50.0


async def render(arguments: RenderArguments, call: ToolCall) -> ImageAnswer:
    """A picture, animation or chart."""
    scenario_ids, run_ids = _meant(arguments.ids, call)
    runs = run_sources(run_ids, call)
    drawn_on = [*scenario_ids, *(run.record.scenario_id for run in runs)]
    with call.workspace.scratch() as folder:
        request = RenderRequest(
            kind=arguments.kind,
            scenarios=scenario_sources(drawn_on, call),
            runs=runs,
            configs=config_weights(runs, call),
            time_s=arguments.time_s,
            folder=str(folder),
        )
        made = await call.run("plannerforge.engine.rendering.render:render", request, Rendered, timeout_s=TIMEOUT_S)
        kept = [(_keep(image, call.workspace), image) for image in made.images]
    links = tuple(f"{SCHEME}picture/{path.name}" for path, _ in kept)
    lines = [f"{made.kind}: {image.alt_text}" for _, image in kept]
    lines += [f"{link} ({image.width_px}×{image.height_px})" for link, (_, image) in zip(links, kept, strict=True)]
    lines += [f"Note: {note}" for note in made.notes]
    return ImageAnswer("\n".join(lines), tuple(Image(path, image.mime_type) for path, image in kept), links)


def _meant(words: list[str], call: ToolCall) -> tuple[list[str], list[str]]:
    """Scenario ids and run ids; ``latest`` is the newest scenario, run or batch."""
    scenarios: list[str] = []
    runs: list[str] = []
    for word in words:
        artifact = _newest(call) if word == "latest" else None
        name = artifact.artifact_id if artifact is not None else word
        kind = artifact.kind if artifact is not None else None if name in WORDS else call.workspace.kind_of(name)
        if kind == "scenario":
            scenarios.append(name)
        elif kind in (None, "run", "batch"):
            runs += [run_id for found in choose_results([name], call) for run_id in found.run_ids]
        else:
            raise InvalidRequest(f"'{name}' is a {kind}, which cannot be drawn", valid=["scenario", "run", "batch"])
    return scenarios, runs


def _newest(call: ToolCall) -> Artifact:
    kinds = ("scenario", "run", "batch")
    found = [artifact for kind in kinds for artifact in call.workspace.newest(kind=kind, limit=1)]  # type: ignore[arg-type]
    if not found:
        raise UnknownName("there is nothing to draw yet", next_step="call find_scenarios or generate_scenarios")
    return max(found, key=lambda artifact: artifact.sequence)


def _keep(image: RenderedImage, workspace: Workspace) -> Path:
    """Move an image into the workspace's pictures; its name is made from its content, so the same picture is one file.

    Raises:
        ResourceFailure: it cannot be written.
    """
    made = Path(image.path)
    digest = hashlib.sha256(made.read_bytes()).hexdigest()[:12]
    target = workspace.root / "pictures" / f"{made.stem}_{digest}{made.suffix}"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        whole = target.with_name(f".{target.name}.{os.getpid()}")
        shutil.copyfile(made, whole)
        whole.replace(target)
    except OSError as error:
        raise ResourceFailure(f"{target} cannot be written: {error.strerror}", next_step="free disk space") from error
    return target
