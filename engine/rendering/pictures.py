"""One operation for all pictures: chooses the kind, reads the files, draws."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ...schemas.comparison import CompareRequest, Side
from ...schemas.errors import InvalidRequest, NotPossible
from ...schemas.rendering import PictureKind, Rendered, RenderedImage, RenderRequest
from ..analysis import RunSet, compare, cost_shares
from ..commonroad import read_scenario
from ..execution import ProgressReporter, silent
from .animation import animate
from .charts import MOST_RUNS, draw_costs, draw_flips, draw_outcomes, draw_profile
from .content import DrivenPath, SceneContent, driven_path, read_content, short_names
from .furniture import SceneView
from .scene import draw_picture

MOST_SCENES = 2
MOST_PATHS = 4
Drawn = tuple[Path, tuple[int, int], str]
Draw = Callable[[RenderRequest, ProgressReporter], tuple[Drawn, list[str]]]


def render(request: RenderRequest, report: ProgressReporter) -> Rendered:
    """Draw what is asked for into ``request.folder``.

    Raises:
        NotPossible: the kind needs runs, steps or a second configuration that are not there.
        InvalidRequest: a moment outside the scenario.
    """
    kind = choose_kind(request)
    (path, size, alt_text), notes = _DRAW[kind](request, report)
    image = RenderedImage(
        path=str(path),
        mime_type="image/gif" if path.suffix == ".gif" else "image/png",
        width_px=size[0],
        height_px=size[1],
        size_bytes=path.stat().st_size,
        alt_text=alt_text,
    )
    report(1.0, "drawn")
    return Rendered(kind=kind, images=(image,), notes=tuple(notes))


def choose_kind(request: RenderRequest) -> PictureKind:
    """The kind that is asked for; ``auto``: outcomes for runs on several scenarios, else a picture."""
    if request.kind != "auto":
        return request.kind
    scenarios = {source.record.scenario_id for source in request.runs}
    return "outcomes" if len(scenarios) > 1 else "picture"


def _views(request: RenderRequest, *, most: int) -> tuple[list[SceneView], list[str]]:
    notes = []
    if not request.scenarios:
        raise NotPossible("there is no scenario to draw", next_step="name a scenario, or a run on one")
    if len(request.scenarios) > most:
        notes.append(f"{len(request.scenarios) - most} more scenarios are not drawn")
    configs = list(dict.fromkeys((run.record.config_id, run.record.prediction) for run in request.runs))
    names = short_names(request.runs)
    views = []
    for source in request.scenarios[:most]:
        content = read_content(read_scenario(Path(source.path)))
        mine = [run for run in request.runs if run.record.scenario_id == source.scenario_id]
        numbered = [(run, configs.index((run.record.config_id, run.record.prediction))) for run in mine]
        paths = [path for run, at in numbered if (path := driven_path(run, names[run.record.config_id], at))]
        if len(paths) > MOST_PATHS:
            notes.append(f"{len(paths) - MOST_PATHS} more runs on {source.scenario_id} are not drawn")
        if len(paths) == 1:
            content = replace(content, tracks=content.tracks | paths[0].others)
        elif any(path.others for path in paths):
            notes.append(
                f"the others are drawn on {source.scenario_id} as recorded: they moved differently in each run"
            )
        views.append(SceneView(content, tuple(paths[:MOST_PATHS]), _step(content, paths[:MOST_PATHS], request.time_s)))
    return views, notes


def _step(content: SceneContent, paths: list[DrivenPath], time_s: float | None) -> int:
    last = max([content.last_step, *(path.last_step for path in paths)])
    if time_s is None:
        return min((path.last_step for path in paths), default=content.ego_step)
    step = round(time_s / content.step_s)
    if step > last:
        raise InvalidRequest(
            f"{content.scenario_id} ends at {last * content.step_s:.1f} s; time_s is {time_s:g}",
            valid=[f"0..{last * content.step_s:.1f}"],
        )
    return step


def _picture(request: RenderRequest, report: ProgressReporter) -> tuple[Drawn, list[str]]:
    views, notes = _views(request, most=MOST_SCENES)
    report(0.5, "scenarios read")
    path = Path(request.folder) / "picture.png"
    return (path, *draw_picture(views, path)), notes


def _animation(request: RenderRequest, report: ProgressReporter) -> tuple[Drawn, list[str]]:
    views, notes = _views(request, most=1)
    path = Path(request.folder) / "animation.gif"
    return (path, *animate(views[0], path, report)), notes


def _outcomes(request: RenderRequest, report: ProgressReporter) -> tuple[Drawn, list[str]]:
    del report
    evidence = _evidence(request, "outcomes")
    path = Path(request.folder) / "outcomes.png"
    names = short_names(request.runs)
    groups = [(names[config_id], records) for config_id, records in evidence.by_config(evidence.records).items()]
    return (path, *draw_outcomes(groups, path)), []


def _costs(request: RenderRequest, report: ProgressReporter) -> tuple[Drawn, list[str]]:
    del report
    found = cost_shares(_evidence(request, "costs"))
    if not found:
        raise NotPossible("these runs have no recorded cost terms", next_step="render kind=outcomes")
    path = Path(request.folder) / "costs.png"
    return (path, *draw_costs(found, path)), []


def _flips(request: RenderRequest, report: ProgressReporter) -> tuple[Drawn, list[str]]:
    del report
    evidence = _evidence(request, "flips")
    sides = tuple(
        Side(
            label=short_names(request.runs)[config_id],
            config_id=config_id,
            config_name=records[0].config_name,
            run_ids=tuple(record.run_id for record in records),
        )
        for config_id, records in evidence.by_config(evidence.records).items()
    )
    request_for_two = CompareRequest(sides=sides[:2], runs=request.runs, configs=request.configs, limit=12)
    found = compare(request_for_two, silent)
    path = Path(request.folder) / "flips.png"
    notes = ["only the first two configurations are compared"] if len(sides) > 2 else []
    return (path, *draw_flips(found.comparisons[0], path)), notes


def _profile(request: RenderRequest, report: ProgressReporter) -> tuple[Drawn, list[str]]:
    del report
    evidence = _evidence(request, "profile")
    runs = [(record, evidence.steps[record.run_id]) for record in evidence.records if record.run_id in evidence.steps]
    runs = [(record, steps) for record, steps in runs if steps.speed_mps]
    if not runs:
        raise NotPossible("these runs have no recorded steps", next_step="run them again with run_planner")
    path = Path(request.folder) / "profile.png"
    notes = [f"{len(runs) - MOST_RUNS} more runs are not drawn"] if len(runs) > MOST_RUNS else []
    return (path, *draw_profile(runs, path)), notes


def _evidence(request: RenderRequest, kind: str) -> RunSet:
    if not request.runs:
        raise NotPossible(f"kind {kind} draws runs, and no run was named", next_step="name run or batch ids in ids")
    return RunSet(request.runs, request.configs, request.scenarios)


_DRAW: dict[PictureKind, Draw] = {
    "picture": _picture,
    "animation": _animation,
    "outcomes": _outcomes,
    "costs": _costs,
    "flips": _flips,
    "profile": _profile,
}
