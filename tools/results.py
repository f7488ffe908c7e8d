"""The tools for the results of runs: figures, comparisons, pictures."""

from pathlib import Path

from ..resources.templates import picture_link
from ..schemas.analysis.comparison import CompareResultsArguments, CompareResultsResult
from ..schemas.rendering import RenderArguments
from ..schemas.results import AnalyzeResultsArguments, AnalyzeResultsResult
from ..workflows import rendering
from ..workflows.analysis import comparison, figures
from .call import Image, ImageAnswer, ToolCall


async def analyze_results(arguments: AnalyzeResultsArguments, call: ToolCall) -> AnalyzeResultsResult:
    """Return rates, metrics, costs and findings of runs."""
    result = await figures.analyze_results(arguments, call)
    call.shows(*result.results)
    return result


async def compare_results(arguments: CompareResultsArguments, call: ToolCall) -> CompareResultsResult:
    """Compare results with paired tests."""
    result = await comparison.compare_results(arguments, call)
    call.shows(
        *dict.fromkeys(key for side in result.sides for key in ([side.result_id] if side.result_id else side.run_ids))
    )
    return result


async def render(arguments: RenderArguments, call: ToolCall) -> ImageAnswer:
    """Draw a picture, animation or chart."""
    drawing = await rendering.render(arguments, call)
    call.shows(*drawing.viewed)
    images = drawing.made.images
    links = tuple(picture_link(Path(image.path), image.mime_type) for image in images)
    kind = drawing.made.kind
    lines = [
        image.alt_text if image.alt_text.lower().startswith(kind) else f"{kind}: {image.alt_text}" for image in images
    ]
    lines += [f"{link.uri} ({image.width_px}×{image.height_px})" for link, image in zip(links, images, strict=True)]
    lines += [f"Note: {note}" for note in drawing.made.notes]
    return ImageAnswer("\n".join(lines), tuple(Image(Path(one.path), one.mime_type) for one in images), links)
