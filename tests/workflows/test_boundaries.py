"""Maps of boundaries: made in batches, resumed after an interruption, repeated by ordinary edits, and drawn."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support.openscenario import single, story, varied

from benchmarks.harness import call_in_process
from plannerforge.engine.execution import Limits
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.exploration import BoundarySearch
from plannerforge.engine.planners.runs import run_planner
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.boundaries import LATTICE, BoundaryRecord, ExploreBoundaryArguments, MapSummary, PointsRequest
from plannerforge.schemas.errors import InvalidRequest, NotPossible, OutsideRoots, ResourceFailure, UnknownName
from plannerforge.schemas.exploration import Distribution
from plannerforge.schemas.modification import ModifyScenarioArguments
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.rendering import RenderArguments
from plannerforge.workflows import boundaries
from plannerforge.workflows.context import WorkflowContext
from plannerforge.workflows.modification import modify_scenario
from plannerforge.workflows.rendering import render

SMALL: dict[str, Any] = {
    "scenario": "cut_in",
    "over": ["gap_m=4..30", "closing_mps=0..12"],
    "configs": ["keep_lane"],
    "points": 30,
    "references": False,
}


class Counting:
    """An executor in this process that counts the points that it evaluates."""

    capacity = 1

    def __init__(self, inner: Any) -> None:
        self._inner, self.points = inner, 0

    async def run(self, operation: Any, request: Any, **given: Any) -> Any:
        self.points += len(request.points) if isinstance(request, PointsRequest) else 0
        return await self._inner.run(operation, request, **given)


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WorkflowContext]:
    workspace = Workspace(tmp_path_factory.mktemp("explored"))
    services = call_in_process(workspace).services
    yield WorkflowContext(replace(services, workers=Counting(services.workers)))
    workspace.close()


async def explored(context: WorkflowContext, **given: Any) -> tuple[BoundaryRecord, int]:
    """Return a map, and the number of points that were evaluated for it."""
    plan = await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, **given}), context)
    progress: Any = SimpleNamespace(report=lambda share, message: None)
    before = context.services.workers.points  # type: ignore[attr-defined]
    record = await boundaries._Exploration(plan, plan.recipe(), context, progress).record()
    return record, context.services.workers.points - before  # type: ignore[attr-defined]


@pytest.mark.anyio
async def test_a_map_has_bounded_areas_and_an_example_that_edits_repeat(context: WorkflowContext) -> None:
    record, evaluated = await explored(context)
    only = record.maps[0]
    assert 25 <= evaluated == len(only.points) <= 30
    avoidable = only.area("failed_avoidably")
    assert avoidable is not None
    assert 0.0 < avoidable.low <= avoidable.share <= avoidable.high < 1.0
    result = await boundaries._finished(record, context)
    example = result.examples[0]
    edits = ModifyScenarioArguments.model_validate({"scenario_id": example.base_id, "edits": list(example.edits)})
    edited = await modify_scenario(edits, context)
    plan = await boundaries._plan(ExploreBoundaryArguments(**SMALL), context)
    request = RunRequest(
        run_id="run_1",
        scenario_path=str(context.workspace.file("scenario", edited.scenario_id or "", "scenario.xml")),
        scenario_id=edited.scenario_id or "",
        configuration=plan.configurations[0],
    )
    run = run_planner(request, silent).record
    nearest = record.nearest_to_base(only.failures)
    assert nearest is not None
    assert run.collision is not None
    assert run.collision.time_s == nearest.evaluation.time_s
    assert len(result.answer().to_text()) < 2000


@pytest.mark.anyio
async def test_an_interrupted_exploration_continues_with_the_points_that_are_kept(context: WorkflowContext) -> None:
    whole, _ = await explored(context)
    plan = await boundaries._plan(ExploreBoundaryArguments(**SMALL), context)
    path = context.workspace.root / "explored" / f"{plan.recipe().digest}.jsonl"
    kept = path.read_text(encoding="utf-8").splitlines()
    assert len(kept) == len(whole.maps[0].points)
    path.write_text("\n".join([*kept[:-9], kept[-9][:40]]), encoding="utf-8")
    resumed, again = await explored(context)
    assert again == 9
    assert resumed == whole


@pytest.mark.anyio
async def test_points_that_cannot_be_kept_end_the_exploration_as_a_full_disk_does(context: WorkflowContext) -> None:
    plan = await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, "points": 31}), context)
    path = context.workspace.root / "explored" / f"{plan.recipe().digest}.jsonl"
    path.mkdir(parents=True)  # a folder cannot be written as a file
    with pytest.raises(ExceptionGroup) as failure:
        await explored(context, points=31)
    assert failure.group_contains(ResourceFailure)


@pytest.mark.anyio
async def test_the_other_parameters_are_slices(context: WorkflowContext) -> None:
    over = [*SMALL["over"], "ego_speed_mps=20,25", "lateral_mps=1.5"]
    plan = await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, "over": over}), context)
    assert [axis.name for axis in plan.axes] == ["gap_m", "closing_mps"]
    assert plan.slices == ({"lateral_mps": 1.5, "ego_speed_mps": 20.0}, {"lateral_mps": 1.5, "ego_speed_mps": 25.0})


@pytest.mark.anyio
async def test_a_map_says_in_which_world_it_was_made(context: WorkflowContext) -> None:
    world = "occlusion, missed=0.1"
    await explored(context)
    usual, other = [
        context.workspace.root / "explored" / f"{plan.recipe().digest}.jsonl"
        for more in ({}, {"world": world})
        for plan in [await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, **more}), context)]
    ]
    kept = usual.read_text(encoding="utf-8").splitlines(keepends=True)
    other.write_text("".join(kept[:-2]), encoding="utf-8")  # as if most points had been driven in that world before
    record, evaluated = await explored(context, world=world)
    assert evaluated
    told = await boundaries._finished(record, context)
    assert "(world occlusion, missed=0.1)" in told.answer().to_text()


@pytest.mark.anyio
async def test_a_map_is_drawn(context: WorkflowContext) -> None:
    record, _ = await explored(context)
    plan = await boundaries._plan(ExploreBoundaryArguments(**SMALL), context)
    context.workspace.put("boundary", record.boundary_id, recipe=plan.recipe(), record=record, name="cut_in")
    drawing = await render(RenderArguments(ids=[record.boundary_id]), context)
    assert drawing.made.kind == "boundary"
    assert "failed avoidably" in drawing.made.images[0].alt_text
    assert Path(drawing.made.images[0].path).stat().st_size > 10_000


@pytest.mark.anyio
async def test_an_openscenario_file_is_mapped_with_notes_on_what_it_leaves_out(
    context: WorkflowContext, tmp_path: Path
) -> None:
    own = WorkflowContext(replace(context.services, limits=Limits((tmp_path,))))
    (tmp_path / "story.xosc").write_text(story(), encoding="utf-8")
    limits = '<Range lowerLimit="20" upperLimit="60"/>'
    (tmp_path / "ranges.xosc").write_text(
        varied(
            single("Gap", f"<UniformDistribution>{limits}</UniformDistribution>")
            + single("Rate", '<NormalDistribution expectedValue="4" variance="1"/>')
            + single("Lane", "<ProbabilityDistributionSet><Element value='l' weight='1'/></ProbabilityDistributionSet>")
        ),
        encoding="utf-8",
    )
    given = {"scenario": str(tmp_path / "ranges.xosc"), "over": ["Gap=20..40", "Rate", "Speed=72"]}
    plan = await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, **given}), own)
    assert [axis.name for axis in plan.axes] == ["gap", "rate"]
    assert plan.slices == ({"speed": 72.0},)
    assert plan.base.artifact_id.startswith("ZAM_ThreeLanesLong")
    record, _ = await explored(context)
    result = await boundaries._finished(record.model_copy(update={"scenario": plan.logical, "maps": ()}), own)
    assert any("Lane" in note for note in result.notes)
    assert any("Lane" in warning for warning in result.answer().warnings)
    with pytest.raises(OutsideRoots):
        await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, "scenario": "/etc/ranges.xosc"}), own)
    with pytest.raises(InvalidRequest) as refusal:
        await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, **given, "over": ["Speed"]}), own)
    assert refusal.value.valid == ("speed=LOW..HIGH",)


@pytest.mark.anyio
async def test_a_rate_weighs_the_failures_by_the_distributions_of_the_parameters(context: WorkflowContext) -> None:
    plan = await boundaries._plan(ExploreBoundaryArguments(**SMALL), context)
    search = BoundarySearch(60)
    while places := search.ask():
        search.tell({place: "failed_avoidably" if place[0] < LATTICE / 2 else "safe" for place in places})
    assert boundaries._rate(plan, plan.slices[0], search) is None
    gap, closing = plan.axes
    bins = ((gap.low, (gap.low + gap.high) / 2, 1.0), ((gap.low + gap.high) / 2, gap.high, 9.0))
    known = gap.model_copy(update={"distribution": Distribution(kind="histogram", bins=bins, source="counted")})
    rate = boundaries._rate(replace(plan, axes=(known, closing)), {"ego_speed_mps": 20.0}, search)
    assert rate is not None
    assert rate.low <= 100_000 <= rate.high
    assert rate.per_million == pytest.approx(100_000, rel=0.1)
    words = ("gap_m", "histogram", "counted", "closing_mps", "equally frequent", "independent", "ego_speed_mps is 20")
    assert all(word in rate.in_words() for word in words)
    mapped = MapSummary(config_id="c", config_name="n", points=60, areas=(), rate=rate)
    assert rate.in_words() in mapped.in_words()


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"scenario": "cut_inn"}, UnknownName),
        ({"scenario": "nhtsa:1"}, NotPossible),
        ({"scenario": "nhtsa:40"}, UnknownName),
        ({"over": ["gap=4..9"]}, UnknownName),
        ({"over": ["gap_m=9..4"]}, InvalidRequest),
        ({"over": ["gap_m=5", "closing_mps=3", "lateral_mps=1"]}, InvalidRequest),
        ({"over": [*SMALL["over"], "ego_speed_mps=1,2,3,4,5,6,7"]}, InvalidRequest),
        ({"base": "DEU_Nowhere-1_1_T-1"}, UnknownName),
    ],
)
@pytest.mark.anyio
async def test_what_cannot_be_mapped_is_refused(
    given: dict[str, Any], error: type[Exception], context: WorkflowContext
) -> None:
    with pytest.raises(error):
        await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, **given}), context)


@pytest.mark.anyio
async def test_a_map_of_a_pre_crash_type_names_the_type_and_its_other_scenarios(context: WorkflowContext) -> None:
    record, _ = await explored(context)
    named, asked = [await boundaries._finished(record, context, scenario) for scenario in ("cut_in", "nhtsa:18")]
    assert "NHTSA" not in named.headline
    assert "type 18" in asked.headline
    assert "also in merge" in asked.headline


@pytest.mark.anyio
async def test_a_value_in_another_unit_is_not_carried_over_to_another_parameter(context: WorkflowContext) -> None:
    given = {**SMALL, "over": ["gap_s=0.3..2", "speed_difference_mps=0..10"]}
    with pytest.raises(UnknownName) as refused:
        await boundaries._plan(ExploreBoundaryArguments(**given), context)
    proposed = {old: new for change in refused.value.remedies[0].changes for old, new in change.words.items()}
    assert proposed["gap_s=0.3..2"] == "gap_m"
    assert proposed["speed_difference_mps"].endswith("_mps")


@pytest.mark.anyio
@pytest.mark.parametrize("over", ["colour=red", "gap=near", "speed_mps=fast..slow", "gap_m2=3m..red"])
async def test_values_that_no_parameter_can_have_are_not_carried_over_to_another_one(
    over: str, context: WorkflowContext
) -> None:
    with pytest.raises(UnknownName) as refused:
        await boundaries._plan(ExploreBoundaryArguments(**{**SMALL, "over": [over]}), context)
    proposed = [new for remedy in refused.value.remedies for change in remedy.changes for new in change.words.values()]
    assert proposed
    assert not any("=" in new for new in proposed)
    assert all(over in change.words for remedy in refused.value.remedies for change in remedy.changes)


@pytest.mark.anyio
@pytest.mark.parametrize(
    "over",
    [["headway_s=0.4..900"], ["deceleration_mps2=2..80"], ["ego_speed_mps=400", "headway_s", "deceleration_mps2"]],
    ids=["longer_than_the_road", "harder_than_tyres", "fixed_value"],
)
async def test_a_value_that_no_point_can_have_is_refused_with_the_last_plausible_one(
    context: WorkflowContext, over: list[str]
) -> None:
    given = {**SMALL, "scenario": "lead_braking", "over": over}
    with pytest.raises(NotPossible) as refused:
        await boundaries.explore_boundary(ExploreBoundaryArguments(**given), context)
    (remedy,) = refused.value.remedies
    (change,) = remedy.changes
    smaller = [change.words.get(text, text) for text in over]
    assert smaller != over
    plan = await boundaries._plan(ExploreBoundaryArguments(**{**given, "over": smaller}), context)
    await boundaries._check_values(plan, smaller, context)


@pytest.mark.anyio
async def test_a_range_a_little_beyond_the_usual_one_is_mapped(context: WorkflowContext) -> None:
    given = {**SMALL, "scenario": "lead_braking", "over": ["headway_s=0.3..2.6"]}
    plan = await boundaries._plan(ExploreBoundaryArguments(**given), context)
    await boundaries._check_values(plan, given["over"], context)


@pytest.mark.anyio
async def test_a_failure_that_counts_as_unavoidable_where_another_planner_is_safe_is_explained(
    context: WorkflowContext,
) -> None:
    record, _ = await explored(context)
    only = record.maps[0]
    worst = only.points[0].evaluation.model_copy(update={"outcome": "failed_unavoidably"})
    safe = only.points[0].evaluation.model_copy(update={"outcome": "safe"})
    pair = [
        only.model_copy(update={"points": (only.points[0].model_copy(update={"evaluation": one}),)})
        for one in (worst, safe)
    ]
    noted = await boundaries._finished(record.model_copy(update={"maps": tuple(pair)}), context)
    plain = await boundaries._finished(record.model_copy(update={"maps": (pair[0], pair[0])}), context)
    assert len(noted.notes) == len(plain.notes) + 1
