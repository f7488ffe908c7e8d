"""The page on planners and the generated reference have an entry for everything that a configuration can state."""

import re
from pathlib import Path
from typing import get_args

import pytest

from plannerforge.engine.planners.registry import PLANNERS
from plannerforge.engine.tuning.configurations import tuning_of
from plannerforge.engine.tuning.settings import known_settings
from plannerforge.schemas.runs import Prediction

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = (DOCS / "planners.md").read_text(encoding="utf-8")
REFERENCE = (DOCS / "reference" / "configurations.md").read_text(encoding="utf-8")


def names(page: str = PAGE) -> set[str]:
    return set(re.findall(r"`([^`\n]+)`", page))


@pytest.mark.parametrize("planner", PLANNERS)
def test_every_weight_and_preset_has_its_entry(planner: str) -> None:
    tuning = tuning_of(planner)
    short = [preset.short_name for preset in tuning.presets.values()]
    assert {planner, *tuning.external, *tuning.presets, *short} - names() == set()
    assert {*tuning.weights, *tuning.presets, *short} - names(REFERENCE) == set()


def test_every_prediction_has_its_entry() -> None:
    assert set(get_args(Prediction)) - names() == set()


def test_every_setting_has_its_entry_with_its_range() -> None:
    for setting in known_settings().values():
        row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{setting.name}`"))
        assert setting.range_text.removesuffix(" steps") in row
