"""Every tool by name and where its function is. Nothing is imported until used.

Adding a tool: its function, which has the tool's name, one entry here, one contract test. What it does is a
workflow (``plannerforge.workflows``).
"""

import importlib
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_type_hints

from ..schemas.base import Arguments, Result
from .call import ImageAnswer


@dataclass(frozen=True)
class ToolSpec:
    """One tool.

    Args:
        name: verb in snake_case, as clients call it; the function has it too.
        title: what a person reads.
        module: where the function is, below ``plannerforge.tools``.
        read_only: makes nothing that can be listed afterwards.
        essential: part of the small set for small models.
        seldom: arguments that the small set does not list, and still takes.
        unlisted: arguments that this listing leaves out.
        making: arguments with which a tool that is read-only otherwise makes something.
        refused: arguments that this listing refuses.
        open_world: may ask services on the net.
        view: the page that shows its answers, in hosts that show pages.
    """

    name: str
    title: str
    module: str
    read_only: bool = False
    essential: bool = True
    seldom: tuple[str, ...] = ()
    unlisted: tuple[str, ...] = ()
    making: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    open_world: bool = False
    view: Literal["player", "board"] | None = None

    @cached_property
    def arguments_type(self) -> type[Arguments]:
        """The model of the arguments, as the function declares it; its docstring is the tool's description."""
        arguments: type[Arguments] = get_type_hints(self.load_function())["arguments"]
        return arguments

    @property
    def result_type(self) -> type[Result] | None:
        """The model of the structured answer, as the function declares it; None for one that answers with pictures."""
        result: type[Result | ImageAnswer] = get_type_hints(self.load_function())["return"]
        return result if issubclass(result, Result) else None

    def only_reading(self) -> "ToolSpec":
        """The tool as a server that makes nothing offers it."""
        return replace(self, making=(), refused=self.making, unlisted=(*self.unlisted, *self.making))

    def load_function(self) -> Callable[[Arguments, Any], Awaitable[Any]]:
        """The function, imported now."""
        module = importlib.import_module(f"plannerforge.tools.{self.module}")
        function: Callable[[Arguments, Any], Awaitable[Any]] = getattr(module, self.name)
        return function


TOOLS: tuple[ToolSpec, ...] = (
    ToolSpec("describe_catalog", "Describe the catalogue", "scenarios", read_only=True),
    ToolSpec(
        "generate_scenarios",
        "Generate scenarios",
        "scenarios",
        seldom=("conditions", "cover", "source"),
        open_world=True,
        view="player",
    ),
    ToolSpec("find_scenarios", "Find scenarios", "scenarios"),
    ToolSpec("import_files", "Import files", "files", essential=False),
    ToolSpec(
        "describe_scenario", "Describe a scenario", "scenarios", read_only=True, seldom=("time_s",), view="player"
    ),
    ToolSpec("modify_scenario", "Modify a scenario", "scenarios", view="player"),
    ToolSpec("list_planners", "List planners", "planners", read_only=True),
    ToolSpec("configure_planner", "Configure a planner", "planners"),
    ToolSpec("run_planner", "Run a planner", "planners", view="board"),
    ToolSpec("get_job", "Look at a job", "artifacts", read_only=True, view="board"),
    ToolSpec("cancel_job", "Cancel a job", "artifacts", essential=False),
    ToolSpec(
        "analyze_results",
        "Analyse results",
        "results",
        read_only=True,
        seldom=("trial", "limit", "offset"),
        making=("trial",),
        view="board",
    ),
    ToolSpec("compare_results", "Compare results", "results", read_only=True, view="board"),
    ToolSpec("optimize_planner", "Optimise a planner", "planners", essential=False),
    ToolSpec("render", "Draw", "results", read_only=True, view="board"),
    ToolSpec("list_artifacts", "List artifacts", "artifacts", read_only=True, essential=False),
    ToolSpec("export_artifacts", "Export artifacts", "files", essential=False),
)


def only_reading(tools: Iterable[ToolSpec]) -> tuple[ToolSpec, ...]:
    """Those of some tools that make nothing, as whoever must not make anything is offered them."""
    return tuple(spec.only_reading() for spec in tools if spec.read_only)
