"""One operation for all pictures: selects the kind, reads the files, draws, and writes.

Kinds are ``picture`` and ``animation``, which show scenarios from above, and the charts of ``CHARTS``.
"""

from dataclasses import replace
from pathlib import Path

from ...schemas.errors import InvalidRequest, NotPossible, UnknownName, with_values
from ...schemas.rendering import PictureKind, Rendered, RenderedImage, RenderRequest
from ...schemas.runs import ReviewRequest
from ..analysis import RunSet, review_runs
from ..commonroad import kept_recording
from ..execution import ProgressReporter, silent
from .animation import Moment, animate
from .boundary_chart import boundary_chart
from .canvas import Drawing, image_at, write_png
from .charts import CHARTS
from .content import DrivenPath, ScenarioContent, ScenarioView, content_of, driven_path, short_names
from .search_charts import study_chart
from .top_view import draw_picture

_MOST_SCENARIOS, _MOST_PATHS = 2, 4
"""Most scenarios side by side, and most runs over one of them, since more would be indistinguishable (chosen)."""


def render(request: RenderRequest, report: ProgressReporter) -> Rendered:
    """Draw the request into ``request.folder``; by default outcomes or a picture.

    ``auto`` means outcomes for runs on several scenarios, otherwise a picture.

    Raises:
        NotPossible: The kind needs runs, steps or a second configuration that are missing.
        InvalidRequest: The time is outside the scenario, or the kind does not show a single time or road user.
    """
    kind = request.kind
    if kind == "auto" and request.study is not None:
        kind = "search"
    elif kind == "auto" and request.boundary is not None:
        kind = "boundary"
    elif kind == "auto":
        kind = "outcomes" if len({source.record.scenario_id for source in request.runs}) > 1 else "picture"
    _check_look(request, kind)
    notes: list[str] = []
    images: tuple[RenderedImage, ...]
    if kind == "animation":
        views, notes = _views(request, most=1)
        moment = _decisive_moment(request, views[0])
        if request.time_s is not None:
            moment = Moment(views[0].step, "the requested time")
        images = animate(views[0], Path(request.folder), report, moment)
    else:
        path = Path(request.folder) / f"{kind}.png"
        if kind == "picture":
            views, notes = _views(request, most=_MOST_SCENARIOS)
            report(0.5, "scenarios read")
            drawing = draw_picture(views)
        elif kind == "search":
            drawing = _search(request)
        elif kind == "boundary":
            drawing = _boundary(request)
        elif request.runs:
            drawing = CHARTS[kind](RunSet(request.runs, request.configs, request.scenarios, request.lineage))
        else:
            raise NotPossible(
                f"kind {kind} needs runs, but ids contains no run or batch",
                next_step="give the id of a run or batch",
                remedies=[with_values(kind=None)],
            )
        images = (image_at(path, write_png(drawing.figure, path), drawing.alt_text),)
        notes += drawing.notes
    report(1.0, "drawn")
    return Rendered(kind=kind, images=images, notes=tuple(notes))


_LOOKS: dict[str, tuple[PictureKind, ...]] = {"time_s": ("picture", "animation"), "focus": ("picture",)}
"""The kinds that show a time, and those that show the surroundings of a road user."""


def _check_look(request: RenderRequest, kind: PictureKind) -> None:
    """Refuse a time or a road user that the kind would not show.

    Raises:
        InvalidRequest: An argument does not belong to the kind.
    """
    given = {"time_s": request.time_s, "focus": request.focus}
    foreign = [name for name, kinds in _LOOKS.items() if given[name] is not None and kind not in kinds]
    if foreign:
        raise InvalidRequest(
            f"{' and '.join(foreign)} {'does' if len(foreign) == 1 else 'do'} not belong to kind {kind}, which shows "
            f"{'a whole drive' if kind == 'animation' else 'whole runs'}",
            valid=[f"{name} with kind {' or '.join(_LOOKS[name])}" for name in foreign],
            next_step="leave it out, or draw a picture",
            remedies=[with_values(**dict.fromkeys(foreign)), with_values(kind="picture")],
        )


def _search(request: RenderRequest) -> Drawing:
    if request.study is None:
        raise NotPossible(
            "kind search shows a study, but ids contains no study",
            next_step="pass a study id",
            remedies=[with_values(kind=None)],
        )
    return study_chart(request.study)


def _boundary(request: RenderRequest) -> Drawing:
    if request.boundary is None:
        raise NotPossible(
            "kind boundary shows an exploration, but ids contains no boundary",
            next_step="pass the id that explore_boundary returned",
            remedies=[with_values(kind=None)],
        )
    return boundary_chart(request.boundary)


_DECIDING_GAP_M = 5.0
"""Largest gap of a closest encounter that can be decisive (chosen)."""


def _decisive_moment(request: RenderRequest, view: ScenarioView) -> Moment | None:
    """Return the first collision of the drawn runs, or a single run's closest encounter if that is close."""
    hits = [(path, path.record.collision) for path in view.paths]
    collisions = sorted((hit.step, path.name, hit) for path, hit in hits if hit is not None)
    if collisions:
        step, name, hit = collisions[0]
        what = "the ego leaves the road" if hit.obstacle_id is None else f"collision with {hit.kind} {hit.obstacle_id}"
        return Moment(step, what if len(view.paths) == 1 else f"{name}: {what}")
    if len(view.paths) != 1:
        return None
    path = view.paths[0]
    chosen = tuple(source for source in request.runs if source.record.run_id == path.record.run_id)
    closest = review_runs(ReviewRequest(runs=chosen, scenarios=request.scenarios), silent).reviews[0].closest
    if closest is None or closest.gap_m > _DECIDING_GAP_M:
        return None
    step = path.first_step + round(closest.time_s / path.record.step_s)
    return Moment(step, f"closest: {closest.gap_m:.2f} m to {closest.other} {closest.place}")


def _views(request: RenderRequest, *, most: int) -> tuple[list[ScenarioView], list[str]]:
    """Return the scenarios to draw with their runs, and notes on what is left out."""
    notes = []
    if not request.scenarios:
        raise NotPossible("there is no scenario to draw", next_step="pass a scenario, or a run on one")
    if len(request.scenarios) > most:
        notes.append(f"scenarios not shown: {len(request.scenarios) - most}")
    configs = list(dict.fromkeys((run.record.config_id, run.record.prediction) for run in request.runs))
    names = short_names([run.record for run in request.runs])
    views = []
    for source in request.scenarios[:most]:
        content = content_of(kept_recording(Path(source.path)))
        mine = [run for run in request.runs if run.record.scenario_id == source.scenario_id]
        numbered = [(run, configs.index((run.record.config_id, run.record.prediction))) for run in mine]
        paths = [path for run, at in numbered if (path := driven_path(run, names[run.record.config_id], at))]
        if len(paths) > _MOST_PATHS:
            notes.append(f"{len(paths) - _MOST_PATHS} more runs on {source.scenario_id} are not shown")
        if len(paths) == 1:
            content = replace(content, tracks=content.tracks | paths[0].others)
        elif any(path.others for path in paths):
            notes.append(
                f"the others on {source.scenario_id} are shown as recorded, since they moved differently in each run"
            )
        shown = tuple(paths[:_MOST_PATHS])
        step = _step(content, shown, request.time_s)
        views.append(ScenarioView(content, shown, step, _focus(content, step, request.focus)))
    return views, notes


def _focus(content: ScenarioContent, step: int, focus_id: int | None) -> int | None:
    """Return the road user to focus on, if it is present at the step.

    Raises:
        UnknownName: There is no such road user.
    """
    if focus_id is None:
        return None
    there = content.places_at(step)
    if focus_id in there:
        return focus_id
    track = content.tracks.get(focus_id)
    if track is None:
        raise UnknownName(
            f"{content.scenario_id} has no road user {focus_id}",
            valid=[str(key) for key in there],
            next_step="choose one of these, or leave focus out to see the ego",
            remedies=[with_values(focus=key) for key in list(there)[:1]],
        )
    first_s, last_s = (step * content.step_s for step in (track.first_step, track.last_step))
    raise InvalidRequest(
        f"{track.kind} {focus_id} is in {content.scenario_id} from {first_s:.1f} to {last_s:.1f} s",
        valid=[f"time_s={first_s:.1f}", f"time_s={last_s:.1f}"],
        next_step="choose a time_s at which it is present",
        remedies=[with_values(time_s=round(first_s, 3))],
    )


def _step(content: ScenarioContent, paths: tuple[DrivenPath, ...], time_s: float | None) -> int:
    """Return the step to display: the requested time, otherwise the first end of a run, otherwise the start."""
    last = max([content.last_step, *(path.last_step for path in paths)])
    if time_s is None:
        return min((path.last_step for path in paths), default=content.ego_step)
    step = round(time_s / content.step_s)
    if step > last:
        raise InvalidRequest(
            f"{content.scenario_id} {'and the runs on it end' if paths else 'ends'} at {last * content.step_s:.1f} s "
            f"at the latest, before time_s={time_s:g}",
            valid=[f"a time_s from 0 to {last * content.step_s:.1f}"],
            next_step="choose a time within this range",
            remedies=[with_values(time_s=round(last * content.step_s, 3))],
        )
    return step
