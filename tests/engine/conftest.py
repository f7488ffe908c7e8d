"""Applies edits to handmade scenarios."""

import hashlib
from pathlib import Path
from typing import Any

import pytest
from support.builders import ScenarioBuilder, town_road
from support.edits import Applied, Apply, apply_to


@pytest.fixture(scope="session")
def bases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the scenarios that tests edit, each written once, because parsed files are cached as in a
    worker.
    """
    return tmp_path_factory.mktemp("bases")


@pytest.fixture
def apply(tmp_path: Path, bases: Path) -> Apply:
    """Applies edits (as dictionaries) to a scenario and returns outcome, files and scenes; the output is ``out``."""

    def run(*edits: dict[str, Any], builder: ScenarioBuilder | None = None, **request: Any) -> Applied:
        written = (builder or town_road()).write(tmp_path / "base.xml")
        base = bases / f"{hashlib.sha256(written.read_bytes()).hexdigest()}.xml"
        if not base.exists():
            written.rename(base)
        return apply_to(base, tmp_path / "out", *edits, **request)

    return run
