"""A scenario is stored once under an id; what is said where its content is another one than before."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from support.builders import town_road
from support.catalog import facts

from plannerforge.engine.workspace.artifacts import Artifact, Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.errors import NotPossible
from plannerforge.tools.call import Services, ToolCall
from plannerforge.tools.scenario_storage import put_scenario

ID = "ZAM_Builder-1_1_T-123456789"
EDITED = Recipe(tool="modify_scenario", arguments={"base": "ZAM_Builder-1_1_T-1"}, seed=4)


@pytest.fixture
def call(tmp_path: Path) -> Iterator[ToolCall]:
    workspace, unused = Workspace(tmp_path / "workspace"), cast("Any", None)
    yield ToolCall(Services(workspace, unused, unused, unused, unused, with_starter=False), unused)
    workspace.close()


def put(call: ToolCall, folder: Path, vehicles: int, recipe: Recipe) -> Artifact:
    road, xml = town_road(), folder / f"{vehicles}.xml"
    road.with_vehicles(*road.vehicles[:vehicles]).cut(3).write(xml)
    return put_scenario(call, facts(ID), xml=xml, net=None, recipe=recipe, origin="modified")


def test_the_same_content_is_stored_once(call: ToolCall, tmp_path: Path) -> None:
    assert put(call, tmp_path, 1, EDITED).artifact_id == put(call, tmp_path, 1, EDITED).artifact_id == ID


def test_a_recipe_that_made_another_file_before_says_that_another_seed_helps(call: ToolCall, tmp_path: Path) -> None:
    put(call, tmp_path, 1, EDITED)
    with pytest.raises(NotPossible, match=f"{ID} was stored by the same call with other content") as caught:
        put(call, tmp_path, 2, EDITED)
    assert caught.value.next_step == "use the stored one, or make a new one with another seed than 4"


def test_another_file_of_the_same_id_is_told_to_take_another_id(call: ToolCall, tmp_path: Path) -> None:
    put(call, tmp_path, 1, EDITED)
    with pytest.raises(NotPossible, match="another scenario with other content") as caught:
        put(call, tmp_path, 2, Recipe(tool="import_files"))
    assert caught.value.next_step == "give the file another benchmarkID"
