"""Every tool by name and where its function is. Nothing is imported until used.

To add a tool, write its arguments and its result (``schemas/``), its workflow (``workflows/``), a function of its name
in a module here, its entry in ``TOOLS``, and its method of the Python door (``library/workspace.py``). The listing, its
schema, the protocol's hints, what refusals propose, and which servers offer it are derived from the entry.
"""

import importlib
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, get_type_hints

from ..schemas.base import Arguments, Result
from ..schemas.errors import VEHICLES_LISTED, Remedy, calling
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
        trial: the arguments that make a call a dry run, so that a refusal can try what it proposes; empty if no call
            makes anything, None if there is no dry run.
        view: the page that shows its answers, in hosts that show pages.
        looks: calls that list valid values; a refusal proposes the first that the client may make, if it knows no
            better remedy.
        proposed: a refusal may propose a call of it. One that cannot be taken back is only the caller's to decide.
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
    trial: tuple[tuple[str, object], ...] | None = None
    view: Literal["player", "board"] | None = None
    looks: tuple[Remedy, ...] = field(default=(), hash=False)
    proposed: bool = True

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
        """Return the tool as a server that makes nothing offers it."""
        return replace(self, making=(), refused=self.making, unlisted=(*self.unlisted, *self.making))

    def load_function(self) -> Callable[[Arguments, Any], Awaitable[Any]]:
        """Return the function, imported now."""
        module = importlib.import_module(f"plannerforge.tools.{self.module}")
        function: Callable[[Arguments, Any], Awaitable[Any]] = getattr(module, self.name)
        return function


_CATALOG, _PLANNERS = calling("describe_catalog"), calling("list_planners")
_ARTIFACTS, _SCENARIOS = calling("list_artifacts"), calling("list_artifacts", kind="scenario")
_RUNS, _JOBS = calling("list_artifacts", kind="run"), calling("list_artifacts", kind="job")

TOOLS: tuple[ToolSpec, ...] = (
    ToolSpec("describe_catalog", "Describe the catalogue", "scenarios", read_only=True, trial=(), looks=(_CATALOG,)),
    ToolSpec(
        "generate_scenarios",
        "Generate scenarios",
        "scenarios",
        seldom=("conditions", "cover", "source"),
        open_world=True,
        view="player",
        looks=(calling("describe_catalog", facet="maps"),),
    ),
    ToolSpec("find_scenarios", "Find scenarios", "scenarios", looks=(_CATALOG,)),
    ToolSpec("import_files", "Import files", "files", essential=False, looks=(_CATALOG,)),
    ToolSpec(
        "describe_scenario",
        "Describe a scenario",
        "scenarios",
        read_only=True,
        seldom=("time_s",),
        trial=(),
        view="player",
        looks=(calling("describe_scenario", "scenario_id"), _SCENARIOS),
    ),
    ToolSpec(
        "modify_scenario",
        "Modify a scenario",
        "scenarios",
        trial=(("dry_run", True),),
        view="player",
        looks=(VEHICLES_LISTED, _SCENARIOS),
    ),
    ToolSpec("list_planners", "List planners", "planners", read_only=True, trial=(), looks=(_PLANNERS,)),
    ToolSpec("configure_planner", "Configure a planner", "planners", looks=(_PLANNERS,)),
    ToolSpec("run_planner", "Run a planner", "planners", view="board", looks=(_PLANNERS,)),
    ToolSpec("get_job", "Look at a job", "artifacts", read_only=True, view="board", looks=(_JOBS,)),
    ToolSpec("cancel_job", "Cancel a job", "artifacts", essential=False, looks=(_JOBS,), proposed=False),
    ToolSpec(
        "analyze_results",
        "Analyse results",
        "results",
        read_only=True,
        seldom=("trial", "limit", "offset"),
        making=("trial",),
        trial=(),
        view="board",
        looks=(_RUNS,),
    ),
    ToolSpec("compare_results", "Compare results", "results", read_only=True, trial=(), view="board", looks=(_RUNS,)),
    ToolSpec("optimize_planner", "Optimise a planner", "planners", essential=False, looks=(_PLANNERS,)),
    ToolSpec("render", "Draw", "results", read_only=True, trial=(), view="board", looks=(_ARTIFACTS,)),
    ToolSpec(
        "list_artifacts", "List artifacts", "artifacts", read_only=True, essential=False, trial=(), looks=(_ARTIFACTS,)
    ),
    ToolSpec("export_artifacts", "Export artifacts", "files", essential=False, looks=(_ARTIFACTS,)),
)


def only_reading(tools: Iterable[ToolSpec]) -> tuple[ToolSpec, ...]:
    """Those of some tools that make nothing, as whoever must not make anything is offered them."""
    return tuple(spec.only_reading() for spec in tools if spec.read_only)
