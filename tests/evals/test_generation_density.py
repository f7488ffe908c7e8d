"""The bench's judge of density: near the target, or missed and told."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from plannerforge.engine.network.net_parser import SumoNet
from plannerforge.evals.scoring.made_files import TARGETS, DensityVerdict, MadeFiles, judge_density
from plannerforge.schemas.generation import Density


def lane(length_m: float, allowed: str = "passenger", *, internal: bool = False) -> SimpleNamespace:
    return SimpleNamespace(shape=np.array([(0.0, 0.0), (length_m, 0.0)]), allowed={allowed}, internal=internal)


def judged(vehicles: int, wish: Density, *notes: str) -> DensityVerdict:
    """Two kilometres of lane for cars; a footway and the inside of a junction do not count."""
    lanes = {"a": lane(1200), "b": lane(800), "c": lane(900, "pedestrian"), "d": lane(900, internal=True)}
    net = cast("SumoNet", SimpleNamespace(lanes=lanes))
    made = MadeFiles(net, np.zeros(2), 0.0, 0.0, (("car", 4.5),) * (vehicles - 1))
    return judge_density(made, wish, notes)


@pytest.mark.parametrize(("vehicles", "met"), [(56, True), (43, True), (41, False), (72, False)])
def test_a_density_is_met_within_a_quarter_of_its_target(vehicles: int, met: bool) -> None:
    verdict = judged(vehicles, "high")
    assert verdict.found == vehicles / 2
    assert verdict.target == TARGETS["high"]
    assert verdict.met is met
    assert verdict.honest is met


def test_a_missed_density_is_honest_if_a_note_reports_it() -> None:
    assert judged(30, "high", "lower than the requested high density: 15 vehicles per lane-km").honest
    assert not judged(30, "high", "30 of 56 vehicles could be placed on the site's roads").honest
