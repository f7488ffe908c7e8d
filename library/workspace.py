"""A workspace for Python: every MCP tool as a blocking method with keyword arguments."""

import inspect
import pickle
import re
import sysconfig
import uuid
import warnings
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Protocol, TypeVar

from ..engine.planners import OwnPlanner, Planner, PlannerObject, registered_objects
from ..engine.workspace import Workspace as StoredWorkspace
from ..schemas.analysis.comparison import CompareResultsArguments, CompareResultsResult
from ..schemas.analysis.optimization import OptimizePlannerArguments, OptimizePlannerResult
from ..schemas.analysis.suite import Suite, SuiteReport
from ..schemas.artifacts import (
    ExportArtifactsArguments,
    ExportArtifactsResult,
    ImportFilesArguments,
    ImportFilesResult,
    ListArtifactsArguments,
    ListArtifactsResult,
)
from ..schemas.base import Arguments
from ..schemas.boundaries import ExploreBoundaryArguments, ExploreBoundaryResult
from ..schemas.catalog import DescribeCatalogArguments, DescribeCatalogResult, FindScenariosArguments
from ..schemas.errors import InvalidRequest, NotPossible
from ..schemas.failures import FindFailuresArguments, FindFailuresResult
from ..schemas.generation import GenerateScenariosArguments
from ..schemas.jobs import CancelJobArguments, GetJobArguments, JobResult
from ..schemas.modification import ModifyScenarioArguments
from ..schemas.planning import (
    ConfigurePlannerArguments,
    ConfigurePlannerResult,
    ListPlannersArguments,
    ListPlannersResult,
    PlannerDeclaration,
    RunPlannerArguments,
    RunResponse,
)
from ..schemas.rendering import RenderArguments
from ..schemas.results import AnalyzeResultsArguments, AnalyzeResultsResult
from ..schemas.runs import BatchRecord
from ..schemas.scenarios import DescribeScenarioArguments, DescribeScenarioResult
from ..schemas.worlds import World
from ..server.arguments.checking import read_arguments
from ..server.settings import Settings
from ..server.suites import read_suite
from ..workflows import artifacts as artifact_work
from ..workflows import boundaries, catalog, critical_scenarios, exporting, failures, importing, modification, rendering
from ..workflows import planners as planning
from ..workflows import scenarios as scenario_work
from ..workflows.analysis import comparison, figures, optimization
from ..workflows.analysis.suite import carry_out
from ..workflows.context import WorkflowContext
from ..workflows.runs import resume_run
from ..workflows.scenarios import ChosenScenario, choose_scenarios
from .calling import Caller
from .objects import Picture, Run, Runs, Scenario, Scenarios

_Long = TypeVar("_Long", bound="_LongAnswer")
_WAIT_S = 50.0
"""Seconds that one request for a job waits, the longest that the request allows."""


class _LongAnswer(Protocol):
    """An answer with the id of a job that is still working on the rest of it."""

    @property
    def state(self) -> str: ...

    @property
    def job_id(self) -> str | None: ...


AnyPlanner = str | OwnPlanner | Planner | type[Planner]
"""A configuration by id or name, such as ``frenetix:Default``, or your own planner as an object or a class."""


class Workspace:
    """A folder of scenarios, configurations, runs and results, with every operation on them.

    Workers start with the first call that needs them, and stop with :meth:`close` or at the end of the ``with`` block.
    The workspace stores every result. It reuses what an earlier, equal request stored, as does a server on the same
    folder.

    Args:
        folder: Where everything is stored; None selects the folder that a server uses by default.
        settings: The server's settings by name, such as ``workers=4`` or ``maps_online="offline"``.
    """

    def __init__(self, folder: str | Path | None = None, **settings: Any) -> None:
        if folder is not None:
            settings["workspace"] = Path(folder)
        options = Settings(**settings).service_options(Path.cwd())
        self._caller = Caller(options)
        self._planners = ExitStack()
        self._known: list[tuple[object, str]] = []

    def __enter__(self) -> "Workspace":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop the workers; stored artifacts stay."""
        self._planners.close()
        self._caller.close()

    @property
    def stored(self) -> StoredWorkspace:
        """The stored artifacts with their records and files."""
        return self._caller.services.workspace

    def catalog(self, **arguments: Any) -> DescribeCatalogResult:
        """Return the contents of the catalogue and the terms that searches accept (``describe_catalog``)."""
        return self._caller.call(catalog.describe_catalog, read_arguments(DescribeCatalogArguments, arguments))

    def generate(self, **arguments: Any) -> Scenarios:
        """Generate scenarios from maps (``generate_scenarios``) and wait until all are stored."""
        request = read_arguments(GenerateScenariosArguments, arguments)
        made = self._wait_for(critical_scenarios.generate_scenarios, request)
        ids = [one.scenario_id for one in made.scenarios]
        if made.plan is not None:
            ids = [one.scenario_id for one in self._caller.call(_scenarios_of_plan, made.plan.plan_id)]
        return Scenarios(made, [self.scenario(key) for key in ids])

    def find(self, text: str | None = None, **arguments: Any) -> Scenarios:
        """Search the catalogue (``find_scenarios``)."""
        request = arguments if text is None else {"text": text, **arguments}
        found = self._caller.call(catalog.find_scenarios, read_arguments(FindScenariosArguments, request))
        return Scenarios(found, [self.scenario(match.scenario_id) for match in found.matches])

    def import_files(self, path: str | Path, **arguments: Any) -> ImportFilesResult:
        """Import scenarios, maps, weight files and archives (``import_files``) and wait until all are stored."""
        request = read_arguments(ImportFilesArguments, {"path": str(path), **arguments})
        return self._wait_for(importing.import_files, request)

    def scenario(self, scenario_id: str) -> Scenario:
        """Return a stored scenario by id; ``ID#problem`` selects a planning problem other than the first."""
        return Scenario(self, scenario_id)

    def describe(self, scenario: "str | Scenario | Scenarios", **arguments: Any) -> DescribeScenarioResult:
        """Describe a scenario with its facts and ids (``describe_scenario``)."""
        request = read_arguments(DescribeScenarioArguments, {"scenario_id": _one_id(scenario), **arguments})
        return self._caller.call(scenario_work.describe_scenario, request)

    def edit(
        self,
        scenario: "str | Scenario | Scenarios",
        edits: "Mapping[str, Any] | Sequence[Mapping[str, Any]]",
        **arguments: Any,
    ) -> Scenarios:
        """Edit a scenario and store the result (``modify_scenario``), or only report it with ``dry_run``."""
        request = {
            "scenario_id": _one_id(scenario),
            "edits": [edits] if isinstance(edits, Mapping) else list(edits),
            **arguments,
        }
        made = self._caller.call(modification.modify_scenario, read_arguments(ModifyScenarioArguments, request))
        return Scenarios(made, [] if made.scenario_id is None else [self.scenario(made.scenario_id)])

    def planners(self, **arguments: Any) -> ListPlannersResult:
        """Return the planners, and the settings that one of them takes (``list_planners``)."""
        return self._caller.call(planning.list_planners, read_arguments(ListPlannersArguments, arguments))

    def configure(self, planner: AnyPlanner | None = None, **arguments: Any) -> ConfigurePlannerResult:
        """Store a configuration with changes to a preset (``configure_planner``)."""
        request = arguments if planner is None else {"planner": self._register(planner), **arguments}
        return self._caller.call(planning.configure_planner, read_arguments(ConfigurePlannerArguments, request))

    def run(
        self,
        scenarios: "Sequence[str | Scenario] | str | Scenario",
        planners: "Mapping[str, AnyPlanner] | Sequence[AnyPlanner] | AnyPlanner" = "current",
        **arguments: Any,
    ) -> Runs:
        """Run planners on scenarios (``run_planner``) and wait for all runs.

        A planner may be your own object. Its ``plan()`` then runs in this thread, so breakpoints and debuggers work.
        Planners given by name run in worker processes. To pass several objects of one class, give them names:
        ``{"gentle": Brakes(1.0), "hard": Brakes(6.0)}``.

        ``world`` states the planner's sensors, as text such as ``"camera, missed=0.2"`` or as a ``World``.

        If runs of a batch are lost, for example because ``plan()`` raised, a warning says so, and the batch contains
        the remaining runs.

        Raises:
            PlannerForgeError: A scenario or a planner does not exist.
        """
        request = read_arguments(
            RunPlannerArguments,
            {
                "scenarios": [str(one) for one in _as_list(scenarios)],
                "configs": self._register_all(planners),
                **_with_world(arguments),
            },
        )
        made = self._wait_for(planning.run_planner, request)
        ids = [line.run_id for line in made.runs]
        if made.batch_id is not None:
            batch = self.stored.get(made.batch_id, "batch").read(BatchRecord)
            ids = list(batch.runs)
            if batch.lost:
                requested = len(batch.lost) + len(ids)
                first = batch.lost[0].error
                warnings.warn(f"{len(batch.lost)} of {requested} runs are lost; the first: {first}", stacklevel=2)
        return Runs(self, made, [Run(self, key) for key in ids])

    def add_planner(self, planner: AnyPlanner) -> str:
        """Register your own planner and return its name for requests, such as ``my_planner:Default``."""
        return self._register(planner)

    def suite(self, path: str | Path) -> SuiteReport:
        """Run the suite in a file and check its limits, as ``plannerforge test`` does.

        Raises:
            PlannerForgeError: The file is not a suite, or refers to something that does not exist.
        """
        file = Path(path)
        return self._caller.call(_run_suite, read_suite(file), file.resolve().parent)

    def resume(self, run_id: str, time_s: float, planner: AnyPlanner) -> RunResponse:
        """Continue a stored run from a time; ``run.at(time_s).resume(planner)`` does the same."""
        return self._caller.call(resume_run, run_id, time_s, self._register(planner))

    def analyse(
        self, results: "Sequence[str | Runs | Run] | str | Runs | Run", **arguments: Any
    ) -> AnalyzeResultsResult:
        """Return rates, metrics, costs and findings of runs (``analyze_results``)."""
        request = read_arguments(AnalyzeResultsArguments, {"results": _ids_of(results), **arguments})
        return self._caller.call(figures.analyze_results, request)

    def compare(self, *results: "str | Runs | Run", **arguments: Any) -> CompareResultsResult:
        """Compare results with paired tests; the first is the baseline (``compare_results``)."""
        request = read_arguments(CompareResultsArguments, {"results": _ids_of(results), **arguments})
        return self._caller.call(comparison.compare_results, request)

    def optimise(
        self, scenarios: "Sequence[str | Scenario] | str | Scenario", base: AnyPlanner = "current", **arguments: Any
    ) -> OptimizePlannerResult:
        """Search for a better configuration, or find the weights that matter, and wait (``optimize_planner``)."""
        given = {
            "scenarios": [str(one) for one in _as_list(scenarios)],
            "base": self._register(base),
            **_with_world(arguments),
        }
        request = read_arguments(OptimizePlannerArguments, given)
        return self._wait_for(optimization.optimize_planner, request)

    def find_failures(
        self, scenario: "str | Scenario", planner: AnyPlanner = "current", **arguments: Any
    ) -> FindFailuresResult:
        """Search for changes of a scenario in which a planner fails, and wait (``find_failures``)."""
        given = {"scenario_id": str(scenario), "config": self._register(planner), **arguments}
        request = read_arguments(FindFailuresArguments, given)
        return self._wait_for(failures.find_failures, request)

    def explore_boundary(
        self,
        scenario: str | Path = "lead_braking",
        configs: "Sequence[AnyPlanner] | AnyPlanner" = "current",
        **arguments: Any,
    ) -> ExploreBoundaryResult:
        """Map where planners begin to fail over two parameters, and wait for the map (``explore_boundary``)."""
        planners = [self._register(one) for one in _as_list(configs)]
        given = {"scenario": str(scenario), "configs": planners, **arguments}
        request = read_arguments(ExploreBoundaryArguments, given)
        return self._wait_for(boundaries.explore_boundary, request)

    def render(self, *things: "str | Scenario | Run | Runs", **arguments: Any) -> tuple[Picture, ...]:
        """Draw pictures, animations and charts (``render``)."""
        ids = _ids_of(things)
        drawing = self._caller.call(rendering.render, read_arguments(RenderArguments, {"ids": ids, **arguments}))
        return tuple(Picture(Path(one.path), one.mime_type, one.alt_text) for one in drawing.made.images)

    def artifacts(self, **arguments: Any) -> ListArtifactsResult:
        """List artifacts or jobs, newest first (``list_artifacts``)."""
        return self._caller.call(artifact_work.list_artifacts, read_arguments(ListArtifactsArguments, arguments))

    def export(
        self, *things: "str | Scenario | Run | Runs", folder: str | Path, **arguments: Any
    ) -> ExportArtifactsResult:
        """Write artifacts, tables, pictures and reports to a folder (``export_artifacts``)."""
        ids = _ids_of(things)
        request = read_arguments(ExportArtifactsArguments, {"ids": ids, "folder": str(folder), **arguments})
        return self._caller.call(exporting.export_artifacts, request)

    def job(self, job_id: str = "latest", **arguments: Any) -> JobResult:
        """Return the state of a job, or wait for its end (``get_job``)."""
        return self._caller.call(
            artifact_work.get_job, read_arguments(GetJobArguments, {"job_id": job_id, **arguments})
        )

    def cancel_job(self, job_id: str = "latest") -> JobResult:
        """Stop a job; finished parts stay (``cancel_job``)."""
        return self._caller.call(artifact_work.cancel_job, read_arguments(CancelJobArguments, {"job_id": job_id}))

    def _wait_for(self, workflow: Callable[..., Awaitable[_Long]], request: Arguments) -> _Long:
        """Wait until the job of a workflow ends, and return the answer, which the same request then finds complete.

        If the caller interrupts the wait, the job is cancelled; finished parts stay.
        """
        answer = self._caller.call(workflow, request)
        while answer.state == "running" and answer.job_id:
            try:
                self.job(answer.job_id, wait_s=_WAIT_S)
            except BaseException:
                self.cancel_job(answer.job_id)
                raise
            answer = self._caller.call(workflow, request)
        if answer.state in ("failed", "cancelled") and answer.job_id:
            job = self.job(answer.job_id, wait_s=0)
            raise NotPossible(f"{job.job_id} {job.state}: {job.error or job.message}", next_step=job.next_step)
        return answer

    def _register_all(self, planners: "Mapping[str, AnyPlanner] | Sequence[AnyPlanner] | AnyPlanner") -> list[str]:
        """Return the names of planners for a request.

        Raises:
            InvalidRequest: Two of them would have the same name.
        """
        if isinstance(planners, Mapping):
            return [self._register(planner, name) for name, planner in planners.items()]
        several = _as_list(planners)
        own = Counter(_name_of(one) for one in {id(one): one for one in several if not isinstance(one, str)}.values())
        twice = [name for name, times in own.items() if times > 1]
        if twice:
            raise InvalidRequest(
                f"two planners are called {twice[0]}",
                valid=[f"{{'first': {twice[0]}_1, 'second': {twice[0]}_2}}"],
                next_step="pass a mapping that gives each a name",
            )
        return [self._register(planner) for planner in several]

    def _register(self, planner: AnyPlanner, name: str = "") -> str:
        """Return a planner's name for a request, and register your own object under a name first."""
        if isinstance(planner, str):
            return planner
        known = next((known for one, known in self._known if one is planner and name in ("", known)), None)
        if known is None:
            known = name or _name_of(planner)
            self._planners.enter_context(registered_objects({known: _registration(planner)}))
            self._known = [(one, other) for one, other in self._known if other != known] + [(planner, known)]
        return f"{known}:Default"


async def _run_suite(suite: Suite, folder: Path, context: WorkflowContext) -> SuiteReport:
    return await carry_out(suite, folder, context, lambda *_: None)


async def _scenarios_of_plan(word: str, context: WorkflowContext) -> tuple[ChosenScenario, ...]:
    return choose_scenarios([word], context).scenarios


def _with_world(arguments: dict[str, Any]) -> dict[str, Any]:
    """Return arguments with a ``World`` as the text that requests take."""
    world = arguments.get("world")
    return {**arguments, "world": world.in_words()} if isinstance(world, World) else arguments


def _as_list(things: Any) -> list[Any]:
    return list(things) if isinstance(things, Sequence) and not isinstance(things, str) else [things]


def _ids_of(things: Any) -> list[str]:
    """Return the ids that requests take for one artifact, or for several in any nesting."""
    if isinstance(things, Runs):
        return things.result_ids
    if isinstance(things, str | Scenario | Run):
        return [str(things)]
    return [key for one in things for key in _ids_of(one)]


def _one_id(scenario: "str | Scenario | Scenarios") -> str:
    """Return the id of one scenario.

    Raises:
        InvalidRequest: The collection has no scenario, or more than one.
    """
    if isinstance(scenario, Scenarios):
        if len(scenario) != 1:
            raise InvalidRequest(
                f"{len(scenario)} scenarios given, but this takes exactly one", valid=list(map(str, scenario))
            )
        return scenario[0].scenario_id
    return str(scenario)


def _registration(planner: OwnPlanner | Planner | type[Planner]) -> PlannerObject:
    """Return a registration for the caller's planner.

    Raises:
        InvalidRequest: The object is not a planner.
    """
    if isinstance(planner, OwnPlanner):
        return PlannerObject(planner, _source(planner.make, planner.declaration.model_dump_json()))
    if isinstance(planner, type):
        return PlannerObject(OwnPlanner(planner, _declaration(planner)), _source(planner, ""))
    if not (callable(getattr(planner, "reset", None)) and callable(getattr(planner, "plan", None))):
        raise InvalidRequest(
            f"{type(planner).__name__} is not a planner",
            valid=["a configuration such as frenetix:Default", "a class or object with reset and plan"],
            next_step="see docs/own_planner.md",
        )
    made = OwnPlanner(lambda: planner, _declaration(type(planner)))
    return PlannerObject(made, _source(type(planner), _state(planner)))


def _declaration(kind: type) -> PlannerDeclaration:
    return PlannerDeclaration(summary=(inspect.getdoc(kind) or kind.__name__).splitlines()[0])


def _name_of(planner: object) -> str:
    """Return a name such as ``my_planner`` for the class ``MyPlanner``, its instances, or an ``OwnPlanner`` of it."""
    maker = planner.make if isinstance(planner, OwnPlanner) else planner if isinstance(planner, type) else type(planner)
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", getattr(maker, "__name__", "own_planner")).lower()


def _source(maker: Any, state: str) -> str:
    """Return text that distinguishes versions of a planner: its source code and the state of the object.

    The code covers the files of its class and base classes and everything they import, except installed packages and
    the standard library. If the code is unknown, every call gets a different version, so no stored run is reused.
    """
    classes = inspect.getmro(maker) if isinstance(maker, type) else (maker,)
    texts = []
    for module in _own_modules([module for one in classes if (module := inspect.getmodule(one)) is not None]):
        with suppress(OSError, TypeError):
            texts.append(inspect.getsource(module))
    if not texts:
        try:
            texts.append(inspect.getsource(maker))  # a class in a notebook cell
        except (OSError, TypeError):
            return uuid.uuid4().hex
    return "".join(texts) + state


def _own_modules(begin: Sequence[ModuleType]) -> list[ModuleType]:
    """Return modules and their imports in a stable order, without the standard library and installed packages."""
    paths = sysconfig.get_paths()
    installed = [Path(paths[name]).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    installed.append(Path(__file__).resolve().parents[1])
    found: dict[str, ModuleType] = {}
    waiting = list(begin)
    while waiting:
        module = waiting.pop()
        file = getattr(module, "__file__", None)
        if module.__name__ in found or file is None:
            continue
        if any(Path(file).resolve().is_relative_to(folder) for folder in installed):
            continue
        found[module.__name__] = module
        used = [inspect.getmodule(value) for value in list(vars(module).values())]
        waiting += [one for one in used if one is not None]
    return [found[name] for name in sorted(found)]


def _state(planner: object) -> str:
    """Return a planner's attributes as text, or a different text each time if they cannot be serialised."""
    if not vars(planner):
        return ""
    try:
        return pickle.dumps(vars(planner)).hex()
    except (TypeError, AttributeError, pickle.PicklingError):
        return uuid.uuid4().hex
