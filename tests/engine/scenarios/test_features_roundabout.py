"""Roundabouts are found, round trips about a block are not."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import Lane, Point, ScenarioBuilder, arc, line, town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.scenarios.features import has_roundabout

QUARTER = math.pi / 2


def ring(turn: float) -> tuple[tuple[Point, ...], ...]:
    """Four quarters of a circle of 20 m, driven against the clock (turn 1) or with it (−1)."""
    return tuple(arc((0, 0), 20, turn * QUARTER * part, turn * QUARTER * (part + 1)) for part in range(4))


def block() -> tuple[tuple[Point, ...], ...]:
    corners = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0)]
    return tuple(line(corners[part], corners[(part + 1) % 4]) for part in range(4))


def network(sides: tuple[tuple[Point, ...], ...], entries: int = 2) -> ScenarioBuilder:
    """A cycle of lanes 1 to 4, entered by lanes 11, 12, …, and a two-way road where traffic keeps right."""
    lanes = [
        Lane(
            part + 1,
            side,
            successors=((part + 1) % 4 + 1,),
            predecessors=((part - 1) % 4 + 1, *((part + 11,) if part < entries else ())),
        )
        for part, side in enumerate(sides)
    ]
    for part in range(entries):
        x, y = sides[part][0]
        lanes.append(Lane(part + 11, line((2 * x + 1, 2 * y + 1), (x, y)), successors=(part + 1,)))
    lanes.append(Lane(21, line((300, 0), (400, 0)), left=(22, False)))
    lanes.append(Lane(22, line((400, 3.5), (300, 3.5)), left=(21, False)))
    return replace(town_road(), lanes=tuple(lanes), vehicles=(), problems=())


@pytest.mark.parametrize(
    ("sides", "entries", "expected"),
    [
        pytest.param(ring(1.0), 2, True, id="roundabout"),
        pytest.param(ring(-1.0), 2, False, id="driven the wrong way round"),
        pytest.param(ring(1.0), 1, False, id="one entry"),
        pytest.param(block(), 2, False, id="block of houses"),
    ],
)
def test_only_round_cycles_with_entries_are_roundabouts(
    tmp_path: Path, sides: tuple[tuple[Point, ...], ...], entries: int, expected: bool
) -> None:
    path = network(sides, entries).write(tmp_path / "ring.xml")
    lanelets = read_scenario(path).scenario.lanelet_network
    assert has_roundabout(lanelets, LaneletGraph.of(lanelets)) is expected
