"""The report: one HTML file with everything in it, readable on a phone, printable, without scripts."""

import base64
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.schemas.errors import ResourceFailure, UnsafeInput
from plannerforge.schemas.rendering import ReportImage, ReportRequest, ReportWritten

LARGEST_IMAGE_BYTES = 8_000_000
_MEDIA_TYPES = {b"\x89PNG\r\n\x1a\n": "image/png", b"GIF89a": "image/gif", b"GIF87a": "image/gif"}


@dataclass(frozen=True)
class Embedded:
    """A picture as it stands in the page."""

    data_uri: str
    caption: str
    alt_text: str
    width_px: int
    height_px: int


def write_report(request: ReportRequest, report: ProgressReporter) -> ReportWritten:
    """Write the page; pictures become data URIs, all text is escaped.

    Raises:
        ResourceFailure: a picture cannot be read, or the page not be written.
        UnsafeInput: a picture is no PNG or GIF, or larger than 8 MB.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    images: list[tuple[Embedded, ...]] = []
    for number, section in enumerate(request.sections):
        images.append(tuple(_embed(image) for image in section.images))
        report(0.8 * (number + 1) / len(request.sections), f"section {section.title}")
    loader = PackageLoader("plannerforge.engine.rendering", "")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.get_template("report.html.j2").render(
        report=request, sections=list(zip(request.sections, images, strict=True))
    )
    _write_whole(Path(request.path), page.encode())
    report(1.0, "report written")
    return ReportWritten(
        path=request.path,
        size_bytes=len(page.encode()),
        sections=len(request.sections),
        images=sum(len(group) for group in images),
    )


def _embed(image: ReportImage) -> Embedded:
    from PIL import Image

    path = Path(image.path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ResourceFailure(f"The picture {path.name} cannot be read: {error.strerror}") from error
    media_type = next((kind for start, kind in _MEDIA_TYPES.items() if content.startswith(start)), None)
    if media_type is None or len(content) > LARGEST_IMAGE_BYTES:
        raise UnsafeInput(f"{path.name} is no PNG or GIF of at most {LARGEST_IMAGE_BYTES:,} bytes")
    with Image.open(path) as opened:
        width, height = opened.size
    encoded = base64.b64encode(content).decode("ascii")
    return Embedded(f"data:{media_type};base64,{encoded}", image.caption, image.alt_text, width, height)


def _write_whole(path: Path, content: bytes) -> None:
    """Write under a temporary name and rename, so that nobody sees half a page."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
            Path(temporary).replace(path)
        except OSError:
            Path(temporary).unlink(missing_ok=True)
            raise
        path.chmod(0o644)
    except OSError as error:
        raise ResourceFailure(f"{path} cannot be written: {error.strerror}") from error
