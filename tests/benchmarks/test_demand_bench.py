"""The judge of drivers in written files reads free speeds over the limit, and gaps behind others, as they are."""

from pathlib import Path

import pytest

from benchmarks.maps.demand import judge_file

ROAD = (
    "<lanelet id='1'><leftBound><point><x>-50</x><y>2</y></point><point><x>3000</x><y>2</y></point></leftBound>"
    "<rightBound><point><x>-50</x><y>-2</y></point><point><x>3000</x><y>-2</y></point></rightBound>"
    "<trafficSignRef ref='2'/></lanelet><trafficSign id='2'><trafficSignElement><trafficSignID>274</trafficSignID>"
    "<additionalValue>30.0</additionalValue></trafficSignElement></trafficSign>"
)


def car(key: int, begin_m: float, speed_mps: float, gain_mps: float = 0.0) -> str:
    """A car that drives east for 6 s, its speed growing by so much each second."""
    states = [(begin_m + speed_mps * 0.1 * step, speed_mps + gain_mps * 0.1 * step) for step in range(61)]
    first, *others = (
        f"<position><point><x>{x}</x><y>0</y></point></position><orientation><exact>0</exact></orientation>"
        f"<velocity><exact>{speed}</exact></velocity>"
        for x, speed in states
    )
    trajectory = "".join(f"<state>{state}</state>" for state in others)
    return (
        f"<dynamicObstacle id='{key}'><type>car</type><shape><rectangle><length>4.5</length><width>1.8</width>"
        f"</rectangle></shape><initialState>{first}</initialState><trajectory>{trajectory}</trajectory></dynamicObstacle>"
    )


def judged(folder: Path, *cars: str) -> tuple[list[float], list[float]]:
    path = folder / "scenario.xml"
    path.write_text(f"<commonRoad>{ROAD}{''.join(cars)}</commonRoad>")
    driving = judge_file(path)
    return list(driving.factors), list(driving.gaps_s)


def test_a_car_alone_is_free_and_the_one_behind_follows(tmp_path: Path) -> None:
    factors, gaps_s = judged(tmp_path, car(10, 100.0, 27.0), car(11, 61.5, 27.0))
    assert factors == [pytest.approx(0.9)]
    assert gaps_s == [pytest.approx((38.5 - 4.5 - 2.5) / 27.0)]


@pytest.mark.parametrize(
    "second",
    [car(11, 61.5, 28.0), car(11, 0.0, 27.0), car(11, 61.5, 27.0, gain_mps=1.0)],
    ids=["nears", "far", "gains"],
)
def test_a_car_that_nears_is_far_or_changes_speed_does_not_follow(tmp_path: Path, second: str) -> None:
    assert judged(tmp_path, car(10, 100.0, 27.0), second)[1] == []


def test_a_car_that_changes_its_speed_has_no_free_speed(tmp_path: Path) -> None:
    assert judged(tmp_path, car(10, 100.0, 27.0, gain_mps=1.0)) == ([], [])
