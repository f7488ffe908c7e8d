"""A workspace with content for every tool, created once."""

import shutil
from pathlib import Path

import pytest
from support.contract import Prepared, prepare
from support.server import ERA_NAMES, ERAS, KeptWorkers

from plannerforge.engine.execution import WorkerPool


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory, starter_workspace: Path, kept_workers: KeptWorkers) -> Prepared:
    folder = tmp_path_factory.mktemp("prepared")
    shutil.copytree(starter_workspace, folder / "workspace")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WorkerPool, "open", kept_workers.lent)
        return prepare(folder)


@pytest.fixture(params=ERAS, ids=ERA_NAMES)
def era(request: pytest.FixtureRequest) -> str:
    """Both protocol eras, which share the contract."""
    return str(request.param)
