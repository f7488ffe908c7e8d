"""Colours and line styles that are told apart with any colour vision (Okabe and Ito 2008, Color universal design)."""

from typing import Literal

BLACK = "#000000"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8C8C8C"

EGO_COLOUR = VERMILLION
INK = "#1A1A1A"
MUTED = "#5A5A5A"
ROAD, ROAD_EDGE, DIRECTION = "#E4E4E4", "#9A9A9A", "#B4B4B4"
LIGHT_RED, LIGHT_YELLOW, LIGHT_GREEN, LIGHT_OFF = "#D62728", "#E6B800", "#1A9850", "#C8C8C8"

EXACT = (
    "#FFFFFF", INK, MUTED, ROAD, ROAD_EDGE, DIRECTION, LIGHT_RED, LIGHT_YELLOW, LIGHT_GREEN, LIGHT_OFF,
    BLACK, ORANGE, SKY_BLUE, GREEN, YELLOW, BLUE, VERMILLION, PURPLE, GREY,
)  # fmt: skip
"""Colours that carry a meaning: they stay exact where an image is reduced to a palette."""

_CLASS_COLOURS = {
    "car": SKY_BLUE,
    "taxi": ORANGE,
    "truck": GREEN,
    "bus": YELLOW,
    "motorcycle": PURPLE,
    "bicycle": PURPLE,
    "pedestrian": BLACK,
    "priorityVehicle": BLUE,
    "train": GREEN,
}

_OUTCOME_COLOURS = {
    "goal_reached": BLUE,
    "collision": VERMILLION,
    "timeout": ORANGE,
    "goal_missed": YELLOW,
    "goal_early": SKY_BLUE,
    "goal_late": GREEN,
    "infeasible": PURPLE,
    "off_road": BLACK,
    "invalid": "#BDBDBD",
}

_LIGHT_MARKS = {
    "red": ("s", LIGHT_RED),
    "redYellow": ("s", LIGHT_YELLOW),
    "yellow": ("D", LIGHT_YELLOW),
    "green": ("o", LIGHT_GREEN),
}

LineStyle = Literal["solid"] | tuple[float, tuple[float, ...]]

_SERIES: tuple[tuple[str, LineStyle], ...] = (
    (BLUE, "solid"),
    (VERMILLION, (0, (6, 2))),
    (GREEN, (0, (1, 1))),
    (PURPLE, (0, (6, 2, 1, 2))),
    (ORANGE, (0, (3, 1))),
    (BLACK, (0, (8, 2, 1, 2, 1, 2))),
)


def class_colour(obstacle_type: str) -> str:
    """Fill colour of a CommonRoad obstacle type; grey for those without a class of their own."""
    return _CLASS_COLOURS.get(obstacle_type, GREY)


def light_mark(state: str) -> tuple[str, str]:
    """Marker and fill colour of a traffic light in a state: the shape says it as well; a light grey dot if inactive."""
    return _LIGHT_MARKS.get(state, ("o", LIGHT_OFF))


def outcome_colour(outcome: str) -> str:
    """Colour of a run's outcome in every chart."""
    return _OUTCOME_COLOURS.get(outcome, GREY)


def series_style(index: int) -> tuple[str, LineStyle]:
    """Colour and dash pattern of the n-th series; they repeat after six."""
    return _SERIES[index % len(_SERIES)]
