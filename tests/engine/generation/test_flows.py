"""Traffic by counts: routes carry what was counted, and what cannot be is told."""

import random
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.generation import make
from support.generation_bench import Road, made

from plannerforge.engine.generation.flows import FlowTrips, RouteFlow, plan_flows
from plannerforge.engine.vehicles import vehicle_classes
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import RoadFlow, TrafficConditions

WEST, EAST, NORTH, SOUTH = (-100.0, 0.0), (100.0, 0.0), (0.0, 100.0), (0.0, -100.0)
CROSSING = [
    Road("1#0", "w", "m", [WEST, (0, 0)], name="Long Street"),
    Road("1#1", "m", "e", [(0, 0), EAST], name="Long Street"),
    Road("2#0", "s", "m", [SOUTH, (0, 0)], name="Cross Lane"),
    Road("2#1", "m", "n", [(0, 0), NORTH], name="Cross Lane"),
]
NET = made(CROSSING, [("1#0", "1#1"), ("1#0", "2#1"), ("2#0", "2#1"), ("2#0", "1#1")]).net
CAR = vehicle_classes()["car"]


def carried(routes: tuple[RouteFlow, ...], edge: str) -> float:
    return sum(route.per_h for route in routes if edge in route.edges)


@given(*[st.floats(50, 900)] * 3)
def test_routes_carry_every_flow_if_counts_agree(straight: float, turning: float, crossing: float) -> None:
    entering, leaving = straight + turning, straight
    flows = [RoadFlow(road="1", direction="east", per_h=entering)]
    plan = plan_flows([*flows, RoadFlow(road="2", per_h=crossing)], NET, random.Random(1))
    assert leaving > 0
    assert carried(plan.routes, "2#0") == pytest.approx(carried(plan.routes, "2#1"), rel=0.35)
    for road in plan.roads:
        at_sections = [sum(r.per_h for r in plan.routes if section & set(r.edges)) for section in road.sections]
        assert road.planned_per_h == pytest.approx(sum(at_sections) / len(at_sections))
    assert all(route.per_h > 0 for route in plan.routes)


def test_one_counted_road_gets_its_flow() -> None:
    plan = plan_flows([RoadFlow(road="Long Street", per_h=600)], NET, random.Random(1))
    assert plan.roads[0].planned_per_h == pytest.approx(600, rel=0.01)
    assert carried(plan.routes, "1#0") == pytest.approx(600, rel=0.01)
    assert carried(plan.routes, "1#1") == pytest.approx(600, rel=0.01)


def test_vehicles_at_a_moment_follow_from_flow_and_travel_time() -> None:
    plan = plan_flows([RoadFlow(road="west", to="east", per_h=1800)], NET, random.Random(1))
    (route,) = plan.routes
    assert route.edges == ("1#0", "1#1")
    assert route.travel_s == pytest.approx(200 / 10.0)
    assert plan.vehicles == 10


def test_an_origin_is_a_direction_or_a_road() -> None:
    for origin, destination in (("South", "Cross Lane"), ("2", "north"), ("cross lane", "north")):
        (route,) = plan_flows([RoadFlow(road=origin, to=destination, per_h=90)], NET, random.Random(1)).routes
        assert route.edges == ("2#0", "2#1")


def test_a_count_of_one_direction_leaves_the_other_alone() -> None:
    both = [*CROSSING, Road("-1#0", "m", "w", [(0, 0), WEST], name="Long Street")]
    net = made(both, [("1#0", "1#1"), ("2#0", "-1#0"), ("2#0", "2#1")]).net
    plan = plan_flows([RoadFlow(road="1", direction="west", per_h=300)], net, random.Random(1))
    assert carried(plan.routes, "-1#0") == pytest.approx(300, rel=0.01)
    assert carried(plan.routes, "1#0") == 0


@pytest.mark.parametrize(
    ("flow", "named"),
    [
        (RoadFlow(road="Elm Street", per_h=5), ["Elm Street", "Cross Lane", "Long Street"]),
        (RoadFlow(road="north", to="south", per_h=5), ["north to south"]),
        (RoadFlow(road="1", direction="west", per_h=5), ["1 (westbound)"]),
    ],
)
def test_a_flow_that_no_road_carries_is_refused_with_the_roads(flow: RoadFlow, named: list[str]) -> None:
    with pytest.raises(NotPossible) as refusal:
        plan_flows([flow], NET, random.Random(1))
    assert [word for word in named if word not in refusal.value.text] == []


def test_trips_begin_all_along_the_routes_by_the_vehicles_on_them() -> None:
    plan = plan_flows(
        [RoadFlow(road="west", to="east", per_h=900), RoadFlow(road="south", to="north", per_h=100)],
        NET,
        random.Random(1),
    )
    trips = FlowTrips(NET, 30.0, random.Random(2), plan)
    counts = Counter(trips.trip(CAR) for _ in range(2000))
    assert counts.keys() == {("1#0", "1#1"), ("1#1",), ("2#0", "2#1"), ("2#1",)}
    assert counts["1#0", "1#1"] / 2000 == pytest.approx(0.45, abs=0.05)
    assert (counts["2#0", "2#1"] + counts["2#1",]) / 2000 == pytest.approx(0.1, abs=0.03)


def test_a_counted_street_of_a_generated_scenario_carries_its_flow(tmp_path: Path) -> None:
    conditions = TrafficConditions(flows=(RoadFlow(road="Ostallee", per_h=900), RoadFlow(road="Nowhere", per_h=5)))
    scenario = make(
        "Kreiselheim", tmp_path, scenario_type="intersection", streets=(("Ostallee",),), conditions=conditions
    )
    counted, missing = (note for note in scenario.notes if "an hour counted" in note)
    assert counted.startswith("Ostallee: 900 vehicles an hour counted, ")
    assert missing == "Nowhere: 5 vehicles an hour counted, but no such road carries cars at this site"
    assert scenario.density.requested == "counts"
    assert scenario.vehicles_realised == pytest.approx(scenario.vehicles_asked, abs=2)
