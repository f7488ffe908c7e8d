"""A grid of runs as a job: it goes on when the call has answered, and ends in a batch artifact."""

from collections.abc import Sequence

from plannerforge.engine.execution.job_runner import JobProgress
from plannerforge.engine.execution.jobs import Job
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.planning import RunPlannerResult
from plannerforge.schemas.runs import BatchRecord, RunRecord
from plannerforge.tools.call import ToolCall
from plannerforge.tools.run_answer import answer
from plannerforge.tools.run_grid import Cell, CellResult, run_grid


async def run_many(call: ToolCall, cells: Sequence[Cell], wait_s: float, notes: Sequence[str]) -> RunPlannerResult:
    """Start the grid, or find what was made of it, and answer with what is finished after ``wait_s``."""
    recipe = batch_recipe(cells)
    stored = call.workspace.find_by_recipe("batch", recipe)
    if stored is not None:
        batch = stored.read(BatchRecord)
        results = [_stored(call, run_id) for run_id in batch.runs]
        return answer(cells, results, batch_id=batch.batch_id, notes=notes)

    finished: list[CellResult] = []
    known = sum(call.workspace.find_by_recipe("run", cell.recipe()) is not None for cell in cells)

    async def work(progress: JobProgress) -> None:
        def on_done(result: CellResult) -> None:
            finished.append(result)
            if result.record is not None:
                progress.add_result(result.record.run_id)
            progress.report(own_share(finished, known, len(cells)), f"{len(finished)} of {len(cells)} runs")

        results = await run_grid(call, cells, on_done)
        progress.add_result(store_batch(call, cells, results))

    async def tell(job: Job) -> None:
        await call.progress(job.share, job.message)

    job = call.jobs.start("batch", recipe, work)
    job = await call.jobs.wait(job.job_id, wait_s, tell)
    batch_id = next((key for key in job.results if key.startswith("batch_")), None)
    if batch_id is not None:
        record = call.workspace.get(batch_id, "batch").read(BatchRecord)
        lost = [CellResult(None, cell) for cell in record.lost]
        reused = {r.record.run_id for r in finished if r.record is not None and r.reused}
        results = [_stored(call, run_id, reused=run_id in reused) for run_id in record.runs] + lost
        return answer(cells, results, batch_id=batch_id, notes=notes)
    results = [_stored(call, key, reused=False) for key in job.results if key.startswith("run_")]
    problem = [job.error] if job.error else []
    return answer(cells, results, job_id=job.job_id, state=job.state, notes=[*notes, *problem])


def batch_recipe(cells: Sequence[Cell], lost: Sequence[str] = ()) -> Recipe:
    """The recipe of a grid; one with lost cells has another, so that asking again tries them again."""
    scenarios = list(dict.fromkeys(cell.scenario for cell in cells))
    configs = list(dict.fromkeys(cell.configuration.config_id for cell in cells))
    arguments = {
        "scenarios": scenarios,
        "configs": configs,
        "prediction": cells[0].prediction,
        "traffic": cells[0].traffic,
    }
    return Recipe(
        tool="run_planner",
        arguments=arguments | ({"lost": list(lost)} if lost else {}),
        parents=tuple(dict.fromkeys([*(cell.scenario_id for cell in cells), *configs])),
        seed=cells[0].seed,
        versions=cells[0].recipe().versions,
    )


def store_batch(call: ToolCall, cells: Sequence[Cell], results: Sequence[CellResult]) -> str:
    """Store the finished grid as a batch and give its id."""
    lost = tuple(result.lost for result in results if result.lost is not None)
    recipe = batch_recipe(cells, [f"{cell.scenario_id} {cell.config_id}" for cell in lost])
    record = BatchRecord(
        batch_id=f"batch_{recipe.digest}",
        scenarios=tuple(recipe.arguments["scenarios"]),
        configs=tuple(recipe.arguments["configs"]),
        prediction=cells[0].prediction,
        traffic=cells[0].traffic,
        runs=tuple(result.record.run_id for result in results if result.record is not None),
        lost=lost,
    )
    return call.workspace.put("batch", record.batch_id, recipe=recipe, record=record).artifact_id


def own_share(finished: Sequence[CellResult], known: int, total: int) -> float:
    """The share done of what was not known before: runs that are only looked up say nothing about the time left."""
    reused = sum(result.reused for result in finished)
    return (len(finished) - min(reused, known)) / max(total - known, 1)


def _stored(call: ToolCall, run_id: str, *, reused: bool = True) -> CellResult:
    return CellResult(call.workspace.get(run_id, "run").read(RunRecord), reused=reused)
