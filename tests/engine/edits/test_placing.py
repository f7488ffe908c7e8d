"""Where added vehicles are put, and how fast they enter there."""

from dataclasses import replace

import numpy as np
import pytest
from builders import driving, town_road
from edit_support import Apply

SHORT = town_road().cut(31)
CAR = {"op": "add_vehicle", "vehicle_class": "car"}


@pytest.mark.parametrize(("x_m", "is_held"), [(180.0, False), (137.0, True)])
def test_a_parked_vehicle_slows_down_whom_it_stands_ahead_of_only(apply: Apply, x_m: float, is_held: bool) -> None:
    empty = replace(SHORT, vehicles=(driving(31, (70, 0), 10.0, 31),))
    parked = replace(empty, parked=(driving(50, (x_m, 7.0), 0.0, 1, heading_rad=np.pi),))
    middle = CAR | {"at": "3", "position": "middle"}
    free, beside = (
        float(apply(middle, builder=builder).tracks()[101].speeds_mps[0]) for builder in (empty, parked)
    )
    assert beside > 5.0
    assert (beside < free) is is_held
