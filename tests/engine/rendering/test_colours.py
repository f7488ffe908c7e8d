"""Colours of player and board: told apart with any colour vision, on a light and on a dark ground."""

import itertools
import re
from importlib.resources import files
from typing import get_args

import numpy as np
import pytest

from plannerforge.schemas.runs import Outcome

VISIONS = {
    "normal": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}
"""What is seen of linear RGB, at severity 1: Machado, Oliveira and Fernandes 2009, A physiologically-based model for
simulation of color vision deficiency."""
TO_XYZ = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
WHITE = [0.95047, 1.0, 1.08883]
"""Of sRGB, under D65 (IEC 61966-2-1)."""
LEAST = 11.0
"""CIEDE2000 between two colours that have to be told apart (chosen: from about 10 on they differ at a glance)."""
USERS = ["car", "taxi", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "priorityVehicle", "train", "other"]
SCHEMES = ("light", "dark")


def colour(name: str, scheme: str) -> str:
    """A colour of the style as ``#rrggbb``."""
    style = files("plannerforge.engine.rendering.views").joinpath("view.css").read_text(encoding="utf-8")
    found = re.search(rf"--{name}: (?:light-dark\((#\w{{6}}), (#\w{{6}})\)|(#\w{{6}}));", style)
    assert found is not None, name
    return str(found[3] or found[1 + SCHEMES.index(scheme)])


def lab(code: str, vision: str) -> tuple[float, float, float]:
    """CIELAB of a colour as somebody with this vision sees it."""
    values = np.array([int(code[place : place + 2], 16) / 255 for place in (1, 3, 5)])
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    xyz = np.array(TO_XYZ) @ np.clip(np.array(VISIONS[vision]) @ linear, 0.0, 1.0) / WHITE
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return float(116 * f[1] - 16), float(500 * (f[0] - f[1])), float(200 * (f[1] - f[2]))


def ciede2000(one: tuple[float, float, float], other: tuple[float, float, float]) -> float:
    """How different two colours look (Sharma, Wu and Dalal 2005)."""
    (l1, a1, b1), (l2, a2, b2) = one, other
    seventh = ((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2) ** 7
    stretched = 1.5 - 0.5 * np.sqrt(seventh / (seventh + 25.0**7))
    c1, c2 = np.hypot(stretched * a1, b1), np.hypot(stretched * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, stretched * a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    turn = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0.0
    hue = np.radians(h1 + turn / 2 if c1 * c2 else h1 + h2)
    lightness, chroma = (l1 + l2) / 2, (c1 + c2) / 2
    weight = 1 - 0.17 * np.cos(hue - np.pi / 6) + 0.24 * np.cos(2 * hue)
    weight += 0.32 * np.cos(3 * hue + np.radians(6)) - 0.20 * np.cos(4 * hue - np.radians(63))
    dl = (l2 - l1) / (1 + 0.015 * (lightness - 50) ** 2 / np.sqrt(20 + (lightness - 50) ** 2))
    dc = (c2 - c1) / (1 + 0.045 * chroma)
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn) / 2) / (1 + 0.015 * chroma * weight)
    about_blue = np.exp(-(((np.degrees(hue) % 360 - 275) / 25) ** 2))
    rotation = -2 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7)) * np.sin(np.radians(60 * about_blue))
    return float(np.sqrt(dl**2 + dc**2 + dh**2 + rotation * dc * dh))


def alike(pairs: list[tuple[str, str]], scheme: str, vision: str) -> dict[tuple[str, str], float]:
    """The pairs of colours that differ too little, with how much they do."""
    differences = {
        (one, other): ciede2000(lab(colour(one, scheme), vision), lab(colour(other, scheme), vision))
        for one, other in pairs
    }
    return {pair: round(difference, 1) for pair, difference in differences.items() if difference < LEAST}


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
        ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_difference_is_that_of_the_published_pairs(
    one: tuple[float, float, float], other: tuple[float, float, float], expected: float
) -> None:
    assert ciede2000(one, other) == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_outcomes_are_distinguishable_with_any_colour_vision(scheme: str, vision: str) -> None:
    assert alike(list(itertools.combinations(get_args(Outcome), 2)), scheme, vision) == {}


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_ego_is_distinguishable_with_any_colour_vision(scheme: str, vision: str) -> None:
    assert alike([("ego", other) for other in USERS], scheme, vision) == {}
