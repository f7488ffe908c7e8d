"""The compact text of edits: the same as their structured content, in lines that a model or a person reads."""

from collections.abc import Iterator, Sequence

from plannerforge.schemas.modification import (
    EditCollision,
    EditReport,
    EgoDanger,
    ModifyScenarioResult,
    TouchedVehicle,
    VehicleRoute,
)

MOST_EDITS, MOST_TOUCHED, MOST_COLLISIONS, MOST_NOTES, MOST_IDS = 10, 6, 6, 6, 12
MOST_ROUTES, MOST_LANELETS = 8, 8
EDITS_CHARACTERS, NOTES_CHARACTERS = 1200, 800
"""Sentences beyond this are cut to an even share each, so that an answer stays below 1,500 tokens."""


def modification_text(result: ModifyScenarioResult) -> str:
    """All of it in a few lines; of long lists the first, and how many more there are."""
    head = f"{result.scenario_id} (from {result.base_id})" if result.scenario_id else f"dry run on {result.base_id}"
    lines = [head + (", reused" if result.reused else ""), *_edits_text(result.edits)]
    lines += [_touched_text(vehicle) for vehicle in result.touched[:MOST_TOUCHED]]
    if len(result.touched) > MOST_TOUCHED:
        infeasible = [vehicle.vehicle_id for vehicle in result.touched if not vehicle.feasible]
        lines.append(f"{len(result.touched)} touched in all; infeasible steps in: {_ids(infeasible)}")
    lines.append(f"removed: {_ids(result.removed)}; handed over besides: {_ids(result.handed_over)}")
    lines.append(f"collisions caused: {_collisions_text(result.collisions)}")
    lines.append(f"{result.untouched} vehicles exactly as recorded")
    lines += _danger_text(result.ego_before, result.ego_after)
    if result.checkers_agree is not None:
        alike = f"{result.checkers_agree} of {len(result.touched)}"
        lines.append(f"judged by the drivability checker; the closed form agrees on {alike}")
    lines += [f"note: {note}" for note in _within(result.warnings[:MOST_NOTES], NOTES_CHARACTERS)]
    if len(result.warnings) > MOST_NOTES:
        lines.append(f"… and {len(result.warnings) - MOST_NOTES} more notes")
    return "\n".join(lines)


def _edits_text(edits: Sequence[EditReport]) -> Iterator[str]:
    """Edits and routes; lanelets that are told of once are not told again, nor are their routes without a target."""
    shown: dict[int, tuple[int, ...]] = {}
    left = MOST_ROUTES
    sentences = _within([edit.what for edit in edits[:MOST_EDITS]], EDITS_CHARACTERS)
    for edit, what in zip(edits, sentences, strict=False):
        yield f"edit {edit.index} {edit.op} ({edit.letter}): {'done' if edit.done else 'not done'}: {what}"
        told = [one for one in edit.routes if one.arrives is not None or shown.get(one.vehicle_id) != one.lanelets]
        told.sort(key=lambda route: route.arrives is not False)
        first = told[:left]
        yield from (f"  {_route_text(route, shown.get(route.vehicle_id))}" for route in first)
        if len(told) > len(first):
            yield f"  … and {len(told) - len(first)} more routes"
        shown.update((route.vehicle_id, route.lanelets) for route in told)
        left -= len(first)
    more = edits[MOST_EDITS:]
    if more:
        undone = [edit.index for edit in more if not edit.done]
        yield f"… and {len(more)} more edits, {len(more) - len(undone)} of them done; not done: {_ids(undone)}"


def _route_text(route: VehicleRoute, before: tuple[int, ...] | None) -> str:
    lanelets: list[object] = [*route.lanelets]
    if len(lanelets) > MOST_LANELETS:
        lanelets[MOST_LANELETS - 1 : -1] = "…"
    way = "as above" if route.lanelets == before else f"lanelets {' → '.join(map(str, lanelets))}"
    arrives = {None: "", True: ", arrives", False: f", does not arrive: {route.reason}"}[route.arrives]
    return f"{route.vehicle_id}: {way}{arrives}"


def _collisions_text(collisions: Sequence[EditCollision]) -> str:
    hits = [f"{hit.vehicles[0]} with {hit.vehicles[1]} at {hit.time_s:.1f} s" for hit in collisions[:MOST_COLLISIONS]]
    more = f" and {len(collisions) - MOST_COLLISIONS} more" if len(collisions) > MOST_COLLISIONS else ""
    return "; ".join(hits) + more if hits else "none"


def _within(sentences: Sequence[str], characters: int) -> list[str]:
    """The sentences, together no longer than so many characters: of long ones the beginning and the end.

    At the end stands why an edit is not done.
    """
    share = characters // max(len(sentences), 1)
    if sum(map(len, sentences)) <= characters:
        return list(sentences)
    return [text if len(text) <= share else f"{text[: share * 2 // 3]} … {text[-share // 3 :]}" for text in sentences]


def _danger_text(before: EgoDanger | None, after: EgoDanger | None) -> list[str]:
    if before is None or after is None:
        return []
    figures = [
        f"{name} {_figure(getattr(before, field), unit)} → {_figure(getattr(after, field), unit)}"
        for name, field, unit in (
            ("minimum distance", "minimum_distance_m", " m"),
            ("time to collision", "minimum_time_to_collision_s", " s"),
            ("risk score", "risk_score", ""),
        )
    ]
    ego = "to an ego that drives ordinarily, blind to edited traffic"
    return [f"{ego}: {', '.join(figures)} (0 collision … 5 negligible){_most_critical(after)}"]


def _most_critical(danger: EgoDanger) -> str:
    if danger.most_critical_id is None:
        return ""
    what = "collision with" if danger.risk_score == 0 else "most critical:"
    return f"; {what} {danger.most_critical_id} at {danger.most_critical_time_s:.1f} s"


def _figure(value: float | None, unit: str) -> str:
    return "none" if value is None else f"{value:.3g}{unit}"


def _touched_text(vehicle: TouchedVehicle) -> str:
    is_shifted = vehicle.cause == "shifted"
    is_driven = is_shifted and vehicle.handover_jump_m is not None
    verdict = "feasible" if vehicle.feasible else f"{vehicle.feasible_share:.1%} of the steps feasible"
    verdict += ", as in its recording" if is_shifted and not is_driven else ""
    cause = f"{vehicle.cause.replace('_', ' ')}{' and driven' if is_driven else ''}"
    end = "leaves the network" if vehicle.leaves_network else "there"
    return (
        f"{vehicle.vehicle_id} {cause} from {vehicle.from_time_s:.1f} s, "
        f"{end} at {vehicle.until_time_s:.1f} s, {verdict}"
    )


def _ids(keys: tuple[int, ...] | list[int]) -> str:
    more = f" and {len(keys) - MOST_IDS} more" if len(keys) > MOST_IDS else ""
    return ", ".join(map(str, keys[:MOST_IDS])) + more or "none"
