"""The table of the ego's classes on the planners' page is the one that holds."""

from pathlib import Path

import pytest

from plannerforge.engine.vehicles.models import EgoClass, ego_classes

PAGE = (Path(__file__).parents[1] / "docs" / "planners.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("known", ego_classes().values(), ids=list(ego_classes()))
def test_the_page_has_the_vehicle_of_a_class(known: EgoClass) -> None:
    (row,) = [line for line in PAGE.splitlines() if line.startswith(f"| `{known.name}` | ") and "×" in line]
    vehicle = known.vehicle
    assert [cell.strip() for cell in row.split("|")[2:-1]] == [
        f"{vehicle.length_m:g} × {vehicle.width_m:g} m",
        f"{vehicle.wheelbase_m:.4g}, {vehicle.rear_axle_behind_center_m:.4g} m",
        f"{vehicle.maximum_acceleration_mps2:g} m/s²",
        f"{vehicle.maximum_speed_mps:g} m/s",
        f"{vehicle.switching_speed_mps:.4g} m/s",
        f"{round(vehicle.maximum_steering_rad, 3):g} rad, {vehicle.maximum_steering_rate_radps:g} rad/s",
    ]
