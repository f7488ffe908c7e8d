"""The tools that look for a planner's failures."""

from ..schemas.boundaries import ExploreBoundaryArguments, ExploreBoundaryResult
from ..schemas.failures import FindFailuresArguments, FindFailuresResult
from ..workflows import boundaries, failures
from .call import ToolCall


async def explore_boundary(arguments: ExploreBoundaryArguments, call: ToolCall) -> ExploreBoundaryResult:
    """Map where planners begin to fail over two parameters of a logical scenario."""
    return await boundaries.explore_boundary(arguments, call)


async def find_failures(arguments: FindFailuresArguments, call: ToolCall) -> FindFailuresResult:
    """Search for changes of a scenario in which a planner fails and a careful driver would not."""
    result = await failures.find_failures(arguments, call)
    if result.search is not None:
        call.shows(*(failure.run_id for failure in result.search.failures))
    return result
