import gzip
from pathlib import Path

import pytest
from support import Connect

from plannerforge.engine.maps.draw_library import LIBRARY

pytestmark = pytest.mark.anyio


async def test_packed_maps_of_a_folder_go_in_and_a_broken_one_is_named(connect: Connect, tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    (folder / "town.osm.gz").write_bytes(gzip.compress((LIBRARY / "fahrhausen.osm").read_bytes()))
    (folder / "broken.osm.gz").write_bytes(b"no archive")
    async with connect() as client:
        answer = await client.call_tool("import_files", {"path": str(folder)})
        text = str(answer.content)
        assert not answer.is_error, text
        assert "Fahrhausen (ZAM)" in text
        assert "broken.osm.gz" in text
        assert "cannot be unpacked" in text
