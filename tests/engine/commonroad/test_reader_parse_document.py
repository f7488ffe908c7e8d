"""Parsing in one go refuses what the scan of every element refuses."""

from pathlib import Path

import pytest
from support.builders import town_road

from plannerforge.engine.commonroad.reader import XmlLimits, parse_document, scan_xml
from plannerforge.schemas.errors import UnsafeInput

HEAD = "<?xml version='1.0' encoding='UTF-8'?>"
DOCTYPE = "<!DOCTYPE a [<!ENTITY e 'text'>]><a>&e;</a>"
LIMITS = XmlLimits(size_bytes=5000, depth=6, elements=40, lanelets=3)

FILES: dict[str, bytes] = {
    "good": (HEAD + "<a><b/><lanelet/></a>").encode(),
    "no declaration": b"<a/>",
    "as deep as allowed": (HEAD + "<a>" * 6 + "</a>" * 6).encode(),
    "a level too deep": (HEAD + "<a>" * 7 + "</a>" * 7).encode(),
    "as many elements as allowed": (HEAD + "<a>" + "<b></b>" * 39 + "</a>").encode(),
    "an element too many": (HEAD + "<a>" + "<b></b>" * 40 + "</a>").encode(),
    "as many lanelets as allowed": (HEAD + "<a>" + "<lanelet/>" * 3 + "</a>").encode(),
    "a lanelet too many": (HEAD + "<a>" + "<lanelet/>" * 4 + "</a>").encode(),
    "lanelet only in names": (HEAD + "<a>" + "<laneletType/>" * 9 + "</a>").encode(),
    "too large": (HEAD + f"<a>{'x' * 5000}</a>").encode(),
    "a document type": (HEAD + DOCTYPE).encode(),
    "a document type in UTF-16": DOCTYPE.encode("utf-16"),
    "a document type in EBCDIC": ("<?xml version='1.0' encoding='cp037'?>" + DOCTYPE).encode("cp037"),
    "UTF-7": ("<?xml version='1.0' encoding='UTF-7'?>" + DOCTYPE.replace("<", "+ADw-")).encode(),
    "Latin-1": "<?xml version='1.0' encoding='ISO-8859-1'?><a>M\xfcnchen</a>".encode("latin-1"),
    "no UTF-8 in spite of its declaration": HEAD.encode() + b"<a>M\xfcnchen</a>",
    "truncated": (HEAD + "<a><b>").encode(),
    "empty": b"",
    "zeros": b"\0" * 100,
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_accepted_or_refused_as_by_the_scan(tmp_path: Path, name: str) -> None:
    path = tmp_path / "file.xml"
    path.write_bytes(FILES[name])
    try:
        expected = scan_xml(path, LIMITS).name
    except UnsafeInput:
        with pytest.raises(UnsafeInput, match=r"file\.xml"):
            parse_document(path, LIMITS)
    else:
        assert parse_document(path, LIMITS).tag == expected


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnsafeInput, match="cannot be read"):
        parse_document(tmp_path / "none.xml")


def test_the_whole_document_is_there(tmp_path: Path) -> None:
    root = parse_document(town_road().write(tmp_path / "town.xml"))
    assert len(root.findall("lanelet")) == 7
