"""The compact text of a described scenario."""

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plannerforge.schemas.scenarios import DescribedEgo, DescribedLanelet, DescribedVehicle, DescribeScenarioResult


def scenario_text(result: "DescribeScenarioResult") -> str:
    """Head, ego, vehicles, lanelets, checks, how it was generated and its recipe, a line each."""
    counts = ", ".join(f"{count} {kind}" for kind, count in result.counts.items()) or "no traffic"
    lines = [f"{result.scenario_id} ({result.origin}, {result.place}): {result.duration_s:g} s, {counts}."]
    lines.append(f"Tags: {', '.join(result.tags) or 'none'}. Computed: {', '.join(result.features) or 'nothing'}.")
    if result.signs:
        lines.append(f"On the ego's lane: {', '.join(result.signs)}.")
    shown = result.description
    lines.append(ego_text(shown.ego) if shown.ego else "No planning problem, so no ego.")
    if shown.vehicles:
        lines.append(f"Vehicles, nearest to {shown.focus} first ({len(shown.vehicles)} of {shown.vehicles_total}):")
        lines += [_vehicle(vehicle) for vehicle in shown.vehicles]
    elif shown.vehicles_total:
        lines.append(f"No vehicle near {shown.focus}; {shown.vehicles_total} elsewhere: raise radius_m.")
    if shown.lanelets:
        lines.append(f"Lanelets near {shown.focus} ({len(shown.lanelets)} of {shown.lanelets_total}):")
        lines += [_lanelet(lanelet) for lanelet in shown.lanelets]
    lines += [f"Check: {check}" for check in shown.checks]
    lines += result.generation.lines() if result.generation is not None else []
    if result.recipe is not None:
        lines.append(f"Recipe: {json.dumps(result.recipe, ensure_ascii=False, sort_keys=True)}")
    return "\n".join(lines)


def ego_text(ego: "DescribedEgo") -> str:
    """Where the ego starts, what its goal asks for and its way there, in a line."""
    lanes = f"{ego.lanes} lane{'' if ego.lanes == 1 else 's'} in its direction"
    lanelets = f"lanelet {', '.join(map(str, ego.lanelets))}" if ego.lanelets else "no lanelet"
    route = f" Way: {ego.way}{f', lanelets {_chain(ego.route)}' if ego.route else ''}."
    return f"Ego: {ego.speed_mps:.1f} m/s on {lanelets}, {lanes}. Goal: {ego.goal}.{route}"


def _chain(route: tuple[int, ...]) -> str:
    shown = [str(key) for key in (route if len(route) <= 8 else (*route[:4], *route[-3:]))]
    return " → ".join(shown if len(route) <= 8 else [*shown[:4], "…", *shown[4:]])


def _vehicle(vehicle: "DescribedVehicle") -> str:
    gap = f", gap {vehicle.gap_m:.1f} m" if vehicle.gap_m is not None else ""
    lanelet = f", lanelet {vehicle.lanelet}" if vehicle.lanelet is not None else ""
    when = f", from {vehicle.from_s:g} s" if vehicle.from_s > 0 else ""
    speed = f"{vehicle.speed_mps:.1f} m/s" if vehicle.moves else "stands"
    kind = f"{vehicle.kind} ({vehicle.vehicle_class})" if vehicle.vehicle_class else vehicle.kind
    return f"- {vehicle.vehicle_id} {kind}: {vehicle.where}, {speed}{gap}{lanelet}{when}"


def _lanelet(lanelet: "DescribedLanelet") -> str:
    beside = [f"left {lanelet.left}"] if lanelet.left is not None else []
    beside += [f"right {lanelet.right}"] if lanelet.right is not None else []
    beside += [f"opposite {lanelet.opposite}"] if lanelet.opposite is not None else []
    parts = [f"{lanelet.length_m:.0f} m", *([f"edge {lanelet.edge}"] if lanelet.edge else [])]
    parts += [lanelet.role] if lanelet.role else []
    parts += [f"leads {', '.join(lanelet.successors)}" if lanelet.successors else "leads nowhere"]
    parts += [f"beside {', '.join(beside)}"] if beside else []
    parts += [f"limit {lanelet.limit_kmh:g} km/h"] if lanelet.limit_kmh else []
    parts += [f"vehicles {', '.join(map(str, lanelet.vehicles))}"] if lanelet.vehicles else []
    return f"- {lanelet.lanelet_id}: {'; '.join(parts)}"
