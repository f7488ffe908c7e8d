"""The page on planners has an entry for everything that can be named in a configuration."""

import re
from pathlib import Path
from typing import get_args

import pytest

from plannerforge.engine.planners.registry import PLANNERS
from plannerforge.engine.tuning.configurations import tuning_of
from plannerforge.engine.tuning.settings import known_settings
from plannerforge.schemas.runs import Prediction

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "planners.md").read_text(encoding="utf-8")


def names() -> set[str]:
    return set(re.findall(r"`([^`\n]+)`", PAGE))


@pytest.mark.parametrize("planner", PLANNERS)
def test_every_weight_and_preset_has_its_entry(planner: str) -> None:
    tuning = tuning_of(planner)
    short = [preset.short_name for preset in tuning.presets.values()]
    assert {planner, *tuning.weights, *tuning.external, *tuning.presets, *short} - names() == set()


def test_every_prediction_has_its_entry() -> None:
    assert set(get_args(Prediction)) - names() == set()


def test_every_setting_has_its_entry_with_its_range() -> None:
    for setting in known_settings().values():
        row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{setting.name}`"))
        assert setting.range_text.removesuffix(" steps") in row


def test_every_parameter_of_the_baseline_has_its_range_and_values() -> None:
    tuning = tuning_of("idm")
    for weight in tuning.weights.values():
        row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{weight.name}`"))
        cells = [cell.strip() for cell in row.split("|")]
        assert f"{weight.lowest:g} to {weight.highest:g}" in cells
        assert [float(cell) for cell in cells[4:7]] == [p.weights[weight.name] for p in tuning.presets.values()]
