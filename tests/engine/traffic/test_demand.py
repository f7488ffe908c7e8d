"""How far vehicles can drive on from an edge: on rings as far as they like, in a time that grows with the edges."""

import random

from support.generation_bench import Road, made

from plannerforge.engine.traffic.demand import TripMaker
from plannerforge.engine.vehicles import vehicle_classes


def begins(roads: list[Road], links: list[tuple[str, str]], trips: int = 400) -> dict[str, int]:
    """How often trips begin on each edge, out of so many."""
    maker = TripMaker(made(roads, links).net, 30.0, random.Random(1))
    starts = [maker.trip(vehicle_classes()["car"])[0] for _ in range(trips)]
    return {road.key: starts.count(road.key) for road in roads}


def test_more_trips_begin_before_a_ring_than_before_a_dead_end() -> None:
    before = [Road("in", "a", "b", [(0, 0), (50, 0)]), Road("dead", "x", "y", [(0, 99), (50, 99)])]
    ring = [Road("one", "b", "c", [(50, 0), (60, 9)]), Road("two", "c", "b", [(60, 9), (50, 0)])]
    counts = begins([*before, *ring], [("in", "one"), ("one", "two"), ("two", "one")])
    assert counts["in"] > 3 * counts["dead"]


def test_more_trips_begin_at_the_beginning_of_a_route_than_at_its_end() -> None:
    roads = [Road(f"r{n}", f"j{n}", f"j{n + 1}", [(100 * n, 0), (100 * n + 100, 0)]) for n in range(4)]
    counts = begins(roads, [(f"r{n}", f"r{n + 1}") for n in range(3)])
    assert counts["r0"] > 2 * counts["r3"] > 0
