"""Map where planners begin to fail over two parameters of a logical scenario.

An exploration is a job. Points are evaluated in batches on all workers; every evaluated batch is kept in the workspace,
so an interrupted exploration continues where it stopped. The order of batches does not change the map.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import anyio

from ..engine.catalog import open_catalogue
from ..engine.execution import JobProgress
from ..engine.exploration import ROADS, BoundarySearch, area_of, concrete_edits, pre_crash_type
from ..engine.workspace import Artifact, Recipe, append_text, versions_of
from ..schemas.boundaries import (
    LATTICE,
    BoundaryMap,
    BoundaryRecord,
    DescribeLogicalRequest,
    DrawRoadRequest,
    ExploreBoundaryArguments,
    ExploreBoundaryResult,
    FailureExample,
    FailureRate,
    MapArea,
    MapPoint,
    MapSummary,
    PointsRequest,
)
from ..schemas.errors import Faults, InvalidRequest, NotPossible, UnknownName, closest, instead
from ..schemas.exploration import Evaluation, LogicalScenario, Parameter
from ..schemas.grammar import is_unit, parse_interval, parse_quantity
from ..schemas.modification import Edit
from ..schemas.planning import PlannerConfiguration
from ..schemas.reviews import CAREFUL_DRIVERS, kind_in_words
from ..schemas.runs import Traffic
from ..schemas.text import counted
from ..schemas.worlds import World, world_of
from .configurations import resolve_configuration
from .context import WorkflowContext
from .modification import base_and_edits
from .operations import DRAW_ROAD, EVALUATE_POINTS, READ_LOGICAL_SCENARIO
from .runs import own_versions
from .scenario_storage import store_scenario
from .scenarios import one_scenario

_TOOL = "explore_boundary"
EXPLORED_FOLDER = "explored"
"""The workspace's folder of evaluated points, here and of searches for failures."""
BATCH = 8
"""Points of a batch (chosen): a few seconds of work, so progress is steady and an interruption loses little."""
_MOST_SLICES = 6
"""The most maps of one planner (chosen), since each is a whole exploration."""
_SHOWN_REASONS = 2
RANKS = {
    ("failed_avoidably", "safe"): 0,
    ("failed_unavoidably", "safe"): 0,
    ("failed_avoidably", "failed_unavoidably"): 1,
    ("implausible", "safe"): 2,
    ("failed_avoidably", "implausible"): 2,
    ("failed_unavoidably", "implausible"): 2,
}
"""Edges between failing and not failing matter most, those of what is plausible least (chosen)."""


@dataclass(frozen=True)
class _Plan:
    """All resolved arguments of an exploration; ``slices`` are the values of the parameters that are not mapped."""

    logical: LogicalScenario
    axes: tuple[Parameter, Parameter]
    slices: tuple[dict[str, float], ...]
    base: Artifact
    xml: Path
    earlier: tuple[Edit, ...]
    problem_id: int | None
    configurations: tuple[PlannerConfiguration, ...]
    references: tuple[PlannerConfiguration, ...]
    traffic: Traffic
    world: World
    arguments: ExploreBoundaryArguments

    def recipe(self) -> Recipe:
        """Return the recipe; its digest is the map's id."""
        given = self.arguments
        everyone = (*self.configurations, *self.references)
        return Recipe(
            tool=_TOOL,
            arguments={
                "scenario": self.logical.model_dump(mode="json"),
                "axes": [axis.model_dump(mode="json") for axis in self.axes],
                "slices": list(self.slices),
                "base": self.base.artifact_id,
                "problem": self.problem_id,
                "configs": [one.config_id for one in self.configurations],
                "references": [one.config_id for one in self.references],
                "points": given.points,
                "prediction": given.prediction,
                "traffic": self.traffic,
                **({} if self.world.is_perfect else {"world": self.world.stated}),
            },
            parents=(self.base.artifact_id, *dict.fromkeys(one.config_id for one in self.configurations)),
            seed=given.seed,
            versions=versions_of("frenetix", "commonroad-io", "commonroad-drivability-checker", "libsumo")
            | own_versions(one.planner for one in everyone),
        )


async def explore_boundary(arguments: ExploreBoundaryArguments, context: WorkflowContext) -> ExploreBoundaryResult:
    """Map where planners fail, or return the stored map.

    Raises:
        UnknownName: there is no such logical scenario, parameter, base or configuration.
        InvalidRequest: the number of parameters left to map is not two, or a value cannot be parsed.
        NotPossible: a value beyond the usual range is implausible, whatever the other parameters are.
    """
    plan = await _plan(arguments, context)
    recipe, asked = plan.recipe(), arguments.scenario
    stored = context.workspace.find_by_recipe("boundary", recipe)
    if stored is not None:
        return await _finished(stored.read(BoundaryRecord), context, asked)
    await _check_values(plan, arguments.over, context)

    async def work(progress: JobProgress) -> None:
        own = WorkflowContext(context.services)
        record = await _Exploration(plan, recipe, own, progress).record()
        name = f"{record.scenario.name} {' '.join(one.name for one in plan.configurations)}"
        own.workspace.put("boundary", record.boundary_id, recipe=recipe, record=record, name=name)
        progress.add_result(record.boundary_id)
        (own.workspace.root / EXPLORED_FOLDER / f"{recipe.digest}.jsonl").unlink(missing_ok=True)
        progress.report(1.0, "boundary mapped")

    job = context.start_job("boundary", recipe, work)
    context.made("job", job.job_id)
    job = await context.wait_for(job.job_id, arguments.wait_s)
    stored = context.workspace.find_by_recipe("boundary", recipe)
    if stored is not None:
        return await _finished(stored.read(BoundaryRecord), context, asked)
    return ExploreBoundaryResult(
        state=job.state,
        job_id=job.job_id,
        message=job.error or job.message,
        next_step=f"get_job with job_id '{job.job_id}', then repeat explore_boundary: evaluated points are kept",
    )


async def _plan(arguments: ExploreBoundaryArguments, context: WorkflowContext) -> _Plan:
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    logical = await _logical(arguments.scenario, context)
    axes, fixed = _axes(arguments.over, logical)
    context.remarks += _remarks_on(arguments.over, axes, fixed, logical)
    configurations = tuple(resolve_configuration(text, context) for text in arguments.configs)
    named = {one.planner for one in configurations}
    references = tuple(
        resolve_configuration(name, context) for name in CAREFUL_DRIVERS if arguments.references and name not in named
    )
    world = world_of(arguments.world)
    # The base comes last, because a road is stored: a refused call stores nothing.
    base, problem_id = await _base(arguments.base or logical.base, context)
    base_id, earlier = base_and_edits(base)
    return _Plan(
        logical=logical,
        axes=axes,
        slices=fixed,
        base=base,
        xml=context.workspace.file("scenario", base_id, "scenario.xml"),
        earlier=earlier,
        problem_id=problem_id,
        configurations=configurations,
        references=references,
        traffic=arguments.traffic or logical.traffic,
        world=world,
        arguments=arguments,
    )


async def _logical(text: str, context: WorkflowContext) -> LogicalScenario:
    if text.lower().endswith((".yaml", ".yml", ".xosc")):
        request = DescribeLogicalRequest(path=str(context.allowed_path(text)), roots=context.limits.roots)
        return await context.run(READ_LOGICAL_SCENARIO, request)
    return await context.run(READ_LOGICAL_SCENARIO, DescribeLogicalRequest(name=text))


def _axes(
    over: Sequence[str], logical: LogicalScenario
) -> tuple[tuple[Parameter, Parameter], tuple[dict[str, float], ...]]:
    """Return the two mapped parameters with their ranges, and the values of the others, one entry per slice.

    Without any range, the first parameters of the logical scenario are mapped.
    """
    names = [one.name for one in logical.parameters]
    _check_names(over, logical.name, names)
    ranged: dict[str, Parameter] = {}
    valued: dict[str, list[float]] = {}
    for text in over:
        name, _, value = (part.strip() for part in text.partition("="))
        name = name if name in names else name.lower()
        parameter = logical.parameter(name)
        if not value and not parameter.is_fixed:
            ranged[name] = parameter
        elif not value:
            raise InvalidRequest(f"{name} has no range", valid=[f"{name}=LOW..HIGH"])
        elif "," in value or not any(mark in value for mark in ("..", "±", ">", "<")):
            valued[name] = [parse_quantity(one) for one in value.split(",")]
        else:
            interval = parse_interval(value)
            low = parameter.low if interval.low is None else interval.low
            high = parameter.high if interval.high is None else interval.high
            if low >= high:
                raise InvalidRequest(f"{name}: {low:g} to {high:g} is not a range", valid=[f"{name}=LOW..HIGH"])
            ranged[name] = parameter.model_copy(update={"low": low, "high": high})
    for name in names:
        if len(ranged) < 2 and name not in ranged and name not in valued and not logical.parameter(name).is_fixed:
            ranged[name] = logical.parameter(name)
    if len(ranged) != 2:
        raise InvalidRequest(
            f"a map needs two parameters with ranges, not {len(ranged)}",
            valid=[f"{one.name}={_range_of(one)}" for one in logical.parameters],
            next_step="give two ranges in 'over', and values for the others",
        )
    one, other = ranged.values()
    others = {name: valued.get(name, [logical.parameter(name).base_value]) for name in names if name not in ranged}
    slices = tuple(dict(zip(others, values, strict=True)) for values in product(*others.values()))
    if len(slices) > _MOST_SLICES:
        raise InvalidRequest(
            f"these values give {len(slices)} slices", valid=[f"at most {_MOST_SLICES}"], next_step="give fewer values"
        )
    return (one, other), slices


def _remarks_on(
    over: Sequence[str], axes: Sequence[Parameter], fixed: Sequence[Mapping[str, float]], logical: LogicalScenario
) -> list[str]:
    """Return a sentence for each value beyond its usual range, and for each parameter that the call did not give."""
    remarks = []
    given = {text.partition("=")[0].strip().lower() for text in over}
    ends = {axis.name: [axis.low, axis.high] for axis in axes}
    for at in fixed:
        for name, value in at.items():
            ends.setdefault(name, []).append(value)
    for name, values in ends.items():
        usual = logical.parameter(name)
        if name.lower() in given and not usual.is_fixed and not usual.low <= min(values) <= max(values) <= usual.high:
            remarks.append(f"{name} goes beyond its usual range in {logical.name}, {_range_of(usual)}.")
    chosen = [f"{axis.name}={_range_of(axis)}" for axis in axes if given and axis.name.lower() not in given]
    return [*remarks, *(f"A map has two parameters, so {text} is mapped, too." for text in chosen)]


async def _check_values(plan: _Plan, over: Sequence[str], context: WorkflowContext) -> None:
    """Refuse values beyond the usual range at which every tried point is implausible.

    Such values have no outcome on this road, such as a gap that is longer than the road. The refusal gives the last
    plausible value.
    """
    given = {text.partition("=")[0].strip().lower(): text for text in over}
    faults = Faults()
    for name, value, usual in _beyond(plan):
        reason = await _implausible(plan, name, value, context)
        if not reason:
            continue
        good, bad = (usual.high, value) if value > usual.high else (usual.low, value)
        for _ in range(_HALVINGS):
            middle = (good + bad) / 2
            good, bad = (good, middle) if await _implausible(plan, name, middle, context) else (middle, bad)
        axis = next((one for one in plan.axes if one.name == name), None)
        low, high = (usual.low, good) if axis is None else (axis.low, good) if value > usual.high else (good, axis.high)
        valid = f"{name}={low:.4g}..{high:.4g}" if axis is not None else f"{name}={good:.4g}"
        with faults.collecting():
            raise NotPossible(
                f"{name}={value:g} is implausible with all values of the others that were tried: {reason}",
                valid=[valid],
                next_step="choose a smaller range",
                remedies=[instead(given[name.lower()], valid, "over")] if name.lower() in given else [],
            )
    faults.raise_all()


_HALVINGS = 8
"""How often the range between a usual and an implausible value is halved for the last plausible one (chosen)."""
_TRIED_SHARES = (0.0, 0.5, 1.0)
"""The shares of the other ranges at which a value is tried (chosen: both ends and the middle)."""
_TRYING = "keep_lane"
"""The planner of these points: a point is implausible whatever the planner, and this one needs the least time."""


def _beyond(plan: _Plan) -> list[tuple[str, float, Parameter]]:
    """Return the requested values outside their usual ranges: the ends of mapped ranges, and the fixed values."""
    values = {(axis.name, end) for axis in plan.axes for end in (axis.low, axis.high)}
    values |= {(name, value) for at in plan.slices for name, value in at.items()}
    found = ((name, value, plan.logical.parameter(name)) for name, value in sorted(values))
    return [one for one in found if not one[2].is_fixed and not one[2].low <= one[1] <= one[2].high]


async def _implausible(plan: _Plan, name: str, value: float, context: WorkflowContext) -> str:
    """Return why all tried points with a value of a parameter are implausible; empty if one of them is plausible."""
    mapped = ({axis.name: axis.at_share(share) for axis in plan.axes} for share in _TRIED_SHARES)
    points = tuple({**plan.slices[0], **values, name: value} for values in mapped)
    request = PointsRequest(
        xml=plan.xml,
        configuration=resolve_configuration(_TRYING, context),
        problem_id=plan.problem_id,
        earlier=plan.earlier,
        traffic=plan.traffic,
        seed=plan.arguments.seed,
        horizon_s=plan.logical.horizon_s,
        logical=plan.logical,
        points=points,
    )
    response = await context.run(EVALUATE_POINTS, request, share=(0.0, 0.0))
    evaluations = response.evaluations
    is_implausible = all(one.outcome == "implausible" for one in evaluations)
    return evaluations[0].reason.rstrip(".") if is_implausible else ""


def _range_of(parameter: Parameter) -> str:
    return "LOW..HIGH" if parameter.is_fixed else f"{parameter.low:g}..{parameter.high:g}"


def _check_names(over: Sequence[str], logical: str, names: Sequence[str]) -> None:
    """Refuse unknown parameters, all together.

    A similar parameter is proposed without the values if they are no numbers, or in another unit, so that they would
    mean something else there.
    """
    given, faults = {text: text.partition("=")[0].strip() for text in over}, Faults()
    taken = set(given.values())
    for text, name in given.items():
        if name in names or name.lower() in names:
            continue
        others = closest(name, [one for one in names if one not in taken])
        taken |= set(others[:1])
        unit = name.lower().rpartition("_")[2]
        numeric = _is_numeric(text.partition("=")[2])
        keeps = {one: numeric and (one.rpartition("_")[2] == unit or not is_unit(unit)) for one in others}
        remedies = [instead(name, one) if keeps[one] else instead(text, one) for one in others]
        with faults.collecting():
            raise UnknownName(f"{logical} has no parameter '{name}'", valid=names, remedies=remedies)
    faults.raise_all()


def _is_numeric(values: str) -> bool:
    """Return True if a text is a range or a list of numbers, as a parameter has them; also if it is empty."""
    try:
        for value in filter(None, map(str.strip, values.split(","))):
            parse_interval(value)
    except InvalidRequest:
        return False
    return True


async def _base(text: str, context: WorkflowContext) -> tuple[Artifact, int | None]:
    """Return a scenario with its planning problem, if the text names one.

    The scenario of a built-in road is generated and stored on first use.
    """
    if text not in ROADS:
        return one_scenario(text, context)
    recipe = Recipe(tool=_TOOL, arguments={"road": text}, parents=(), seed=0, versions=versions_of())
    stored = context.workspace.find_by_recipe("scenario", recipe)
    if stored is None:
        with context.workspace.scratch() as folder:
            path = folder / "scenario.xml"
            await context.run(DRAW_ROAD, DrawRoadRequest(road=text, path=str(path)))
            stored = await store_scenario(context, xml=path, net=None, recipe=recipe, origin="generated")
    return stored, None


@dataclass(frozen=True)
class _Exploration:
    """One exploration: all its maps, computed from stored evaluations and from new evaluations by workers."""

    plan: _Plan
    recipe: Recipe
    context: WorkflowContext
    progress: JobProgress

    async def record(self) -> BoundaryRecord:
        """Make all maps."""
        plan = self.plan
        kept = self._kept()
        wanted = [
            (configuration, at, configuration in plan.references)
            for configuration in (*plan.configurations, *plan.references)
            for at in plan.slices
        ]
        maps = []
        for number, (configuration, at, is_reference) in enumerate(wanted):
            maps.append(await self._map(configuration, at, kept, (number, len(wanted)), is_reference=is_reference))
        return BoundaryRecord(
            boundary_id=f"boundary_{self.recipe.digest}",
            scenario=plan.logical,
            base_id=plan.base.artifact_id,
            axes=plan.axes,
            prediction=plan.arguments.prediction,
            traffic=plan.traffic,
            seed=plan.arguments.seed,
            world=plan.world,
            maps=tuple(maps),
        )

    async def _map(
        self,
        configuration: PlannerConfiguration,
        at: dict[str, float],
        kept: dict[str, Evaluation],
        part: tuple[int, int],
        *,
        is_reference: bool,
    ) -> BoundaryMap:
        budget = self.plan.arguments.points
        search = BoundarySearch(budget, RANKS, self.plan.arguments.seed)
        found: dict[tuple[int, int], Evaluation] = {}

        def done(place: tuple[int, int], evaluation: Evaluation) -> None:
            found[place] = evaluation
            share = (part[0] + min(len(found) / budget, 1.0)) / part[1]
            of_maps = f"map {part[0] + 1} of {part[1]}, {configuration.name}"
            self.progress.report(share, f"{of_maps}: {len(found)} of at most {budget} points")

        while places := search.ask():
            known = {place: kept[key] for place in places if (key := _key(configuration, at, place)) in kept}
            for place, evaluation in known.items():
                done(place, evaluation)
            missing = [place for place in places if place not in known]
            await self._evaluate(configuration, at, missing, done)
            search.tell({place: found[place].outcome for place in places})
        outcomes = dict.fromkeys(search.labels[place] for place in found)
        areas = (
            MapArea(outcome=outcome, share=area.share, low=area.low, high=area.high)
            for outcome in sorted({*outcomes, "failed_avoidably"})
            for area in [area_of(outcome, search)]
        )
        return BoundaryMap(
            config_id=configuration.config_id,
            config_name=configuration.name,
            planner=configuration.planner,
            is_reference=is_reference,
            at=at,
            points=tuple(MapPoint(place=place, evaluation=found[place]) for place in sorted(found)),
            cells=tuple((*cell.low, cell.size) for cell in search.cells),
            areas=tuple(areas),
            rate=None if is_reference else _rate(self.plan, at, search),
        )

    async def _evaluate(
        self,
        configuration: PlannerConfiguration,
        at: dict[str, float],
        places: Sequence[tuple[int, int]],
        done: Callable[[tuple[int, int], Evaluation], None],
    ) -> None:
        """Evaluate places in batches on all workers, and keep each batch as soon as it is done."""
        waiting = [places[begin : begin + BATCH] for begin in range(0, len(places), BATCH)]

        async def work() -> None:
            while waiting:
                batch = waiting.pop(0)
                request = self._request(configuration, at, batch)
                response = await self.context.services.workers.run(EVALUATE_POINTS, request)
                self._keep(configuration, at, batch, response.evaluations)
                for place, evaluation in zip(batch, response.evaluations, strict=True):
                    done(place, evaluation)

        async with anyio.create_task_group() as tasks:
            for _ in range(min(self.context.services.workers.capacity, len(waiting))):
                tasks.start_soon(work)

    def _request(
        self, configuration: PlannerConfiguration, at: dict[str, float], batch: Sequence[tuple[int, int]]
    ) -> PointsRequest:
        plan = self.plan
        return PointsRequest(
            xml=plan.xml,
            configuration=configuration,
            problem_id=plan.problem_id,
            earlier=plan.earlier,
            traffic=plan.traffic,
            prediction=plan.arguments.prediction,
            seed=plan.arguments.seed,
            world=plan.world,
            horizon_s=plan.logical.horizon_s,
            logical=plan.logical,
            points=tuple(_values(plan.axes, place, at) for place in batch),
        )

    @property
    def _path(self) -> Path:
        return self.context.workspace.root / EXPLORED_FOLDER / f"{self.recipe.digest}.jsonl"

    def _kept(self) -> dict[str, Evaluation]:
        """Return the evaluations that an interrupted exploration kept; an unfinished last line is ignored."""
        found: dict[str, Evaluation] = {}
        if self._path.is_file():
            for line in self._path.read_text(encoding="utf-8").splitlines():
                try:
                    entry = json.loads(line)
                    found[entry["key"]] = Evaluation.model_validate(entry["evaluation"])
                except (ValueError, KeyError, TypeError):
                    continue
        return found

    def _keep(
        self,
        configuration: PlannerConfiguration,
        at: dict[str, float],
        batch: Sequence[tuple[int, int]],
        evaluations: Sequence[Evaluation],
    ) -> None:
        """Append a batch to the kept evaluations.

        Raises:
            ResourceFailure: the disk is full.
        """
        lines = [
            json.dumps({"key": _key(configuration, at, place), "evaluation": one.model_dump(mode="json")}) + "\n"
            for place, one in zip(batch, evaluations, strict=True)
        ]
        append_text(self._path, "".join(lines), "the exploration")


def _rate(plan: _Plan, at: dict[str, float], search: BoundarySearch) -> FailureRate | None:
    """Return the avoidable failures per million encounters, if a mapped parameter has a distribution."""
    if all(axis.distribution is None for axis in plan.axes):
        return None
    one, other = plan.axes
    found = area_of(
        "failed_avoidably",
        search,
        (lambda place: one.share_below(place / LATTICE), lambda place: other.share_below(place / LATTICE)),
    )
    million = 1_000_000
    return FailureRate(
        per_million=found.share * million,
        low=found.low * million,
        high=found.high * million,
        assumptions=_assumptions(plan.axes, at),
    )


def _assumptions(axes: tuple[Parameter, Parameter], at: dict[str, float]) -> str:
    """Return the assumptions of a rate, as clauses of one sentence."""
    clauses = []
    for axis in axes:
        known = axis.distribution
        within = f"{axis.name} from {axis.low:g} to {axis.high:g}"
        if known is None:
            clauses.append(f"all values of {within} are equally frequent")
        else:
            source = f" ({known.source})" if known.source else ""
            clauses.append(f"{within} has its {known.kind} distribution{source}")
    clauses.append("the two are independent")
    clauses += [f"{name} is {value:g}" for name, value in at.items()]
    return f"{', '.join(clauses[:-1])} and {clauses[-1]}"


def _values(axes: tuple[Parameter, Parameter], place: tuple[int, int], at: dict[str, float]) -> dict[str, float]:
    mapped = {axis.name: round(axis.at_share(step / LATTICE), 4) for axis, step in zip(axes, place, strict=True)}
    return at | mapped


def _key(configuration: PlannerConfiguration, at: dict[str, float], place: tuple[int, int]) -> str:
    return json.dumps([configuration.config_id, sorted(at.items()), place])


async def _finished(record: BoundaryRecord, context: WorkflowContext, asked: str = "") -> ExploreBoundaryResult:
    """Return the result of a stored map; ``asked``: the name by which its logical scenario was requested."""
    context.made("boundary", record.boundary_id)
    examples = []
    for one in record.maps:
        nearest = record.nearest_to_base(one.failures)
        if nearest is not None and not one.is_reference:
            examples.append(_example(record, one, nearest))
    reasons = Counter(
        point.evaluation.reason
        for one in record.maps
        if not one.is_reference
        for point in one.points
        if point.evaluation.outcome == "implausible"
    )
    return ExploreBoundaryResult(
        state="done",
        boundary_id=record.boundary_id,
        headline=_headline(record, asked),
        maps=tuple(_summary(one) for one in record.maps),
        examples=tuple(examples),
        implausible=tuple(f"{reason} ({count})" for reason, count in reasons.most_common(_SHOWN_REASONS)),
        notes=(*record.scenario.notes, *_contradictions(record)),
        next_step=f"render ids ['{record.boundary_id}'] for the map"
        + (
            "; to rebuild an example as a scenario, call modify_scenario with its edits"
            if examples
            else _harder(record)
        ),
    ).with_record(record)


def _contradictions(record: BoundaryRecord) -> list[str]:
    """Return a note if a planner is safe at points at which the failure of another counts as unavoidable."""
    outcomes: dict[str, set[str]] = {}
    for one in record.maps:
        for point in one.points:
            key = json.dumps([sorted(one.at.items()), point.place])
            outcomes.setdefault(key, set()).add(point.evaluation.outcome)
    count = sum({"safe", "failed_unavoidably"} <= found for found in outcomes.values())
    if not count:
        return []
    where = f"at {counted(count, 'point')}, one planner is safe and the failure of another counts as unavoidable"
    return [f"{where}, because only the two reference drivers decide what is avoidable"]


def _harder(record: BoundaryRecord) -> str:
    """Return how to go on after a map without avoidable failures: with other values of the fixed parameters."""
    fixed = {name: value for one in record.maps for name, value in one.at.items()}
    by_name = {parameter.name: parameter for parameter in record.scenario.parameters}
    shown = [
        f"{name} (now {value:g}, {by_name[name].low:g} to {by_name[name].high:g} {by_name[name].unit})".replace(
            " )", ")"
        )
        for name, value in fixed.items()
        if name in by_name
    ]
    return f"; repeat explore_boundary with another {' or '.join(shown)} in over" if shown else ""


def _headline(record: BoundaryRecord, asked: str) -> str:
    ranges = (f"{axis.name} {axis.low:g} to {axis.high:g} {axis.unit}".rstrip() for axis in record.axes)
    world = "" if record.world.is_perfect else f" (world {record.world.in_words()})"
    mapped = f"{record.scenario.name} over {' × '.join(ranges)}, on {record.base_id}{world}"
    found = pre_crash_type(asked)
    if found is None:
        return mapped
    others = [name for name in found.scenarios if name != record.scenario.name]
    also = f", also in {' and '.join(others)}" if others else ""
    return f"{mapped} (NHTSA type {found.number}, {found.name.lower()}, {found.percent:.2f} % of crashes{also})"


def _summary(one: BoundaryMap) -> MapSummary:
    return MapSummary(
        config_id=one.config_id,
        config_name=one.config_name,
        is_reference=one.is_reference,
        at=one.at,
        points=len(one.points),
        areas=one.areas,
        rate=one.rate,
    )


def _example(record: BoundaryRecord, one: BoundaryMap, point: MapPoint) -> FailureExample:
    values = record.values_at(point.place, one.at)
    shown = ", ".join(f"{name} {value:g}" for name, value in values.items())
    evaluation = point.evaluation
    met = f" ({kind_in_words(evaluation.contact)})" if evaluation.contact else ""
    when = "" if evaluation.time_s is None else f" at {evaluation.time_s:.1f} s"
    return FailureExample(
        config_id=one.config_id,
        values=values,
        what=f"{one.config_name} at {shown}: {evaluation.run_outcome or 'failure'}{met}{when}",
        base_id=record.base_id,
        edits=tuple(
            edit.model_dump(mode="json", exclude_defaults=True) for edit in concrete_edits(record.scenario, values)
        ),
    )
