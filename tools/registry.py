"""Every tool by name, with the module of its function. Modules are imported at first use.

To add a tool, write its arguments and its result (``schemas/``), its workflow (``workflows/``), a function of its name
in a module here, its entry in ``TOOLS``, and its method of the Python library (``library/workspace.py``). The listing,
its schema, the protocol's hints, the calls that refusals suggest, and the servers that offer it follow from the entry.
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
        name: verb in snake_case, as clients call it, and the name of the function.
        title: name for people.
        module: module of the function, below ``plannerforge.tools``.
        read_only: creates nothing that can be listed afterwards.
        essential: belongs to the small set for small models.
        seldom: arguments that the small set accepts but does not list.
        unlisted: arguments left out of the schema that clients see.
        making: arguments that make an otherwise read-only tool create something.
        refused: arguments that a call must not set here.
        open_world: may use online services.
        trial: arguments that make a call a dry run, so that a refusal can test its suggestion; empty if no call creates
            anything, None if there is no dry run.
        check: function of the module that refuses a call as the tool would, but creates nothing; the trial of a tool
            without a dry run. If there is no time for it, a suggestion is made untested.
        view: page that shows its answers, in hosts that show pages.
        looks: calls that list valid values; a refusal suggests the first that the client may make, if it has no better
            remedy.
        proposed: whether a refusal may suggest a call to it; False if only the caller should decide, because the call
            cannot be undone.
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
    check: str = ""
    view: Literal["player", "board"] | None = None
    looks: tuple[Remedy, ...] = field(default=(), hash=False)
    proposed: bool = True

    @cached_property
    def arguments_type(self) -> type[Arguments]:
        """The model of the arguments that the function declares; its docstring is the tool's description."""
        arguments: type[Arguments] = get_type_hints(self.load_function())["arguments"]
        return arguments

    @property
    def result_type(self) -> type[Result] | None:
        """The model of the structured answer that the function declares; None if it answers with pictures."""
        result: type[Result | ImageAnswer] = get_type_hints(self.load_function())["return"]
        return result if issubclass(result, Result) else None

    def only_reading(self) -> "ToolSpec":
        """Return the tool for a server that creates nothing."""
        return replace(self, making=(), refused=self.making, unlisted=(*self.unlisted, *self.making))

    def load_function(self) -> Callable[[Arguments, Any], Awaitable[Any]]:
        """Import the function and return it."""
        return self._loaded(self.name)

    def load_check(self) -> Callable[[Arguments, Any], Awaitable[Any]] | None:
        """Import the function that checks a call and return it; None if there is none."""
        return self._loaded(self.check) if self.check else None

    def _loaded(self, name: str) -> Callable[[Arguments, Any], Awaitable[Any]]:
        module = importlib.import_module(f"plannerforge.tools.{self.module}")
        function: Callable[[Arguments, Any], Awaitable[Any]] = getattr(module, name)
        return function


_CATALOG, _PLANNERS = calling("describe_catalog"), calling("list_planners")
_ARTIFACTS, _SCENARIOS = calling("list_artifacts"), calling("list_artifacts", kind="scenario")
_RUNS, _JOBS = calling("list_artifacts", kind="run"), calling("list_artifacts", kind="job")

TOOLS: tuple[ToolSpec, ...] = (
    ToolSpec(
        "describe_catalog",
        "Describe the catalogue",
        "scenarios",
        read_only=True,
        seldom=("odd",),
        trial=(),
        looks=(_CATALOG,),
    ),
    ToolSpec(
        "generate_scenarios",
        "Generate scenarios",
        "scenarios",
        seldom=("conditions", "cover", "source", "criticality"),
        open_world=True,
        check="check_generation",
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
    ToolSpec(
        "find_failures", "Find failures", "exploration", essential=False, view="board", looks=(_SCENARIOS, _PLANNERS)
    ),
    ToolSpec("optimize_planner", "Optimise a planner", "planners", essential=False, looks=(_PLANNERS,)),
    ToolSpec("explore_boundary", "Map a boundary", "exploration", essential=False, looks=(_PLANNERS,)),
    ToolSpec("render", "Draw", "results", read_only=True, trial=(), view="board", looks=(_ARTIFACTS,)),
    ToolSpec(
        "list_artifacts", "List artifacts", "artifacts", read_only=True, essential=False, trial=(), looks=(_ARTIFACTS,)
    ),
    ToolSpec("export_artifacts", "Export artifacts", "files", essential=False, looks=(_ARTIFACTS,)),
)


def only_reading(tools: Iterable[ToolSpec]) -> tuple[ToolSpec, ...]:
    """Return the tools that create nothing, for clients that must not create anything."""
    return tuple(spec.only_reading() for spec in tools if spec.read_only)
