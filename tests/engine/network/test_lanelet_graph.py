"""Searches in graphs: routes and costs are the least, and of equal routes the one with the lower ids is taken."""

from itertools import pairwise, permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.network.lanelet_graph import LANE_CHANGE_COST_M, Digraph, LaneletGraph

Steps = dict[int, dict[int, int]]
NODES = range(5)
GRAPHS = st.fixed_dictionaries({node: st.dictionaries(st.sampled_from(NODES), st.integers(0, 4)) for node in NODES})


def graph_of(steps: Steps) -> Digraph[int]:
    return Digraph(lambda node: [(after, float(cost)) for after, cost in steps[node].items()])


def routes(steps: Steps, start: int, goal: int) -> list[tuple[int, ...]]:
    """All routes without a repeated node."""
    inner = [node for node in NODES if node not in (start, goal)]
    between = [way for count in range(len(inner) + 1) for way in permutations(inner, count)]
    all_routes = [(start, *way, goal) for way in between] if start != goal else [(start,)]
    return [way for way in all_routes if all(after in steps[node] for node, after in pairwise(way))]


def cost_of(steps: Steps, way: tuple[int, ...]) -> int:
    return sum(steps[node][after] for node, after in pairwise(way))


@given(GRAPHS, st.sampled_from(NODES), st.sampled_from(NODES))
def test_searches_agree_with_trying_all_routes(steps: Steps, start: int, goal: int) -> None:
    graph, possible = graph_of(steps), routes(steps, start, goal)
    assert (goal in graph.reachable([start])) == bool(possible)
    cheapest, shortest = graph.cheapest_route([start], [goal]), graph.fewest_steps_route(start, goal)
    if not possible:
        assert cheapest is None
        assert shortest is None
        assert goal not in graph.costs({start: 0.0})
        return
    least = min(cost_of(steps, way) for way in possible)
    assert cheapest in possible
    assert cost_of(steps, cheapest) == least == graph.costs({start: 0.0})[goal]
    assert shortest in possible
    assert len(shortest) == min(map(len, possible)) == graph.reachable([start])[goal] + 1


def test_costs_beyond_the_limit_are_left_out() -> None:
    assert graph_of({0: {1: 3}, 1: {2: 3}, 2: {}}).costs({0: 1.0}, at_most=4.0) == {0: 1.0, 1: 4.0}


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_of_equal_routes_the_lower_ids_win_in_any_order_of_the_file(order: tuple[int, int]) -> None:
    steps = {0: dict.fromkeys(order, 1), 1: {3: 1}, 2: {3: 1}, 3: {}, 4: {}}
    assert graph_of(steps).cheapest_route([0], [3]) == (0, 1, 3)


def test_a_change_of_lane_costs_its_length_and_happens_as_lanes_allow() -> None:
    """Two lanes of two lanelets each, 1 → 3 and 2 → 4, beside each other."""
    graph = LaneletGraph(
        length_m=dict.fromkeys((1, 2, 3, 4), 50.0),
        successors={1: (3,), 2: (4,), 3: (), 4: ()},
        predecessors={1: (), 2: (), 3: (1,), 4: (2,)},
        neighbours={1: (2,), 2: (1,), 3: (4,), 4: (3,)},
    )
    assert graph.shortest_route([1], [4]) == (1, 2, 4)
    assert graph.shortest_route([1, 2], [4]) == (2, 4)
    assert graph.shortest_route([3], [1]) is None
    assert graph.parallel_lanes([1]) == {1, 2}
    assert graph.reachable([1]) == {1: 0, 2: 1, 3: 1, 4: 2}
    assert 0 < LANE_CHANGE_COST_M < graph.length_m[1]
