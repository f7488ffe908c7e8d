"""A file that is split says the same as the whole, in reading and in writing; what bytes cannot tell is not split."""

from pathlib import Path

import pytest
from lxml import etree
from support.builders import crossing, driving, town_road

from plannerforge.engine.commonroad import plain_states, reader
from plannerforge.engine.commonroad.document import ScenarioDocument, SplitDocument
from plannerforge.engine.commonroad.reader import read_recorded

HEADER = b"<?xml version='1.0' encoding='UTF-8'?>\n"
OBSTACLE = b'<dynamicObstacle id="7"><type>car</type></dynamicObstacle>'


def document(inside: bytes, header: bytes = HEADER) -> bytes:
    return header + b'<commonRoad benchmarkID="A">' + inside + b"</commonRoad>"


def test_the_parts_together_are_the_file() -> None:
    content = document(b"\n <lanelet/>\n " + OBSTACLE + b"\n " + OBSTACLE.replace(b'"7"', b"'8'") + b"\n <x/>\n")
    split = SplitDocument.of(content)
    assert split is not None
    assert [chunk[:22] for chunk in split.chunks] == [b'<dynamicObstacle id="7', b"<dynamicObstacle id='8"]
    assert split.rest.count(b"type") == 0
    assert split.with_chunks(split.rest) == content


@pytest.mark.parametrize(
    "content",
    [
        document(b"<!-- " + OBSTACLE + b" -->"),
        document(b"<x><![CDATA[" + OBSTACLE + b"]]></x>"),
        document(OBSTACLE, header=HEADER + b"<!DOCTYPE x []>"),
        document(OBSTACLE + b"<?pi " + OBSTACLE + b"?>"),
        document(OBSTACLE, header=b"<?xml version='1.0' encoding='UTF-16'?>"),
        document(OBSTACLE, header=b""),
        document(b"\r\n" + OBSTACLE),
        document(OBSTACLE).replace(b"<commonRoad", b'<commonRoad xmlns="urn:x"'),
        document(b'<dynamicObstacle id="7" chunk="0"/>' + OBSTACLE),
        document(OBSTACLE).replace(b"<commonRoad", b'<commonRoad xmlns:x="urn:x"'),
        document(b'<obstacle id="900" chunk ="99"/>' + OBSTACLE),
    ],
    ids=[
        "comment",
        "cdata",
        "doctype",
        "instruction",
        "utf16",
        "undeclared",
        "return",
        "namespace",
        "stand_in",
        "prefix",
        "spaced",
    ],
)
def test_a_file_with_ambiguous_bytes_is_not_split(content: bytes) -> None:
    assert SplitDocument.of(content) is None


@pytest.mark.parametrize(
    "inside",
    [
        b'<dynamicObstacle id="7"/>',
        b"<dynamicObstacle><type>car</type></dynamicObstacle>",
        b'<dynamicObstacle id="7"><type id="9">car</type></dynamicObstacle>',
        b'<dynamicObstacle id="&#55;"><type>car</type></dynamicObstacle>',
        b'<dynamicObstacle id="7"><type>car</type>',
        b"""<dynamicObstacle note=' id="7"' id ="8"><type>car</type></dynamicObstacle>""",
        b'<dynamicObstacle id="7"><type>car</type></dynamicObstacle ><dynamicObstacle id ="8"></dynamicObstacle>',
        b'<obstacle id="7"><obstacle ref="8"/></obstacle>',
    ],
    ids=["empty", "no_id", "id_inside", "reference", "open", "id_in_text", "two_at_once", "nested"],
)
def test_an_obstacle_without_a_readable_id_is_not_split_off(inside: bytes) -> None:
    content = document(inside)
    split = SplitDocument.of(content)
    assert split is not None
    assert (split.chunks, split.rest) == ((), content)


def test_an_obstacle_of_the_other_format_is_passed_over_as_commonroad_io_does(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "town.xml")
    before = read_recorded(path).tracks[31].positions
    text = path.read_text(encoding="utf-8")
    begin, end = text.index('<dynamicObstacle id="31"'), text.index("</dynamicObstacle>") + len("</dynamicObstacle>")
    other = text[begin:end].replace("dynamicObstacle", "obstacle").replace('"31"', '"031"').replace("<x>", "<x>1")
    path.write_text(text.replace("</commonRoad>", f"{other}</commonRoad>"), encoding="utf-8")
    assert read_recorded(path).tracks[31].positions.tolist() == before.tolist()


def test_an_obstacle_inside_another_element_is_left_to_the_reader_of_the_whole(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "town.xml")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("</commonRoad>", f"<other>{OBSTACLE.decode()}</other></commonRoad>"), encoding="utf-8")
    assert reader._split_document(path.read_bytes(), reader.XmlLimits()) is None
    assert 7 not in read_recorded(path).tracks


def test_an_obstacle_inside_an_obstacle_is_read_and_written_as_a_whole(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "town.xml")
    text = path.read_text(encoding="utf-8")
    nested = text.replace("<type>car</type>", f"<type>car</type>{OBSTACLE.decode()}", 1)
    assert nested != text
    path.write_text(nested, encoding="utf-8")
    assert SplitDocument.of(path.read_bytes()) is not None
    assert sorted(read_recorded(path).tracks) == [31, 32, 33, 34, 35]
    assert _written(path, tmp_path) == _written_by_libxml2(path)


def test_an_obstacle_that_was_read_before_is_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    town = town_road()
    read_recorded(town.write(tmp_path / "base.xml"))
    looked_at: list[str] = []

    def noting(obstacle: bytes) -> tuple[int, plain_states.PlainStates, bytes] | None:
        looked_at.append(str(etree.fromstring(obstacle).get("id")))
        return plain_states.cut_states(obstacle)

    monkeypatch.setattr(reader, "cut_states", noting)
    more = town.with_vehicles(*town.vehicles, driving(77, (10, 3.5), 9.0, 30))
    assert 77 in read_recorded(more.write(tmp_path / "more.xml")).tracks
    assert looked_at == ["77"]


def test_a_large_obstacle_is_read_but_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "LARGEST_KEPT_BYTES", 10)
    reader.forget_obstacles()
    assert 31 in read_recorded(town_road().write(tmp_path / "base.xml")).tracks
    assert reader._known_obstacle.cache_info().currsize == 0


@pytest.mark.parametrize("name", ["town", "crossing"])
def test_an_untouched_document_is_written_as_libxml2_writes_it(tmp_path: Path, name: str) -> None:
    path = {"town": town_road, "crossing": crossing}[name]().write(tmp_path / "base.xml")
    assert _written(path, tmp_path) == _written_by_libxml2(path)


def test_untouched_documents_of_public_files_are_written_as_libxml2_writes_them(
    shared_data: Path, tmp_path: Path
) -> None:
    files = sorted((shared_data / "data" / "commonroad").glob("*.xml"))[::8]
    assert len(files) > 20
    for path in files:
        assert _written(path, tmp_path) == _written_by_libxml2(path), path.name


def test_an_obstacle_is_complete_once_it_is_requested(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "base.xml")
    written = ScenarioDocument.read(path)
    states = written.obstacle(31).findall("trajectory/state")
    assert len(states) == 150
    written.obstacle(31).find("type").text = "bus"  # type: ignore[union-attr]
    written.remove(written.obstacle(33))
    written.write(tmp_path / "written.xml", "ZAM_A-1_1_T-1")
    tracks = read_recorded(tmp_path / "written.xml").tracks
    assert sorted(tracks) == [31, 32, 34, 35]
    assert tracks[31].kind == "bus"


def _written(path: Path, folder: Path) -> bytes:
    document = ScenarioDocument.read(path)
    document.write(folder / "written.xml", "ZAM_A-1_1_T-1")
    return (folder / "written.xml").read_bytes()


def _written_by_libxml2(path: Path) -> bytes:
    tree = etree.parse(path)
    tree.getroot().set("benchmarkID", "ZAM_A-1_1_T-1")
    return etree.tostring(tree, xml_declaration=True, encoding="UTF-8")
