"""The laws of docs/symmetries.md on a few small files: all relations, the judges that simulate nothing."""

from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from support.builders import town_road

from benchmarks.symmetries.answers import CHEAP, TranslatedFile
from benchmarks.symmetries.cases import DOCUMENT, Task, alike, measure
from benchmarks.symmetries.relations import RELATIONS, Frame, read_root, write_root
from plannerforge.engine.commonroad.document import schema_errors

FILES = ("ZAM_Zip-1_1_T-1", "DEU_Moelln-7_1_T-1")
JUDGES = (*CHEAP, DOCUMENT)


def broken(path: Path, relation: str, judges: tuple[str, ...] = JUDGES, seed: int = 3) -> list[str]:
    cases = measure(Task(path, seed, {relation: judges}))
    return [f"{case.judge}: {difference}" for case in cases for difference in case.differences]


@pytest.mark.parametrize("relation", RELATIONS)
def test_a_town_road_is_invariant(relation: str, tmp_path: Path) -> None:
    assert broken(town_road().write(tmp_path / "town.xml"), relation, (*JUDGES, "checks", "description")) == []


@pytest.mark.parametrize("relation", RELATIONS)
def test_real_files_are_invariant(relation: str, shared_data: Path) -> None:
    folder = shared_data / "data" / "commonroad"
    assert [text for name in FILES for text in broken(folder / f"{name}.xml", relation)] == []


@pytest.mark.parametrize("relation", ["moved", "turned", "mirrored"])
def test_points_and_headings_come_back(relation: str, tmp_path: Path) -> None:
    root = read_root(town_road().write(tmp_path / "town.xml"))
    changed, frame = RELATIONS[relation].applied(root, "any")

    def points(tree: etree._Element) -> np.ndarray:
        return np.array([[float(p.findtext("x", "")), float(p.findtext("y", ""))] for p in tree.iter("point")])

    if relation != "mirrored":  # there the bounds change their order
        assert np.allclose(frame.points(points(changed)), points(root), atol=1e-9)
    assert not np.allclose(points(changed), points(root), atol=0.1)


def test_the_judges_see_a_car_that_is_a_metre_off(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "town.xml")
    root = read_root(path)
    place = root.find("dynamicObstacle/initialState/position/point/x")
    assert place is not None
    place.text = str(float(place.text or "") + 1.0)
    write_root(root, tmp_path / "off.xml")
    before, after = (CHEAP["recording"](TranslatedFile(one, Frame())) for one in (path, tmp_path / "off.xml"))
    assert not all(alike(before[key], after[key], 0.1) for key in before)


def test_figures_are_alike_within_the_law_and_words_exactly() -> None:
    assert alike(1.0, 1.0 + 1e-7, 1e-6)
    assert not alike(1.0, 1.0 + 1e-7, 0.0)
    assert alike({"a"}, {"a"}, 0.0)
    assert not alike((1, 2), (1, 3), 10.0)
    assert not alike(None, 0.0, 10.0)
    assert alike(np.array([1.0, np.nan]), np.array([1.0, np.nan]), 0.0)


def test_rewritten_files_are_still_valid(shared_data: Path, tmp_path: Path) -> None:
    root = read_root(shared_data / "data" / "commonroad" / "DEU_Moelln-7_1_T-1.xml")
    write_root(root, tmp_path / "first.xml")
    known = set(schema_errors(tmp_path / "first.xml"))
    for relation in set(RELATIONS) - {"later", "other_format"}:
        write_root(RELATIONS[relation].applied(root, "any")[0], tmp_path / "changed.xml")
        assert set(schema_errors(tmp_path / "changed.xml")) <= known, relation
