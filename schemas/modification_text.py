"""The compact text of edits: the same as their structured content, in lines that a model or a person reads."""

from plannerforge.schemas.modification import EgoDanger, ModifyScenarioResult, TouchedVehicle, VehicleRoute


def modification_text(result: ModifyScenarioResult) -> str:
    """All of it in a few lines."""
    head = f"{result.scenario_id} (from {result.base_id})" if result.scenario_id else f"dry run on {result.base_id}"
    lines = [head + (", reused" if result.reused else "")]
    for edit in result.edits:
        lines.append(f"edit {edit.index} {edit.op} ({edit.letter}): {'done' if edit.done else 'not done'}: {edit.what}")
        lines += [f"  {_route_text(route)}" for route in edit.routes[:8]]
        if len(edit.routes) > 8:
            lines.append(f"  … and {len(edit.routes) - 8} more routes")
    lines += [_touched_text(vehicle) for vehicle in result.touched[:12]]
    if len(result.touched) > 12:
        infeasible = [vehicle.vehicle_id for vehicle in result.touched if not vehicle.feasible]
        lines.append(f"{len(result.touched)} touched in all; infeasible steps in: {_ids(infeasible)}")
    lines.append(f"removed: {_ids(result.removed)}; handed over besides: {_ids(result.handed_over)}")
    hits = [f"{hit.vehicles[0]} with {hit.vehicles[1]} at {hit.time_s:.1f} s" for hit in result.collisions]
    lines.append(f"collisions caused: {'; '.join(hits) if hits else 'none'}")
    lines.append(f"{result.untouched} vehicles exactly as recorded")
    lines += _danger_text(result.ego_before, result.ego_after)
    if result.checkers_agree is not None:
        alike = f"{result.checkers_agree} of {len(result.touched)}"
        lines.append(f"judged by the drivability checker; the closed form agrees on {alike}")
    lines += [f"note: {warning}" for warning in result.warnings]
    return "\n".join(lines)


def _route_text(route: VehicleRoute) -> str:
    way = " → ".join(str(key) for key in route.lanelets[:12]) + (" …" if len(route.lanelets) > 12 else "")
    arrives = {None: "", True: ", arrives", False: f", does not arrive: {route.reason}"}[route.arrives]
    return f"{route.vehicle_id}: lanelets {way}{arrives}"


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
    shown = ", ".join(str(key) for key in keys[:20]) + (f" and {len(keys) - 20} more" if len(keys) > 20 else "")
    return shown or "none"
