"""Conditions in what is made: the file's environment, and how vehicles drive."""

import pytest
from lxml import etree

from plannerforge.engine.generation.writer import ScenarioMetadata, write_location
from plannerforge.engine.traffic.simulation import DrivingStyle, _vehicle_type
from plannerforge.engine.vehicles import vehicle_classes
from plannerforge.schemas.generation import WEATHERS, TrafficConditions, Weather
from plannerforge.schemas.vocabulary import ROAD_FRICTIONS, WEATHER_ROADS


def location(conditions: TrafficConditions | None) -> etree._Element:
    root = etree.Element("commonRoad")
    write_location(root, ScenarioMetadata("ZAM_A-1_1_T-1", "", "", 48.1, 11.6, "", (0.0, 0.0), (), None, conditions))
    (found,) = root
    return found


@pytest.mark.parametrize("weather", WEATHERS)
def test_commonroad_io_reads_the_time_and_weather_that_are_written(weather: Weather) -> None:
    from commonroad.common.reader.file_reader_xml import LocationFactory

    root = etree.Element("commonRoad")
    root.append(location(TrafficConditions(weather=weather, time="23:15")))
    read = LocationFactory.create_from_xml_node(root).environment
    assert (read.weather.value, read.time_of_day.value) == (weather, "night")
    assert (read.time.hours, read.time.minutes) == (23, 15)


@pytest.mark.parametrize("conditions", [None, TrafficConditions(time="17:30"), TrafficConditions(drivers="aggressive")])
def test_good_weather_is_left_out_because_no_word_for_it_is_common(conditions: TrafficConditions | None) -> None:
    assert location(conditions).find("environment") is None


def test_the_usual_style_is_the_type_of_before() -> None:
    usual = _vehicle_type(vehicle_classes()["car"], DrivingStyle())
    assert 'speedFactor="normc(0.95,0.08,0.75,1.1)"' in usual
    assert 'accel="2.6" decel="4.5" minGap="2.5" maxSpeed="55.6"' in usual


def test_bad_weather_and_drivers_change_speeds_and_gaps_together() -> None:
    style = DrivingStyle(0.9, {"speedFactor": 1.2, "tau": 0.7, "minGap": 1.0})
    car, bicycle = (_vehicle_type(vehicle_classes()[name], style) for name in ("car", "bicycle"))
    assert 'speedFactor="normc(1.026,0.0864,0.81,1.188)"' in car
    assert 'minGap="1"' in car
    assert 'tau="0.7"' in car
    assert 'minGap="0.5"' in bicycle, "it stands closer by its nature"


def test_environments_follow_the_schema() -> None:
    words = [element.tag for element in location(TrafficConditions(weather="fog"))[-1]]
    assert words == ["time", "timeOfDay", "weather", "underground"]


def test_no_driver_accelerates_or_brakes_harder_than_tyres_hold() -> None:
    car, moped = (_vehicle_type(vehicle_classes()[name], DrivingStyle(friction=0.2)) for name in ("car", "moped"))
    assert 'accel="1.962" decel="1.962"' in car
    assert 'emergencyDecel="1.962"' in car
    assert 'accel="1.1"' in moped, "it is no stronger on any road"


def test_a_weather_states_the_friction_that_is_known_for_it() -> None:
    known = {weather: TrafficConditions(weather=weather).friction for weather in WEATHERS}
    assert {weather for weather, friction in known.items() if friction is not None} == set(WEATHER_ROADS)
    assert known["snow"] == ROAD_FRICTIONS["snow"]
    assert TrafficConditions(time="17:30").friction is None
