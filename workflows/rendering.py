"""Draw pictures and views in motion. Earlier drawings of the same artifacts are reused."""

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from ..engine.catalog import open_catalogue
from ..engine.planners import planner_version
from ..engine.rendering import filled_page
from ..engine.workspace import VIEWED_KINDS, Artifact, versions_of, write_whole
from ..schemas.analysis.optimization import StudyRecord
from ..schemas.boundaries import BoundaryRecord
from ..schemas.errors import Faults, InvalidRequest, NotPossible, PlannerForgeError, UnknownName, with_values
from ..schemas.planning import PlannerConfiguration, Replayed, ReplayRequest, RunRequest
from ..schemas.rendering import (
    PICTURE_FORMAT,
    VIEW_FORMAT,
    PictureKind,
    RenderArguments,
    Rendered,
    RenderedImage,
    RenderRequest,
    ViewKind,
    ViewPane,
    ViewRequest,
)
from ..schemas.runs import BatchRecord, RunRecord, configuration_id
from .configurations import resolve_configuration, store_configuration
from .context import WorkflowContext
from .operations import RENDER, REPLAY_PLANS, WRITE_VIEW
from .results import (
    WORDS,
    choose_results,
    chosen_runs,
    config_weights,
    lineages,
    result_named,
    run_sources,
    scenario_sources,
    version_key,
)

FOLDER = "pictures"
"""The folder of pictures in the workspace."""
VIEWS = "views"
"""The folder for the data of views in the workspace."""
MOST_PANES = 2
"""How many scenarios or runs a player shows side by side (chosen)."""


@dataclass(frozen=True)
class Drawing:
    """The drawn pictures, and the ids that a view shows together; empty if no view shows them."""

    made: Rendered
    viewed: tuple[str, ...] = ()


async def render(arguments: RenderArguments, context: WorkflowContext) -> Drawing:
    """Draw scenarios, runs, batches, a study or a map of a boundary.

    Raises:
        UnknownName: an id is unknown.
        InvalidRequest: an artifact cannot be drawn.
        NotPossible: the kind of picture needs data that these artifacts do not have.
    """
    study, boundary = _study(arguments.ids, context), _boundary(arguments.ids, context)
    if arguments.kind == "search" and study is None:
        raise _without("study", "kind search shows a study of optimize_planner", context)
    if arguments.kind == "boundary" and boundary is None:
        raise _without("boundary", "kind boundary shows a map of explore_boundary", context)
    alone = study is not None or boundary is not None
    scenario_ids, run_ids, viewed = ([], [], ()) if alone else _resolved_ids(arguments.ids, context)
    made = await draw(
        context,
        arguments.kind,
        scenario_ids=scenario_ids,
        run_ids=run_ids,
        time_s=arguments.time_s,
        focus=arguments.focus,
        study=study,
        boundary=boundary,
    )
    return Drawing(made, viewed)


def _without(kind: Literal["study", "boundary"], shows: str, context: WorkflowContext) -> NotPossible:
    """Return the refusal of a kind of picture without the artifact that it shows, with the existing ones."""
    there = [artifact.artifact_id for artifact in context.workspace.newest(kind=kind, limit=_PROPOSED)]
    return NotPossible(
        f"{shows}, but ids contains no {kind}",
        valid=there,
        next_step=f"pass the id of a {kind}" if there else f"make a {kind} first, or leave kind out",
        remedies=[with_values(ids=[one]) for one in there],
    ).also(with_values(kind=None))


_PROPOSED = 3
"""How many studies or boundaries a refusal lists (chosen)."""


def _study(words: list[str], context: WorkflowContext) -> StudyRecord | None:
    """Return the study to draw, or None if the words refer to something else."""
    word = words[0].strip()
    if len(words) > 1 or not word.startswith("study_"):
        return None
    return context.workspace.get(word, "study").read(StudyRecord)


def _boundary(words: list[str], context: WorkflowContext) -> BoundaryRecord | None:
    """Return the map to draw, or None if the words refer to something else."""
    word = words[0].strip()
    if len(words) > 1 or not word.startswith("boundary_"):
        return None
    return context.workspace.get(word, "boundary").read(BoundaryRecord)


def _resolved_ids(words: list[str], context: WorkflowContext) -> tuple[list[str], list[str], tuple[str, ...]]:
    """Return scenario ids, run ids, and the ids that a view shows together."""
    scenarios, runs, artifacts, faults = list[str](), list[str](), list[Artifact](), Faults()
    for word in words:
        with faults.collecting():
            artifact = named_artifact(word, context)
            artifacts.append(artifact)
            if artifact.kind == "scenario":
                scenarios.append(artifact.artifact_id)
            elif artifact.kind in ("run", "batch"):
                results = choose_results([artifact.artifact_id], context)
                runs += [run_id for result in results for run_id in result.run_ids]
            else:
                raise InvalidRequest(
                    f"'{artifact.artifact_id}' is a {artifact.kind}, which cannot be drawn",
                    valid=["scenario", "run", "batch"],
                )
    faults.raise_all()
    viewed = artifacts if _view_kind(artifacts) is not None else []
    return scenarios, runs, tuple(artifact.artifact_id for artifact in viewed)


def named_artifact(word: str, context: WorkflowContext) -> Artifact:
    """Return the artifact with this id, or the one for a word such as ``latest`` (docs/answers.md).

    ``latest`` is the last scenario, run or batch; ``current`` is the current configuration.

    Raises:
        UnknownName: the name is unknown, or there is nothing yet.
    """
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    if word == "latest":
        newest = context.newest("scenario", "run", "batch")
        if newest:
            return newest[0]
        raise UnknownName("the workspace has no artifact yet", next_step="call find_scenarios or generate_scenarios")
    if word in WORDS:
        return result_named(word, context)
    if word == "latest_scenario":
        return context.artifact("latest", "scenario")
    if word == "current":
        return store_configuration(context, resolve_configuration(word, context))
    try:
        return context.workspace.get(word, context.workspace.kind_of(word))
    except UnknownName as refusal:
        raise context.meant_job(word) or refusal.with_words(
            word, (*WORDS, "latest_scenario", "current")
        ) from refusal.__cause__


async def draw(
    context: WorkflowContext,
    kind: PictureKind,
    *,
    scenario_ids: Sequence[str] = (),
    run_ids: Sequence[str] = (),
    time_s: float | None = None,
    focus: int | None = None,
    study: StudyRecord | None = None,
    boundary: BoundaryRecord | None = None,
) -> Rendered:
    """Draw scenarios and runs, a study or a boundary into the workspace's pictures, named after their content.

    Raises:
        NotPossible: the kind needs missing data.
        ResourceFailure: the pictures cannot be written.
    """
    runs = run_sources(run_ids, context)
    drawn_on = [*scenario_ids, *(run.record.scenario_id for run in runs)]
    request = RenderRequest(
        kind=kind,
        scenarios=scenario_sources(drawn_on, context),
        runs=runs,
        configs=config_weights(runs, context),
        lineage=lineages(drawn_on, context),
        time_s=time_s,
        focus=focus,
        study=study,
        boundary=boundary,
        folder="",
    )
    note = context.workspace.root / FOLDER / f"{_digest(request)}.json"
    if note.is_file():
        return Rendered.model_validate_json(note.read_text(encoding="utf-8"))
    with context.workspace.scratch() as folder:
        made = await context.run(RENDER, request.model_copy(update={"folder": str(folder)}))
        return _kept(made, note)


def _digest(request: RenderRequest) -> str:
    content = request.model_dump_json() + repr((PICTURE_FORMAT, versions_of("matplotlib", "pillow")))
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def _kept(made: Rendered, note: Path) -> Rendered:
    """Move the complete images into the workspace, and write their note last."""
    images: list[RenderedImage] = []
    for image in made.images:
        source = Path(image.path)
        target = note.with_name(f"{source.stem}_{note.stem}{source.suffix}")
        write_whole(target, partial(shutil.copyfile, source))
        images.append(image.model_copy(update={"path": str(target)}))
    kept = made.model_copy(update={"images": tuple(images)})
    write_whole(note, lambda path: path.write_text(kept.model_dump_json(), encoding="utf-8"))
    return kept


@dataclass(frozen=True)
class MadeView:
    """A view of artifacts by their ids: its kind, and its data as JSON."""

    ids: tuple[str, ...]
    kind: ViewKind
    data: str

    def page(self) -> str:
        """Return the page that shows it in a browser, including the data."""
        return filled_page(self.kind, " | ".join(self.ids), self.data)


async def make_view(words: Sequence[str], context: WorkflowContext, *, whole: bool = True) -> MadeView:
    """Return the view of artifacts: a player of one or two scenarios or runs, or a board of batches or runs.

    Args:
        whole: whether a board includes the data of its player; otherwise the viewer requests each run.

    Raises:
        InvalidRequest: no view shows these artifacts, or not together.
        UnknownName: a name is unknown.
        NotPossible: the view would be too large, or it has no run.
    """
    faults, artifacts = Faults(), list[Artifact]()
    for word in words:
        with faults.collecting():
            artifacts.append(named_artifact(word, context))
    faults.raise_all()
    request = _view_request(artifacts, context, whole=whole)
    kept = context.workspace.root / VIEWS / f"{_view_digest(request)}.json"
    data = kept.read_text(encoding="utf-8") if kept.is_file() else await _view_data(request, kept, context)
    return MadeView(tuple(artifact.artifact_id for artifact in artifacts), request.kind, data)


async def _view_data(request: ViewRequest, kept: Path, context: WorkflowContext) -> str:
    """Compute the data of a view, and store them unless something is missing that may exist later."""
    with context.workspace.scratch() as folder:
        path = folder / "view.json"
        panes = [await _with_plans(pane, folder / f"plans{i}.json", context) for i, pane in enumerate(request.panes)]
        await context.run(WRITE_VIEW, request.model_copy(update={"path": str(path), "panes": tuple(panes)}))
        if not any(pane.note for pane in panes):
            write_whole(kept, partial(shutil.copyfile, path))
        return path.read_text(encoding="utf-8")


def _view_request(artifacts: Sequence[Artifact], context: WorkflowContext, *, whole: bool) -> ViewRequest:
    title = " | ".join(artifact.artifact_id for artifact in artifacts)
    unseen = [artifact for artifact in artifacts if artifact.kind not in VIEWED_KINDS]
    if unseen:
        raise InvalidRequest(
            f"'{unseen[0].artifact_id}' is a {unseen[0].kind}, which no view shows", valid=VIEWED_KINDS
        )
    kind = _view_kind(artifacts)
    if kind == "player":
        panes = tuple(_pane(artifact, context) for artifact in artifacts)
        return ViewRequest(kind="player", title=title, panes=panes, path="")
    if kind is None:
        raise InvalidRequest(
            f"{title or 'nothing'} cannot be shown as a view",
            valid=["one scenario or run", "two of them, side by side", "batches and runs, as a board"],
        )
    _, runs = chosen_runs([artifact.artifact_id for artifact in artifacts], context)
    return ViewRequest(
        kind="board",
        title=title,
        batches=tuple(artifact.read(BatchRecord) for artifact in artifacts if artifact.kind == "batch"),
        runs=runs,
        scenarios=scenario_sources([run.record.scenario_id for run in runs], context),
        lineage=lineages([run.record.scenario_id for run in runs], context),
        whole=whole,
        path="",
    )


def _view_kind(artifacts: Sequence[Artifact]) -> ViewKind | None:
    """Return the kind of view that shows the artifacts together, or None if no view does."""
    kinds = {artifact.kind for artifact in artifacts}
    if kinds <= {"scenario", "run"} and 1 <= len(artifacts) <= MOST_PANES:
        return "player"
    return "board" if artifacts and kinds <= {"run", "batch"} else None


def _pane(artifact: Artifact, context: WorkflowContext) -> ViewPane:
    if artifact.kind == "scenario":
        return ViewPane(scenario=scenario_sources([artifact.artifact_id], context)[0])
    record = artifact.read(RunRecord)
    (run,) = run_sources([artifact.artifact_id], context)
    return ViewPane(scenario=scenario_sources([record.scenario_id], context)[0], run=run)


async def _with_plans(pane: ViewPane, path: Path, context: WorkflowContext) -> ViewPane:
    """Return a pane with the plans of its run, or with a note on why they are missing."""
    if pane.run is None or pane.run.steps_path is None:
        return pane
    record = pane.run.record
    try:
        found = await _replayed(record, pane.scenario.path, pane.run.steps_path, path, context)
    except PlannerForgeError as error:
        found = Replayed(note=f"its plans are not shown: {error.message}")
    note = f"{record.run_id}: {found.note}" if found.note else ""
    return pane.model_copy(update={"plans_path": found.path, "note": note})


async def _replayed(
    record: RunRecord, scenario_path: str, steps_path: str, path: Path, context: WorkflowContext
) -> Replayed:
    """Replay a run, and write its plans to ``path``.

    Raises:
        PlannerForgeError: its planner or configuration is gone, or a worker failed.
    """
    driven_by = context.workspace.get(record.run_id, "run").recipe.versions.get(version_key(record.planner), "")
    if planner_version(record.planner) != driven_by:
        return Replayed(note=f"{record.planner} was edited since this run, so its plans are not shown")
    run = RunRequest(
        run_id=record.run_id,
        scenario_path=scenario_path,
        scenario_id=record.scenario_id,
        problem_id=record.problem_id,
        configuration=context.workspace.get(configuration_id(record.config_id), "config").read(PlannerConfiguration),
        prediction=record.prediction,
        traffic=record.traffic,
        seed=record.seed,
        planner_version=driven_by,
        world=record.world,
    )
    return await context.run(REPLAY_PLANS, ReplayRequest(run=run, steps_path=steps_path, path=str(path)))


def _view_digest(request: ViewRequest) -> str:
    """Return a name for the data of a view from its content and format."""
    content = request.model_dump_json() + repr((VIEW_FORMAT, versions_of("shapely")))
    return hashlib.sha256(content.encode()).hexdigest()[:12]
