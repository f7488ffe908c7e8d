"""Every tool by name: where its function, its arguments and its result are. Nothing is imported until used.

Adding a tool: its file, one entry here, one contract test. What it has workers do stands in ``operations.py``.
"""

import importlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from ..schemas.base import Arguments, Result

ToolFunction = Callable[[Arguments, Any], Awaitable[Any]]


@dataclass(frozen=True)
class ToolSpec:
    """One tool.

    Args:
        name: verb in snake_case, as clients call it.
        title: what a person reads.
        function: ``module:name`` below ``plannerforge.tools``.
        arguments: ``module:name`` of its arguments below ``plannerforge.schemas``.
        result: the same of its result; None for tools that answer with pictures.
        read_only: makes nothing that can be listed afterwards.
        idempotent: the same call again changes nothing more.
        essential: part of the small set for small models.
    """

    name: str
    title: str
    function: str
    arguments: str
    result: str | None
    read_only: bool = False
    idempotent: bool = True
    essential: bool = True

    @property
    def arguments_type(self) -> type[Arguments]:
        """The model of the arguments; its docstring is the tool's description."""
        arguments: type[Arguments] = _load("plannerforge.schemas", self.arguments)
        return arguments

    @property
    def result_type(self) -> type[Result] | None:
        """The model of the structured answer, or None."""
        return None if self.result is None else _load("plannerforge.schemas", self.result)

    def load_function(self) -> ToolFunction:
        """The function, imported now."""
        function: ToolFunction = _load("plannerforge.tools", self.function)
        return function


def _load(package: str, entry_point: str) -> Any:
    module, name = entry_point.split(":")
    return getattr(importlib.import_module(f"{package}.{module}"), name)


TOOLS: tuple[ToolSpec, ...] = (
    ToolSpec(
        "describe_catalog",
        "Describe the catalogue",
        "catalog:describe_catalog",
        "catalog:DescribeCatalogArguments",
        "catalog:DescribeCatalogResult",
        read_only=True,
    ),
    ToolSpec(
        "generate_scenarios",
        "Generate scenarios",
        "generation:generate_scenarios",
        "generation:GenerateScenariosArguments",
        "generation:GenerateScenariosResult",
    ),
    ToolSpec(
        "find_scenarios",
        "Find scenarios",
        "catalog:find_scenarios",
        "catalog:FindScenariosArguments",
        "catalog:FindScenariosResult",
    ),
    ToolSpec(
        "import_files",
        "Import files",
        "importing:import_files",
        "importing:ImportFilesArguments",
        "importing:ImportFilesResult",
        essential=False,
    ),
    ToolSpec(
        "describe_scenario",
        "Describe a scenario",
        "scenarios:describe_scenario",
        "scenarios:DescribeScenarioArguments",
        "scenarios:DescribeScenarioResult",
        read_only=True,
    ),
    ToolSpec(
        "modify_scenario",
        "Modify a scenario",
        "modification:modify_scenario",
        "modification:ModifyScenarioArguments",
        "modification:ModifyScenarioResult",
    ),
    ToolSpec(
        "list_planners",
        "List planners",
        "planning:list_planners",
        "planning:ListPlannersArguments",
        "planning:ListPlannersResult",
        read_only=True,
    ),
    ToolSpec(
        "configure_planner",
        "Configure a planner",
        "planning:configure_planner",
        "planning:ConfigurePlannerArguments",
        "planning:ConfigurePlannerResult",
    ),
    ToolSpec(
        "run_planner",
        "Run a planner",
        "planning:run_planner",
        "planning:RunPlannerArguments",
        "planning:RunPlannerResult",
    ),
    ToolSpec("get_job", "Look at a job", "artifacts:get_job", "jobs:GetJobArguments", "jobs:JobResult", read_only=True),
    ToolSpec(
        "cancel_job",
        "Cancel a job",
        "artifacts:cancel_job",
        "jobs:CancelJobArguments",
        "jobs:JobResult",
        essential=False,
    ),
    ToolSpec(
        "analyze_results",
        "Analyse results",
        "results:analyze_results",
        "results:AnalyzeResultsArguments",
        "results:AnalyzeResultsResult",
        read_only=True,
    ),
    ToolSpec(
        "compare_results",
        "Compare results",
        "results:compare_results",
        "comparison:CompareResultsArguments",
        "comparison:CompareResultsResult",
        read_only=True,
    ),
    ToolSpec("render", "Draw", "rendering:render", "rendering:RenderArguments", None, read_only=True),
    ToolSpec(
        "list_artifacts",
        "List artifacts",
        "artifacts:list_artifacts",
        "artifacts:ListArtifactsArguments",
        "artifacts:ListArtifactsResult",
        read_only=True,
        essential=False,
    ),
    ToolSpec(
        "export_artifacts",
        "Export artifacts",
        "exporting:export_artifacts",
        "artifacts:ExportArtifactsArguments",
        "artifacts:ExportArtifactsResult",
        essential=False,
    ),
)
