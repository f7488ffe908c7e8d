"""The legend shows the marks that the picture shows."""

import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure

from plannerforge.engine.rendering.canvas import light_mark
from plannerforge.engine.rendering.furniture import Inventory, draw_legend


def legend_of(*states: str) -> dict[str, tuple[object, object]]:
    figure = Figure()
    shown = Inventory(
        (), states, (), ego_name="", has_ego=False, has_goal=False, has_stop_lines=False, has_collision=False
    )
    draw_legend(figure, shown)
    legend = figure.legends[0]
    lines = zip(legend.get_texts(), legend.get_lines(), strict=True)
    return {text.get_text(): (line.get_marker(), line.get_color()) for text, line in lines}


@pytest.mark.parametrize("state", ["red", "redYellow", "yellow", "green", "inactive"])
def test_a_traffic_light_has_the_mark_and_colour_of_its_state(state: str) -> None:
    ((_, (marker, colour)),) = legend_of(state).items()
    assert marker == light_mark(state)[0]
    assert same_color(colour, light_mark(state)[1])


def test_every_state_has_its_own_entry_and_mark() -> None:
    states = ("red", "redYellow", "yellow", "green", "inactive")
    found = legend_of(*states)
    assert len(found) == len(set(found.values())) == len(states)
