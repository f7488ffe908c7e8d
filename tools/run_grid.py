"""Runs of a grid: each cell is one scenario's problem under one configuration, run in a worker and stored."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import anyio

from plannerforge.engine.workspace.recipe import Recipe, versions_of
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.planning import PlannerConfiguration, RunRequest, RunResponse
from plannerforge.schemas.runs import LostCell, Prediction, RunRecord, Traffic
from plannerforge.tools.call import ToolCall

RUN = "plannerforge.engine.planners.run:run"
RUN_TIMEOUT_S = 120.0


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
            versions=versions_of("frenetix", "commonroad-io", "commonroad-drivability-checker"),
        )


@dataclass(frozen=True)
class CellResult:
    """A finished cell: its run, or what went wrong; ``reused`` where the run was stored before."""

    record: RunRecord | None
    lost: LostCell | None = None
    reused: bool = False


async def run_cell(call: ToolCall, cell: Cell, *, tell_client: bool = False) -> CellResult:
    """The run of a cell: the stored one if its recipe was made before.

    Raises:
        PlannerForgeError: the scenario cannot be read, or the worker died or ran past its limit.
    """
    recipe = cell.recipe()
    stored = call.workspace.find_by_recipe("run", recipe)
    if stored is not None:
        return CellResult(stored.read(RunRecord), reused=True)
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
    if tell_client:
        response = await call.run(RUN, request, RunResponse, timeout_s=RUN_TIMEOUT_S)
    else:
        response = await call.services.workers.run(RUN, request, RunResponse, timeout_s=RUN_TIMEOUT_S)
    with call.workspace.scratch() as folder:
        files = {"steps.json": response.steps, "timing.json": response.timing}
        for name, content in files.items():
            (folder / name).write_text(content.model_dump_json(), encoding="utf-8")
        call.workspace.put(
            "run",
            request.run_id,
            recipe=recipe,
            record=response.record,
            files={name: folder / name for name in files},
            name=f"{cell.scenario} {cell.configuration.name}",
        )
    return CellResult(response.record)


async def run_grid(call: ToolCall, cells: Sequence[Cell], on_done: Callable[[CellResult], None]) -> list[CellResult]:
    """All cells, as many at once as there are workers, in the order of the cells.

    A cell that fails (a broken file, a dead or late worker) is lost; the others go on.
    """
    results: list[CellResult | None] = [None] * len(cells)
    waiting = iter(list(enumerate(cells)))

    async def work() -> None:
        for index, cell in waiting:
            try:
                results[index] = result = await run_cell(call, cell)
            except PlannerForgeError as error:
                lost = LostCell(scenario_id=cell.scenario, config_id=cell.configuration.config_id, error=error.text)
                results[index] = result = CellResult(None, lost)
            on_done(result)

    async with anyio.create_task_group() as tasks:
        for _ in range(min(call.limits.worker_count, len(cells))):
            tasks.start_soon(work)
    return [result for result in results if result is not None]
