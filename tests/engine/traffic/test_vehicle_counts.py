import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.traffic.vehicle_counts import FEWEST, MOST, VEHICLES_PER_LANE_KM, Demand, plan_counts
from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.generation import Density, VehicleDemand


def wish(name: str, least: int | None = None, most: int | None = None) -> VehicleDemand:
    return VehicleDemand(vehicle_class=name, least=least, most=most)


@given(
    density=st.sampled_from(["low", "medium", "high"]),
    names=st.lists(st.sampled_from(sorted(vehicle_classes())), unique=True, max_size=6),
    least=st.none() | st.integers(0, 12),
    lane_km=st.floats(0.1, 30),
)
def test_every_class_gets_its_requested_number_and_a_car_is_left_for_the_ego(
    density: Density, names: list[str], least: int | None, lane_km: float
) -> None:
    demand = plan_counts(density, [wish(name, least) for name in names], lane_km)
    for name in names:
        assert demand.counts.get(name, 0) >= (1 if least is None else least) + (name == "car")
    assert demand.counts["car"] >= 1
    assert demand.total >= min(max(round(VEHICLES_PER_LANE_KM[density] * lane_km), FEWEST), MOST)


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("density", ["low", "high"])
def test_a_counted_class_gets_that_many_and_a_named_one_a_share(density: Density, count: int) -> None:
    counted = plan_counts(density, [wish("truck", count)], 4.0)
    named = plan_counts(density, [wish("truck")], 4.0)
    assert counted.counts["truck"] == count
    assert named.counts["truck"] == round(0.2 * named.total) > 5
    assert counted.least == {"truck": count}
    assert named.least == {"truck": 1}


@pytest.mark.parametrize(("share", "buses"), [(0.0, 1), (0.0025, 1), (0.3, 42)])
def test_a_share_is_of_all_vehicles_and_one_at_least(share: float, buses: int) -> None:
    demand = plan_counts("high", [VehicleDemand(vehicle_class="bus", share=share)], 5.0)
    assert (demand.counts["bus"], demand.total, demand.least) == (buses, 140, {"bus": 1})


def test_a_large_site_gets_the_density_requested() -> None:
    for density, per_km in VEHICLES_PER_LANE_KM.items():
        assert plan_counts(density, [], 8.5).total == round(per_km * 8.5)


def test_an_exact_number_of_cars_does_not_count_the_ego() -> None:
    assert plan_counts("low", [wish("car", 4, 4)], 3.0).counts == {"car": 5}


def test_zero_of_a_class_means_zero() -> None:
    assert "bicycle" not in plan_counts("low", [wish("bicycle", 0, 0)], 3.0).counts


def test_an_unknown_class_is_refused_with_the_closest() -> None:
    with pytest.raises(UnknownName, match="trukc") as caught:
        plan_counts("low", [wish("trukc")], 3.0)
    assert caught.value.valid[0] == "truck"


def test_spare_vehicles_are_added_to_every_large_class_and_always_to_the_cars() -> None:
    demand = Demand({"car": 1, "truck": 100, "bus": 3}, {}, {})
    assert demand.with_spares(0.12, {}).counts == {"car": 13, "truck": 112, "bus": 3}
    assert demand.with_spares(0.12, {"bus": 4}).counts == {"car": 13, "truck": 112, "bus": 7}


def test_fewer_vehicles_are_still_as_many_as_the_request_needs() -> None:
    demand = Demand({"car": 40, "truck": 10, "bus": 3}, {"truck": 8, "bus": 1}, {})
    less = demand.fewer(0.5, "it is so")
    assert less.counts == {"car": 20, "truck": 8, "bus": 1}
    assert less.bounded_by == "it is so"
