"""The server's icon: within the message, small, of both kinds that hosts draw, and no part of what a model reads."""

import base64
import io
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import pytest
from mcp.types import Icon
from PIL import Image

from plannerforge.server.assembly import offered_tools
from plannerforge.server.settings import Settings
from plannerforge.server.tool_schema import described_tool, server_icons

MOST_BYTES = 1024


def decoded(icon: Icon) -> bytes:
    head, _, data = icon.src.partition(",")
    assert head == f"data:{icon.mime_type};base64"
    return base64.b64decode(data, validate=True)


def pixels(icon: Icon) -> Iterator[tuple[int, int, int, int]]:
    with Image.open(io.BytesIO(decoded(icon))) as picture:
        shown = picture.convert("RGBA")
        yield from (shown.getpixel((x, y)) for x in range(shown.width) for y in range(shown.height))  # type: ignore[misc]


@pytest.mark.anyio
async def test_the_server_shows_its_icon_to_clients_of_both_eras(connect: Any) -> None:
    async with connect() as client:
        assert client.server_info.icons == server_icons()


def test_each_icon_is_embedded_in_the_message_and_small() -> None:
    icons = server_icons()
    assert [icon.mime_type for icon in icons] == ["image/svg+xml", "image/png"]
    assert all(len(icon.src) < MOST_BYTES for icon in icons)


def test_the_drawing_contains_no_program_and_fetches_no_files() -> None:
    drawing = decoded(server_icons()[0]).decode()
    root = ElementTree.fromstring(drawing)
    assert {element.tag.rpartition("}")[2] for element in root.iter()} <= {"svg", "rect", "path", "circle", "g"}
    assert "href" not in drawing
    assert drawing.count("http") == 1, "the name of the format"


def luminance(red: int, green: int, blue: int) -> float:
    linear = [c / 255 / 12.92 if c <= 10 else ((c / 255 + 0.055) / 1.055) ** 2.4 for c in (red, green, blue)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: float, two: float) -> float:
    return (max(one, two) + 0.05) / (min(one, two) + 0.05)


def test_the_picture_is_visible_on_light_and_dark_and_its_drawing_on_its_background() -> None:
    """Contrast of 3, which WCAG 2.2 asks of graphics: the ground against white and near black, white on the ground."""
    shown = [pixel for pixel in pixels(server_icons()[1]) if pixel[3] == 255]
    assert len(shown) > 48 * 48 * 0.8
    ground = luminance(*max(set(shown), key=shown.count)[:3])
    assert min(contrast(ground, luminance(255, 255, 255)), contrast(ground, luminance(24, 24, 24))) >= 2.8


def test_no_listed_tool_carries_an_icon() -> None:
    assert all(described_tool(spec).icons is None for spec in offered_tools(Settings(tools="all")))
