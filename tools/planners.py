"""The planner tools: list settings, create configurations, run, and search for better configurations."""

from ..schemas.analysis.optimization import OptimizePlannerArguments, OptimizePlannerResult
from ..schemas.planning import (
    ConfigurePlannerArguments,
    ConfigurePlannerResult,
    ListPlannersArguments,
    ListPlannersResult,
    RunPlannerArguments,
    RunPlannerResult,
)
from ..workflows import planners
from ..workflows.analysis import optimization
from .call import ToolCall


async def list_planners(arguments: ListPlannersArguments, call: ToolCall) -> ListPlannersResult:
    """Return the planners, and the current values of one."""
    return await planners.list_planners(arguments, call)


async def configure_planner(arguments: ConfigurePlannerArguments, call: ToolCall) -> ConfigurePlannerResult:
    """Store a configuration created from a preset and changes."""
    return await planners.configure_planner(arguments, call)


async def run_planner(arguments: RunPlannerArguments, call: ToolCall) -> RunPlannerResult:
    """Run configurations on scenarios; a view shows the single run, or the batch once it is complete."""
    result = await planners.run_planner(arguments, call)
    if result.batch_id is not None and result.runs:
        call.shows(result.batch_id)
    elif result.total == 1:
        call.shows(*(run.run_id for run in result.runs))
    return result


async def optimize_planner(arguments: OptimizePlannerArguments, call: ToolCall) -> OptimizePlannerResult:
    """Search for a better configuration, or find out which weights matter."""
    return await optimization.optimize_planner(arguments, call)
