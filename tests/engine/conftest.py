"""Applying edits to scenarios made by hand."""

from pathlib import Path
from typing import Any

import pytest
from support.builders import ScenarioBuilder, town_road
from support.edits import Applied, Apply, apply_to


@pytest.fixture
def apply(tmp_path: Path) -> Apply:
    """Applies edits (as dictionaries) to a scenario and gives outcome, files and scenes."""

    def run(*edits: dict[str, Any], builder: ScenarioBuilder | None = None, **request: Any) -> Applied:
        base = (builder or town_road()).write(tmp_path / "base.xml")
        return apply_to(base, tmp_path / "out", *edits, **request)

    return run
