"""A scenario is stored once under an id; what is said where its content is another one than before."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.builders import town_road
from support.catalog import facts

from plannerforge.engine.catalog import put_scenario
from plannerforge.engine.workspace import Artifact, Recipe, Workspace
from plannerforge.schemas.errors import NotPossible

ID = "ZAM_Builder-1_1_T-123456789"
EDITED = Recipe(tool="modify_scenario", arguments={"base": "ZAM_Builder-1_1_T-1"}, seed=4)


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    made = Workspace(tmp_path / "workspace")
    yield made
    made.close()


def put(workspace: Workspace, folder: Path, vehicles: int, recipe: Recipe) -> Artifact:
    road, xml = town_road(), folder / f"{vehicles}.xml"
    road.with_vehicles(*road.vehicles[:vehicles]).cut(3).write(xml)
    return put_scenario(workspace, facts(ID), xml=xml, net=None, recipe=recipe, origin="modified")


def test_the_same_content_is_stored_once(workspace: Workspace, tmp_path: Path) -> None:
    assert put(workspace, tmp_path, 1, EDITED).artifact_id == put(workspace, tmp_path, 1, EDITED).artifact_id == ID


def test_a_recipe_that_gave_another_file_before_names_another_seed(workspace: Workspace, tmp_path: Path) -> None:
    put(workspace, tmp_path, 1, EDITED)
    with pytest.raises(NotPossible, match=f"{ID} was stored by the same call with other content") as caught:
        put(workspace, tmp_path, 2, EDITED)
    assert caught.value.next_step == "use the stored one, or generate one with a seed other than 4"


def test_a_different_file_with_the_same_id_is_refused_with_the_advice_to_change_the_id(
    workspace: Workspace, tmp_path: Path
) -> None:
    put(workspace, tmp_path, 1, EDITED)
    with pytest.raises(NotPossible, match="another scenario with other content") as caught:
        put(workspace, tmp_path, 2, Recipe(tool="import_files"))
    assert caught.value.next_step == "give the file another benchmarkID"
