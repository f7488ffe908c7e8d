"""The tool that draws, and views in motion; what was made of the same artifacts before is not made again."""

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..engine.catalog import open_catalogue
from ..engine.planners import planner_version
from ..engine.rendering import filled_page
from ..engine.workspace import VIEWED_KINDS, Artifact, versions_of, write_whole
from ..resources.templates import picture_link
from ..schemas.analysis.optimization import StudyRecord
from ..schemas.errors import Faults, InvalidRequest, PlannerForgeError, UnknownName
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
from .call import Image, ImageAnswer, ToolCall
from .configurations import resolve_configuration, store_configuration
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
"""The folder of the drawn pictures in the workspace."""
VIEWS = "views"
"""The folder of the data of views in the workspace."""
MOST_PANES = 2
"""Scenarios or runs side by side in a player (chosen)."""


async def render(arguments: RenderArguments, call: ToolCall) -> ImageAnswer:
    """A picture, animation or chart."""
    study = _study(arguments.ids, call)
    scenario_ids, run_ids = ([], []) if study is not None else _meant(arguments.ids, call)
    made = await draw(
        call,
        arguments.kind,
        scenario_ids=scenario_ids,
        run_ids=run_ids,
        time_s=arguments.time_s,
        focus=arguments.focus,
        study=study,
    )
    links = tuple(picture_link(Path(image.path), image.mime_type) for image in made.images)
    lines = [f"{made.kind}: {image.alt_text}" for image in made.images]
    lines += [
        f"{link.uri} ({image.width_px}×{image.height_px})" for link, image in zip(links, made.images, strict=True)
    ]
    lines += [f"Note: {note}" for note in made.notes]
    return ImageAnswer("\n".join(lines), tuple(Image(Path(i.path), i.mime_type) for i in made.images), links)


def _study(words: list[str], call: ToolCall) -> StudyRecord | None:
    """The study that is drawn; None where the words mean something else."""
    word = words[0].strip()
    if len(words) > 1 or not word.startswith("study_"):
        return None
    return call.workspace.get(word, "study").read(StudyRecord)


def _meant(words: list[str], call: ToolCall) -> tuple[list[str], list[str]]:
    """Scenario ids and run ids; ``latest`` is the client's last scenario, run or batch."""
    scenarios, runs, named, faults = list[str](), list[str](), list[Artifact](), Faults()
    for word in words:
        with faults.collecting():
            artifact = named_artifact(word, call)
            named.append(artifact)
            if artifact.kind == "scenario":
                scenarios.append(artifact.artifact_id)
            elif artifact.kind in ("run", "batch"):
                results = choose_results([artifact.artifact_id], call)
                runs += [run_id for result in results for run_id in result.run_ids]
            else:
                raise InvalidRequest(
                    f"'{artifact.artifact_id}' is a {artifact.kind}, which cannot be drawn",
                    valid=["scenario", "run", "batch"],
                )
    faults.raise_all()
    if _view_kind(named) is not None:
        call.shows(*(artifact.artifact_id for artifact in named))
    return scenarios, runs


def named_artifact(word: str, call: ToolCall) -> Artifact:
    """The artifact with this id, or of a word for what the client made last (docs/answers.md).

    ``latest`` is the last scenario, run or batch; ``current`` the configuration in force.

    Raises:
        UnknownName: nothing of that name, or nothing was made yet.
    """
    open_catalogue(call.workspace, with_starter=call.services.with_starter)
    if word == "latest":
        newest = call.newest("scenario", "run", "batch")
        if newest:
            return newest[0]
        raise UnknownName("nothing was made yet", next_step="call find_scenarios or generate_scenarios")
    if word in WORDS:
        return result_named(word, call)
    if word == "latest_scenario":
        return call.artifact("latest", "scenario")
    if word == "current":
        return store_configuration(call, resolve_configuration(word, call))
    return call.workspace.get(word, call.workspace.kind_of(word))


async def draw(
    call: ToolCall,
    kind: PictureKind,
    *,
    scenario_ids: Sequence[str] = (),
    run_ids: Sequence[str] = (),
    time_s: float | None = None,
    focus: int | None = None,
    study: StudyRecord | None = None,
) -> Rendered:
    """Draw scenarios and runs, or a study; the images lie in the workspace's pictures, named after what they show.

    Raises:
        NotPossible: the kind needs what is not there.
        ResourceFailure: the pictures cannot be written.
    """
    runs = run_sources(run_ids, call)
    drawn_on = [*scenario_ids, *(run.record.scenario_id for run in runs)]
    request = RenderRequest(
        kind=kind,
        scenarios=scenario_sources(drawn_on, call),
        runs=runs,
        configs=config_weights(runs, call),
        lineage=lineages(drawn_on, call),
        time_s=time_s,
        focus=focus,
        study=study,
        folder="",
    )
    note = call.workspace.root / FOLDER / f"{_digest(request)}.json"
    if note.is_file():
        return Rendered.model_validate_json(note.read_text(encoding="utf-8"))
    with call.workspace.scratch() as folder:
        made = await call.run(RENDER, request.model_copy(update={"folder": str(folder)}))
        return _kept(made, note)


def _digest(request: RenderRequest) -> str:
    content = request.model_dump_json() + repr((PICTURE_FORMAT, versions_of("matplotlib", "pillow")))
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def _kept(made: Rendered, note: Path) -> Rendered:
    """Move the images into the workspace, whole; the note that says so comes last."""
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
    """A view of artifacts by their ids: what kind it is, and its data as JSON."""

    ids: tuple[str, ...]
    kind: ViewKind
    data: str

    def page(self) -> str:
        """The page that shows it in a browser, the data inside."""
        return filled_page(self.kind, " | ".join(self.ids), self.data)


async def make_view(words: Sequence[str], call: ToolCall, *, whole: bool = True) -> MadeView:
    """The view of some artifacts: a player of a scenario or run, or of two side by side; a board of batches or runs.

    Args:
        whole: a board holds what its player shows; without it whoever shows it asks for each run.

    Raises:
        InvalidRequest: artifacts that no view shows, or not together.
        UnknownName: nothing of that name.
        NotPossible: the view would be too large, or there is no run in it.
    """
    faults, artifacts = Faults(), list[Artifact]()
    for word in words:
        with faults.collecting():
            artifacts.append(named_artifact(word, call))
    faults.raise_all()
    request = _view_request(artifacts, call, whole=whole)
    kept = call.workspace.root / VIEWS / f"{_view_digest(request)}.json"
    data = kept.read_text(encoding="utf-8") if kept.is_file() else await _view_data(request, kept, call)
    return MadeView(tuple(artifact.artifact_id for artifact in artifacts), request.kind, data)


async def _view_data(request: ViewRequest, kept: Path, call: ToolCall) -> str:
    """Make the data of a view, and keep them, unless something is missing that may be there the next time."""
    with call.workspace.scratch() as folder:
        path = folder / "view.json"
        panes = [await _with_plans(pane, folder / f"plans{i}.json", call) for i, pane in enumerate(request.panes)]
        await call.run(WRITE_VIEW, request.model_copy(update={"path": str(path), "panes": tuple(panes)}))
        if not any(pane.note for pane in panes):
            write_whole(kept, partial(shutil.copyfile, path))
        return path.read_text(encoding="utf-8")


def _view_request(artifacts: Sequence[Artifact], call: ToolCall, *, whole: bool) -> ViewRequest:
    title = " | ".join(artifact.artifact_id for artifact in artifacts)
    unseen = [artifact for artifact in artifacts if artifact.kind not in VIEWED_KINDS]
    if unseen:
        raise InvalidRequest(
            f"'{unseen[0].artifact_id}' is a {unseen[0].kind}, which no view shows", valid=VIEWED_KINDS
        )
    kind = _view_kind(artifacts)
    if kind == "player":
        panes = tuple(_pane(artifact, call) for artifact in artifacts)
        return ViewRequest(kind="player", title=title, panes=panes, path="")
    if kind is None:
        raise InvalidRequest(
            f"{title or 'nothing'} is no view",
            valid=["one scenario or run", "two of them, side by side", "batches and runs, as a board"],
        )
    _, runs = chosen_runs([artifact.artifact_id for artifact in artifacts], call)
    return ViewRequest(
        kind="board",
        title=title,
        batches=tuple(artifact.read(BatchRecord) for artifact in artifacts if artifact.kind == "batch"),
        runs=runs,
        scenarios=scenario_sources([run.record.scenario_id for run in runs], call),
        lineage=lineages([run.record.scenario_id for run in runs], call),
        whole=whole,
        path="",
    )


def _view_kind(artifacts: Sequence[Artifact]) -> ViewKind | None:
    """The view that shows some artifacts together; None where none does."""
    kinds = {artifact.kind for artifact in artifacts}
    if kinds <= {"scenario", "run"} and 1 <= len(artifacts) <= MOST_PANES:
        return "player"
    return "board" if artifacts and kinds <= {"run", "batch"} else None


def _pane(artifact: Artifact, call: ToolCall) -> ViewPane:
    if artifact.kind == "scenario":
        return ViewPane(scenario=scenario_sources([artifact.artifact_id], call)[0])
    record = artifact.read(RunRecord)
    (run,) = run_sources([artifact.artifact_id], call)
    return ViewPane(scenario=scenario_sources([record.scenario_id], call)[0], run=run)


async def _with_plans(pane: ViewPane, path: Path, call: ToolCall) -> ViewPane:
    """A pane with what the planner of its run had in mind; a note in it where that cannot be had."""
    if pane.run is None or pane.run.steps_path is None:
        return pane
    record = pane.run.record
    try:
        found = await _replayed(record, pane.scenario.path, pane.run.steps_path, path, call)
    except PlannerForgeError as error:
        found = Replayed(note=f"its plans are not shown: {error.message}")
    note = f"{record.run_id}: {found.note}" if found.note else ""
    return pane.model_copy(update={"plans_path": found.path, "note": note})


async def _replayed(record: RunRecord, scenario_path: str, steps_path: str, path: Path, call: ToolCall) -> Replayed:
    """Have a run driven once more, and its plans written to ``path``.

    Raises:
        PlannerForgeError: its planner or configuration is gone, or a worker failed.
    """
    driven_by = call.workspace.get(record.run_id, "run").recipe.versions.get(version_key(record.planner), "")
    if planner_version(record.planner) != driven_by:
        return Replayed(note=f"{record.planner} was edited since this run, so its plans are not shown")
    run = RunRequest(
        run_id=record.run_id,
        scenario_path=scenario_path,
        scenario_id=record.scenario_id,
        problem_id=record.problem_id,
        configuration=call.workspace.get(configuration_id(record.config_id), "config").read(PlannerConfiguration),
        prediction=record.prediction,
        traffic=record.traffic,
        seed=record.seed,
        planner_version=driven_by,
    )
    return await call.run(REPLAY_PLANS, ReplayRequest(run=run, steps_path=steps_path, path=str(path)))


def _view_digest(request: ViewRequest) -> str:
    """Names the data of a view after what they show; another format of the data has another name."""
    content = request.model_dump_json() + repr((VIEW_FORMAT, versions_of("shapely")))
    return hashlib.sha256(content.encode()).hexdigest()[:12]
