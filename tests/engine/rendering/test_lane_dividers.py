"""Lines between lanes are drawn once, in dashes that do not depend on what part of the road is shown."""

from dataclasses import replace

import numpy as np
import pytest

from plannerforge.engine.rendering.content import LaneletShape, Viewport
from plannerforge.engine.rendering.road import dashes, dividers

EASTBOUND = np.linspace((0.0, 0.0), (200.0, 0.0), 21)


def beside_one_another(*, oncoming: bool, named_back: bool = True) -> list[LaneletShape]:
    """Lanelet 1 below the line y = 0 and 2 above it."""
    low, high = EASTBOUND - [0, 4], EASTBOUND + np.array([0, 4])
    first = LaneletShape(1, EASTBOUND, low, EASTBOUND - [0, 2], 2, None, inside_intersection=False)
    back = 1 if named_back else None
    if oncoming:
        lines = EASTBOUND[::-1], high[::-1], (EASTBOUND + np.array([0, 2]))[::-1]
        return [first, LaneletShape(2, *lines, back, None, inside_intersection=False)]
    return [
        first,
        LaneletShape(2, high, EASTBOUND, EASTBOUND + np.array([0, 2]), None, back, inside_intersection=False),
    ]


@pytest.mark.parametrize("oncoming", [True, False])
def test_a_common_border_of_two_lanelets_is_one_line(oncoming: bool) -> None:
    lanelets = beside_one_another(oncoming=oncoming)
    assert [line.tolist() for line in dividers(lanelets)] == [EASTBOUND.tolist()]
    assert len(list(dividers(lanelets[::-1]))) == 1


def test_a_border_is_kept_if_its_neighbour_is_missing_or_does_not_name_it() -> None:
    first, second = beside_one_another(oncoming=False)
    assert [len(list(dividers([one]))) for one in (first, second)] == [1, 1]
    assert len(list(dividers(beside_one_another(oncoming=False, named_back=False)))) == 1
    last = replace(second, lanelet_id=0), replace(first, left_neighbour=0)
    assert len(list(dividers(last))) == 1


def test_dashes_keep_their_place_in_every_part_of_the_road() -> None:
    west, east = Viewport(-10, -20, 90, 20), Viewport(50, -20, 150, 20)
    found = [{tuple(dash[0]) for dash in dashes([EASTBOUND], shown)} for shown in (west, east)]
    inside = [{begin for begin in begins if 51 < begin[0] < 88} for begins in found]
    assert inside[0] == inside[1] != set()


def test_dashes_follow_a_curve_and_leave_gaps() -> None:
    bend = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)])
    found = dashes([bend], Viewport(-50, -50, 50, 50))
    lengths = [np.linalg.norm(np.diff(dash, axis=0), axis=1).sum() for dash in found]
    assert np.allclose(lengths[:-1], 100 / 54)
    assert all(np.isclose(dash[:, 1], 0).all() or np.isclose(dash[:, 0], 10).all() or len(dash) == 3 for dash in found)
    assert sum(lengths) < 0.65 * 20
