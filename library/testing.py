"""A pytest plugin with a workspace as a fixture, and planner suites with limits that a test asserts.

It imports nothing heavy until a test requests one of the fixtures.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from ..schemas.analysis.suite import SuiteReport
    from .workspace import Workspace

_MARKER = "planner_suite"


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker with pytest."""
    config.addinivalue_line(
        "markers", f"{_MARKER}(path, planners=()): run this suite for the fixture {_MARKER}, with these planners"
    )


@pytest.fixture(scope="session")
def planner_workspace(tmp_path_factory: pytest.TempPathFactory, pytestconfig: pytest.Config) -> "Iterator[Workspace]":
    """Yield a workspace for the whole session, which may read files below pytest's root folder."""
    from .workspace import Workspace

    folder = tmp_path_factory.mktemp("planner_workspace")
    with Workspace(folder, roots=(pytestconfig.rootpath, tmp_path_factory.getbasetemp()), warm_up=False) as workspace:
        yield workspace


@pytest.fixture
def planner_suite(request: pytest.FixtureRequest, planner_workspace: "Workspace") -> "SuiteReport":
    """Return the report on the suite that the test's marker gives; its path is relative to the test file."""
    marker = request.node.get_closest_marker(_MARKER)
    if marker is None or not marker.args:
        pytest.fail(f"a test with the fixture {_MARKER} needs the marker @pytest.mark.{_MARKER}('suite.yaml')")
    for planner in marker.kwargs.get("planners", ()):
        planner_workspace.add_planner(planner)
    return planner_workspace.suite(Path(request.path).parent / marker.args[0])
