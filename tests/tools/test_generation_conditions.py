"""Conditions of a call: what words mean, what they do to density and classes, what is refused, what recipes hold."""

import pytest

from plannerforge.engine.traffic import SPEED_FACTORS, heavy_factor, vehicles_per_lane_km
from plannerforge.engine.traffic.conditions import CAR_SHARES, HEAVY_SHARES
from plannerforge.schemas.errors import InvalidRequest, PlannerForgeError
from plannerforge.schemas.generation import (
    NATURAL_SHARES,
    WEATHERS,
    GenerateScenariosArguments,
    GenerationRequest,
    TrafficConditions,
    VehicleDemand,
)
from plannerforge.tools.generation.conditions import read_conditions, with_natural_mix


def arguments(*conditions: str, **others: object) -> GenerateScenariosArguments:
    return GenerateScenariosArguments.model_validate({"conditions": list(conditions), **others})


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ("rush hour", "17:30"),
        ("night", "02:30"),
        ("7:05", "07:05"),
        ("5pm", "17:00"),
        ("12am", "00:00"),
        ("9h30", "09:30"),
    ],
)
def test_times_are_read_as_people_write_them(text: str, time: str) -> None:
    read = read_conditions(arguments(f"time={text}")).conditions
    assert read is not None
    assert read.time == time


def test_the_hour_sets_the_density_unless_one_is_given() -> None:
    free, given = read_conditions(arguments("time=rush_hour")), read_conditions(arguments("time=17:30", density="low"))
    assert free.conditions is not None
    assert given.conditions is not None
    assert free.conditions.per_lane_km == vehicles_per_lane_km(17) == 26.5
    assert given.conditions.per_lane_km is None
    assert any("26.5 vehicles per lane-km" in note for note in free.notes)


def test_hours_rank_as_their_shares_of_the_day() -> None:
    hours = range(24)
    assert sum(CAR_SHARES) == pytest.approx(100, abs=2)
    assert sum(HEAVY_SHARES) == pytest.approx(100, abs=2)
    assert sorted(hours, key=vehicles_per_lane_km) == sorted(hours, key=lambda hour: CAR_SHARES[hour])
    assert heavy_factor(10) > 1.5 > 1 > heavy_factor(17)


def test_natural_traffic_has_the_classes_of_the_statistics_and_goods_of_the_hour() -> None:
    mixed = with_natural_mix(
        (VehicleDemand(vehicle_class="bus", least=2),), TrafficConditions(natural_mix=True, time="10:30")
    )
    shares = {demand.vehicle_class: demand.share for demand in mixed}
    assert set(shares) == set(NATURAL_SHARES)
    assert shares["bus"] is None, "what was counted stays as it was"
    assert shares["delivery"] == NATURAL_SHARES["delivery"]
    assert shares["truck"] == pytest.approx(NATURAL_SHARES["truck"] * heavy_factor(10), abs=1e-5)
    assert with_natural_mix(mixed, None) == mixed


def test_every_weather_is_told_with_what_it_does() -> None:
    for weather in WEATHERS:
        (note,) = read_conditions(arguments(f"weather={weather}")).notes
        assert ("slower" in note) is (weather in SPEED_FACTORS)
    assert read_conditions(arguments("weather=rain")).notes[0].startswith("'rain' is taken as light_rain")


@pytest.mark.parametrize(
    ("conditions", "named"),
    [
        (["density=4"], ["density is no condition", "time=…"]),
        (["time=25:00"], ["time=25:00 is no time", "rush_hour"]),
        (["weather=sunny"], ["no weather 'sunny'", "good"]),
        (["drivers=crazy"], ["no driver preset 'crazy'", "aggressive"]),
        (["mix=all"], ["mix=natural"]),
        (["time=night", "time=noon"], ["time stands twice"]),
        (["snow"], ["snow is no condition"]),
    ],
)
def test_what_cannot_be_meant_is_refused_with_what_can(conditions: list[str], named: list[str]) -> None:
    with pytest.raises(PlannerForgeError) as refusal:
        read_conditions(arguments(*conditions))
    assert [word for word in named if word not in refusal.value.text] == []


def test_all_faults_of_the_conditions_are_told_at_once() -> None:
    with pytest.raises(InvalidRequest) as refusal:
        read_conditions(arguments("time=99", "weather=sunny", "drivers=crazy"))
    assert all(word in refusal.value.text for word in ("time=99", "sunny", "crazy"))


def test_a_recipe_without_conditions_is_that_of_before() -> None:
    request = GenerationRequest(map_path="a", map_id="b", place="c", country=None, attribution="d", folder="e")
    assert "conditions" not in request.model_dump(mode="json")
    with_some = request.model_copy(update={"conditions": TrafficConditions(weather="snow")})
    assert with_some.model_dump(mode="json")["conditions"]["weather"] == "snow"
