"""Runs of a grid: each cell is one scenario's problem under one configuration, run in a worker and stored."""

import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import anyio

from plannerforge.engine.workspace.recipe import Recipe, versions_of
from plannerforge.engine.workspace.text_files import write_text
from plannerforge.schemas.errors import PlannerForgeError, UnexpectedFailure
from plannerforge.schemas.planning import PlannerConfiguration, RunRequest, RunResponse
from plannerforge.schemas.runs import LostCell, Prediction, RunRecord, Traffic
from plannerforge.tools.call import ToolCall

RUN = "plannerforge.engine.planners.run:run"
RUN_TIMEOUT_S = 120.0
CLAIM_POLL_S = 0.1
"""How often a run that somebody else makes is looked at."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Cell:
    """One run to make: ``problem_id`` None is the first planning problem."""

    scenario_id: str
    problem_id: int | None
    configuration: PlannerConfiguration
    prediction: Prediction = "constant_velocity"
    traffic: Traffic = "recorded"
    seed: int = 0

    @property
    def scenario(self) -> str:
        """The scenario as it is written in a call."""
        return self.scenario_id if self.problem_id is None else f"{self.scenario_id}#{self.problem_id}"

    def recipe(self) -> Recipe:
        """The recipe of the run; its digest names it."""
        simulator = ["libsumo"] if self.traffic == "reactive" else []
        return Recipe(
            tool="run_planner",
            arguments={
                "scenario": self.scenario_id,
                "problem": self.problem_id,
                "config": self.configuration.config_id,
                "prediction": self.prediction,
                "traffic": self.traffic,
            },
            parents=(self.scenario_id, self.configuration.config_id),
            seed=self.seed,
            versions=versions_of("frenetix", "commonroad-io", "commonroad-drivability-checker", *simulator),
        )


@dataclass(frozen=True)
class CellResult:
    """A finished cell: its run, or what went wrong; ``reused`` where the run was stored before."""

    record: RunRecord | None
    lost: LostCell | None = None
    reused: bool = False


async def run_cell(call: ToolCall, cell: Cell, *, tell_client: bool = False) -> CellResult:
    """The run of a cell: the stored one if its recipe was made before, or is made by somebody else just now.

    Raises:
        PlannerForgeError: the scenario cannot be read, or the worker died or ran past its limit.
    """
    while True:
        result = await _attempt(call, cell, tell_client=tell_client)
        if result is not None:
            return result
        await anyio.sleep(CLAIM_POLL_S)


async def run_grid(call: ToolCall, cells: Sequence[Cell], on_done: Callable[[CellResult], None]) -> list[CellResult]:
    """All cells, as many at once as there are workers, in the order of the cells.

    A cell that fails (a broken file, a dead or late worker, a full disk) is lost; the others go on. One that another
    batch or server makes just now is looked at again later.
    """
    results: list[CellResult | None] = [None] * len(cells)
    waiting = deque(enumerate(cells))

    async def work() -> None:
        while waiting:
            index, cell = waiting.popleft()
            result = await _isolated(call, cell)
            if result is None:
                waiting.append((index, cell))
                await anyio.sleep(CLAIM_POLL_S)
                continue
            results[index] = result
            on_done(result)

    async with anyio.create_task_group() as tasks:
        for _ in range(min(call.services.workers.capacity, len(cells))):
            tasks.start_soon(work)
    return [result for result in results if result is not None]


async def _isolated(call: ToolCall, cell: Cell) -> CellResult | None:
    try:
        return await _attempt(call, cell, tell_client=False)
    except PlannerForgeError as error:
        if isinstance(error, UnexpectedFailure):
            logger.error("incident %s in the run of %s:\n%s", error.incident, cell.scenario, error.details)  # noqa: TRY400
        lost = LostCell(scenario_id=cell.scenario, config_id=cell.configuration.config_id, error=error.text)
        return CellResult(None, lost)


async def _attempt(call: ToolCall, cell: Cell, *, tell_client: bool) -> CellResult | None:
    """The cell's run; None where somebody else makes it just now."""
    recipe = cell.recipe()
    stored = call.workspace.find_by_recipe("run", recipe)
    if stored is not None:
        return CellResult(stored.read(RunRecord), reused=True)
    with call.services.claims.claimed(recipe.digest) as is_ours:
        if not is_ours:
            return None
        stored = call.workspace.find_by_recipe("run", recipe)  # it may have been stored before the claim
        if stored is not None:
            return CellResult(stored.read(RunRecord), reused=True)
        return await _made(call, cell, recipe, tell_client=tell_client)


async def _made(call: ToolCall, cell: Cell, recipe: Recipe, *, tell_client: bool) -> CellResult:
    request = RunRequest(
        run_id=f"run_{recipe.digest}",
        scenario_path=str(call.workspace.file("scenario", cell.scenario_id, "scenario.xml")),
        scenario_id=cell.scenario_id,
        problem_id=cell.problem_id,
        configuration=cell.configuration,
        prediction=cell.prediction,
        traffic=cell.traffic,
        seed=cell.seed,
    )
    run = call.run if tell_client else call.services.workers.run
    response = await run(RUN, request, RunResponse, timeout_s=RUN_TIMEOUT_S)
    with call.workspace.scratch() as folder:
        files = {"steps.json": response.steps, "timing.json": response.timing}
        for name, content in files.items():
            write_text(folder / name, content.model_dump_json(), f"the run of {cell.scenario}")
        stored = call.workspace.put(
            "run",
            request.run_id,
            recipe=recipe,
            record=response.record,
            files={name: folder / name for name in files},
            name=f"{cell.scenario} {cell.configuration.name}",
        )
    return CellResult(stored.read(RunRecord))
