"""Archives from the internet: what cannot be read is refused by name, and nothing leads outside the folder."""

import contextlib
import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from plannerforge.engine.catalog.archives import unpack
from plannerforge.schemas.errors import UnsafeInput


def packed(path: Path, *names: str, method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name in names:
            archive.writestr(name, "<commonRoad/>" * 50)
    return path


def names_in(path: Path) -> list[str]:
    with unpack(path) as folder:
        return sorted(file.name for file in folder.iterdir())


def test_members_are_unpacked_under_their_bare_names(tmp_path: Path) -> None:
    path = packed(tmp_path / "a.zip", "one/a.xml", "../../b.xml", "two/a.xml", "notes.txt", "/etc/c.xml")
    assert names_in(path) == ["2-a.xml", "a.xml", "b.xml", "c.xml"]


def test_a_name_too_long_for_file_systems_is_cut(tmp_path: Path) -> None:
    (name,) = names_in(packed(tmp_path / "a.zip", "ä" * 300 + ".xml"))
    assert name.startswith("0-")
    assert name.endswith("ää.xml")


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.data())
def test_a_damaged_archive_is_read_or_refused(tmp_path: Path, method: int, data: st.DataObject) -> None:
    content = bytearray(packed(tmp_path / "a.zip", "a.xml", "b.xml", method=method).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(content)))
    path = tmp_path / "damaged.zip"
    path.write_bytes(content[:cut] if data.draw(st.booleans()) else content)
    with contextlib.suppress(UnsafeInput):
        assert len(names_in(path)) <= 2
