"""The tools that look for a planner's failures."""

from ..schemas.boundaries import ExploreBoundaryArguments, ExploreBoundaryResult
from ..workflows import boundaries
from .call import ToolCall


async def explore_boundary(arguments: ExploreBoundaryArguments, call: ToolCall) -> ExploreBoundaryResult:
    """Map where planners begin to fail over two parameters of a logical scenario."""
    return await boundaries.explore_boundary(arguments, call)
