"""Published calibrations: they give back the figures of their sources, and act on the classes that they hold for."""

import statistics
from statistics import NormalDist

import pytest
from lxml import etree

from plannerforge.engine.traffic.conditions import Spread, published_calibrations, time_gaps_s
from plannerforge.engine.traffic.simulation import DrivingStyle, _vehicle_type
from plannerforge.engine.vehicles import vehicle_classes

BRITISH = [("gb_30mph", 30, 0.50, 0.05), ("gb_rural", 60, 0.11, 0.01), ("gb_motorway", 70, 0.45, 0.08)]


def types(name: str, *calibrations: str, speed_factor: float = 1.0) -> list[etree._Element]:
    """SUMO's types of a class whose drivers are calibrated."""
    known = published_calibrations()
    style = DrivingStyle(speed_factor, calibrations=tuple(known[one] for one in calibrations))
    return list(etree.fromstring(_vehicle_type(vehicle_classes()[name], style)).iter("vType"))


@pytest.mark.parametrize(("name", "limit_mph", "over", "far_over"), BRITISH)
def test_british_speeds_have_the_shares_that_were_counted(
    name: str, limit_mph: float, over: float, far_over: float
) -> None:
    factor = published_calibrations()[name].speed_factor
    assert factor is not None
    speeds_mph = NormalDist(factor.mean * limit_mph, factor.deviation * limit_mph)
    assert 1 - speeds_mph.cdf(limit_mph) == pytest.approx(over)
    assert 1 - speeds_mph.cdf(limit_mph + 10) == pytest.approx(far_over)


def test_time_gaps_have_the_mean_and_nearly_the_deviation_of_the_source() -> None:
    gaps_s = time_gaps_s(Spread(1.1, 0.42))
    assert sorted(gaps_s) == list(gaps_s)
    assert statistics.fmean(gaps_s) == pytest.approx(1.1, abs=0.01)
    assert statistics.pstdev(gaps_s) == pytest.approx(0.42, abs=0.04), "the ends of the tails are missing"


def test_every_calibration_names_its_source_with_the_year_and_sets_something() -> None:
    for name, calibration in published_calibrations().items():
        assert calibration.parameter_names, name
        assert calibration.classes <= set(vehicle_classes()), name
        assert any(year in calibration.source for year in ("2019", "2022", "2024")), name


def test_drivers_with_their_own_gaps_are_their_own_types() -> None:
    cars = types("car", "m25_gaps", "gb_motorway")
    assert len({car.get("tau") for car in cars}) == len(cars) == 20
    assert {car.get("accel") for car in cars} == {"2.6"}, "what the source does not say stays as usual"
    assert {car.get("speedFactor") for car in cars} == {"normc(0.985969,0.111659,0.762652,1.20929)"}


def test_a_class_that_was_not_measured_drives_as_usual() -> None:
    (bicycle,) = types("bicycle", "m25_gaps", "gb_motorway", "highd")
    (usual,) = types("bicycle")
    assert bicycle.attrib == usual.attrib
    assert types("truck", "gb_motorway")[0].get("speedFactor") == usual.get("speedFactor")


def test_bad_weather_slows_calibrated_drivers_too() -> None:
    (car,) = types("car", "gb_30mph", speed_factor=0.87)
    assert (car.get("speedFactor") or "").startswith("normc(0.87,0.17630")


def test_types_of_a_class_are_a_distribution_under_its_name() -> None:
    style = DrivingStyle(calibrations=(published_calibrations()["m25_gaps"],))
    element = etree.fromstring(_vehicle_type(vehicle_classes()["car"], style))
    assert (element.tag, element.get("id")) == ("vTypeDistribution", "car")
