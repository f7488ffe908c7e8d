"""The tool that draws."""

from pathlib import Path

from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.resources.templates import SCHEME
from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.schemas.rendering import RenderArguments
from plannerforge.tools.call import Image, ImageAnswer, ToolCall
from plannerforge.tools.drawings import draw
from plannerforge.tools.result_choice import WORDS, choose_results


async def render(arguments: RenderArguments, call: ToolCall) -> ImageAnswer:
    """A picture, animation or chart."""
    scenario_ids, run_ids = _meant(arguments.ids, call)
    made = await draw(call, arguments.kind, scenario_ids=scenario_ids, run_ids=run_ids, time_s=arguments.time_s)
    links = tuple(f"{SCHEME}picture/{Path(image.path).name}" for image in made.images)
    lines = [f"{made.kind}: {image.alt_text}" for image in made.images]
    lines += [f"{link} ({image.width_px}×{image.height_px})" for link, image in zip(links, made.images, strict=True)]
    lines += [f"Note: {note}" for note in made.notes]
    return ImageAnswer("\n".join(lines), tuple(Image(Path(i.path), i.mime_type) for i in made.images), links)


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
