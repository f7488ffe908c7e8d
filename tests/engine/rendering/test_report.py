"""The report is one page that stands alone and trusts no text."""

import re
from pathlib import Path

import pytest
from PIL import Image

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.rendering.reports import write_report
from plannerforge.schemas.errors import ResourceFailure, UnsafeInput
from plannerforge.schemas.rendering import ReportImage, ReportRequest, ReportSection, ReportTable

HOSTILE = '<script>alert("x")</script>'


def request(tmp_path: Path, picture: Path) -> ReportRequest:
    section = ReportSection(
        title=HOSTILE,
        asked=HOSTILE,
        text=("A paragraph.",),
        findings=(HOSTILE,),
        tables=(ReportTable(caption="Runs", columns=("run",), rows=((HOSTILE,),)),),
        images=(ReportImage(path=str(picture), caption="A picture", alt_text='a "red" square'),),
        took_s=1.26,
    )
    return ReportRequest(title="Report", sections=(section,), path=str(tmp_path / "out" / "report.html"))


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    path = tmp_path / "red.png"
    Image.new("RGB", (20, 10), "red").save(path)
    return path


def test_page_is_self_contained_and_escaped(tmp_path: Path, picture: Path) -> None:
    written = write_report(request(tmp_path, picture), silent)
    page = Path(written.path).read_text(encoding="utf-8")
    assert (written.sections, written.images, written.size_bytes) == (1, 1, len(page.encode()))
    assert "<script" not in page
    assert page.count("&lt;script&gt;") == 5
    assert not re.search(r"(?:src|href)=\"(?!data:image/|#)", page)
    assert 'alt="a &#34;red&#34; square" width="20" height="10"' in page
    assert "1.3 s" in page


def test_page_is_the_same_bytes_again(tmp_path: Path, picture: Path) -> None:
    path = Path(write_report(request(tmp_path, picture), silent).path)
    first = path.read_bytes()
    assert Path(write_report(request(tmp_path, picture), silent).path).read_bytes() == first
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "text.png"
    text.write_text("no picture")
    with pytest.raises(UnsafeInput, match=r"text\.png is no PNG or GIF"):
        write_report(request(tmp_path, text), silent)


def test_a_missing_picture_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResourceFailure, match=r"gone\.png cannot be read"):
        write_report(request(tmp_path, tmp_path / "gone.png"), silent)
