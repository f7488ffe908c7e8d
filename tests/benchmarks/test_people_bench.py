"""The judge of people in written files: it sees who is off the pavement, who is hit, and cars that do not give way."""

from copy import deepcopy
from pathlib import Path

import pytest
from lxml import etree
from support.generation import make

from benchmarks.maps.people import judge_file
from plannerforge.schemas.generation import VehicleDemand

Element = etree._Element


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Element:
    """A file with three people and a bicycle, as an element."""
    folder = tmp_path_factory.mktemp("judged")
    wish = [VehicleDemand(vehicle_class=name, least=least) for name, least in (("pedestrian", 3), ("bicycle", 1))]
    make("Musterstadt", folder, scenario_type="urban", vehicles=wish)
    return etree.parse(folder / "scenario.xml").getroot()


def judged(root: Element, folder: Path) -> dict[str, int]:
    path = folder / "scenario.xml"
    path.write_bytes(etree.tostring(root))
    return dict(judge_file(path))


def of_kind(root: Element, kind: str) -> list[Element]:
    return [one for one in root.iterfind("dynamicObstacle") if one.findtext("type") == kind]


def test_generated_pedestrians_are_on_their_paths(root: Element, tmp_path: Path) -> None:
    counts = judged(root, tmp_path)
    assert counts["pedestrians"] == 3
    assert counts["on_ways"] >= 0.99 * counts["positions"]
    assert counts["overlaps"] == 0


def test_a_person_moved_off_the_pavement_counts_as_off(root: Element, tmp_path: Path) -> None:
    moved = deepcopy(root)
    places = list(of_kind(moved, "pedestrian")[0].iter("x"))
    for place in places:
        place.text = str(float(place.text or "") + 300.0)
    before, after = judged(root, tmp_path), judged(moved, tmp_path)
    assert before["on_ways"] - after["on_ways"] >= 0.9 * len(places)


def test_a_person_in_the_place_of_a_car_overlaps_it(root: Element, tmp_path: Path) -> None:
    moved = deepcopy(root)
    person, car = of_kind(moved, "pedestrian")[0], of_kind(moved, "car")[0]
    for tag in ("initialState", "trajectory"):
        old = person.find(tag)
        assert old is not None
        person.replace(old, deepcopy(car.find(tag)))
    assert judged(moved, tmp_path)["overlaps"] >= 1


def test_a_car_that_drives_over_a_crossing_with_a_person_on_it_has_not_yielded(tmp_path: Path) -> None:
    states = "".join(
        f"<{tag}><position><point><x>{{x{step}}}</x><y>{{y{step}}}</y></point></position><orientation><exact>{{turn}}"
        f"</exact></orientation><velocity><exact>{{speed}}</exact></velocity></{tag}>"
        for step, tag in enumerate(["initialState", *["state"] * 40])
    )

    def obstacle(key: int, kind: str, size: tuple[float, float], line: list[tuple[float, float]], turn: float) -> str:
        values = {f"x{k}": x for k, (x, _) in enumerate(line)} | {f"y{k}": y for k, (_, y) in enumerate(line)}
        moved = states.format(**values, turn=turn, speed=5.0).replace("</initialState>", "</initialState><trajectory>")
        return (
            f'<dynamicObstacle id="{key}"><type>{kind}</type><shape><rectangle><length>{size[0]}</length><width>'
            f"{size[1]}</width></rectangle></shape>{moved}</trajectory></dynamicObstacle>"
        )

    def bound(tag: str, points: list[tuple[float, float]]) -> str:
        return f"<{tag}>{''.join(f'<point><x>{x}</x><y>{y}</y></point>' for x, y in points)}</{tag}>"

    crossing = (
        f'<lanelet id="1">{bound("leftBound", [(-2, -4), (-2, 4)])}{bound("rightBound", [(2, -4), (2, 4)])}'
        "<laneletType>crosswalk</laneletType><userBidirectional>pedestrian</userBidirectional></lanelet>"
    )
    person = obstacle(2, "pedestrian", (0.5, 0.6), [(0.0, -3.5 + 0.14 * k) for k in range(41)], 1.5708)

    def counts(behind_m: float) -> dict[str, int]:
        car = obstacle(3, "car", (4.5, 1.8), [(-behind_m + 0.8 * k, 0.0) for k in range(41)], 0.0)
        path = tmp_path / "scenario.xml"
        path.write_text(f"<commonRoad>{crossing}{person}{car}</commonRoad>")
        return dict(judge_file(path))

    hit, close, late = counts(20.0), counts(14.0), counts(31.0)
    assert (hit["encounters"], hit.get("yielded", 0), hit["overlaps"]) == (1, 0, 1)
    assert (close["encounters"], close.get("yielded", 0)) == (1, 0)
    assert late.get("overlaps", 0) == 0
