"""One call with all edits against one call for each of them, both through the tool ``modify_scenario`` itself."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar, cast

import anyio

from plannerforge.engine.execution.executor import no_progress
from plannerforge.engine.execution.progress import silent
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.base import Model
from plannerforge.schemas.modification import Edit, EditReport, ModifyScenarioArguments
from plannerforge.tools.call import Services, ToolCall
from plannerforge.tools.modification import modify_scenario
from plannerforge.tools.storing import store_scenario

Response = TypeVar("Response", bound=Model)


class _HereAndNow:
    """An executor that carries operations out in this process, which is a worker already."""

    capacity = 1

    async def run(self, entry_point: str, request: Model, response_type: type[Response], **limits: object) -> Response:
        """The operation's response."""
        del limits
        module, _, name = entry_point.partition(":")
        return response_type.model_validate(getattr(import_module(module), name)(request, silent))


def several_calls_equal(path: Path, edits: Sequence[Edit]) -> bool:
    """Whether one call for each edit, each on the scenario that the one before made, ends with the bytes of one call.

    Ids are made of what was asked: where the words of all calls together are those of the one, they have to be equal
    too. Who is added, and whom words mean after somebody was added or removed, later calls name by the ids that were
    reported.
    """
    return anyio.run(_several_calls_equal, path, tuple(edits))


async def _several_calls_equal(path: Path, edits: tuple[Edit, ...]) -> bool:
    with TemporaryDirectory() as folder:
        workspace = Workspace(Path(folder))
        try:
            call = _call(workspace)
            base = (
                await store_scenario(call, xml=path, net=None, recipe=Recipe(tool="bench"), origin="imported")
            ).artifact_id
            once = await modify_scenario(ModifyScenarioArguments(scenario_id=base, edits=list(edits)), call)
            steps = _by_ids(edits, once.edits)
            last = base
            for edit in steps:
                made = await modify_scenario(ModifyScenarioArguments(scenario_id=last, edits=[edit]), call)
                last = str(made.scenario_id)
            if steps == edits and last != once.scenario_id:
                return False
            return _content(workspace, str(once.scenario_id)) == _content(workspace, last)
        finally:
            workspace.close()


def _by_ids(edits: tuple[Edit, ...], reports: Sequence[EditReport]) -> tuple[Edit, ...]:
    """The edits with ids in place of words whose meaning depends on the edits before them."""
    made, is_altered = [], False
    for edit, report in zip(edits, reports, strict=True):
        words = is_altered and not all(text.isdigit() for text in edit.vehicles)
        made.append(edit.model_copy(update={"vehicles": [str(key) for key in report.vehicles]}) if words else edit)
        is_altered = is_altered or edit.op in ("add_vehicle", "remove_vehicle", "set_ego")
    return tuple(made)


def _content(workspace: Workspace, scenario_id: str) -> bytes:
    content = workspace.file("scenario", scenario_id, "scenario.xml").read_bytes()
    return content.replace(scenario_id.encode(), b"")


def _call(workspace: Workspace) -> ToolCall:
    """A call that can store and run operations, and nothing else."""
    nothing = cast("Any", None)
    return ToolCall(Services(workspace, _HereAndNow(), nothing, nothing, nothing, with_starter=False), no_progress)
