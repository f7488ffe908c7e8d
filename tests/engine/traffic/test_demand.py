import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.traffic.demand import FEWEST, MOST, VEHICLES_PER_LANE_KM, plan_counts
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.generation import Density, VehicleDemand


@given(
    density=st.sampled_from(["low", "medium", "high"]),
    names=st.lists(st.sampled_from(sorted(vehicle_classes())), unique=True, max_size=6),
    least=st.integers(0, 12),
    lane_km=st.floats(0.1, 9),
)
def test_every_class_gets_at_least_what_was_asked_and_a_car_is_left_for_the_ego(
    density: Density, names: list[str], least: int, lane_km: float
) -> None:
    demand = plan_counts(density, [VehicleDemand(vehicle_class=name, least=least) for name in names], lane_km)
    for name in names:
        assert demand.counts.get(name, 0) >= least + (name == "car")
    assert demand.counts["car"] >= 1
    assert demand.total >= min(max(round(VEHICLES_PER_LANE_KM[density] * lane_km), FEWEST), MOST)


def test_an_exact_number_of_cars_does_not_count_the_ego() -> None:
    demand = plan_counts("low", [VehicleDemand(vehicle_class="car", least=4, most=4)], 3.0)
    assert demand.counts == {"car": 5}


def test_none_of_a_class_means_none() -> None:
    demand = plan_counts("low", [VehicleDemand(vehicle_class="bicycle", least=0, most=0)], 3.0)
    assert "bicycle" not in demand.counts


def test_an_unknown_class_is_refused_with_the_closest() -> None:
    with pytest.raises(UnknownName, match="truk") as caught:
        plan_counts("low", [VehicleDemand(vehicle_class="truk")], 3.0)
    assert caught.value.valid[0] == "truck"
