"""Making one scenario: map → site → net → lanelets → traffic → ego and goal → CommonRoad file → checks."""

import tempfile
from pathlib import Path

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.scenarios.generate_place import build_place
from plannerforge.engine.scenarios.generate_report import describe
from plannerforge.engine.scenarios.generate_traffic import lively_traffic
from plannerforge.engine.scenarios.planning_problem import choose_task, parse_ego, parse_goal
from plannerforge.engine.scenarios.scenario_head import benchmark_id, head_of
from plannerforge.engine.scenarios.scene_order import along_the_site
from plannerforge.engine.scenarios.validate import check_scenario
from plannerforge.engine.scenarios.writer import write_scenario
from plannerforge.engine.traffic.demand import plan_counts
from plannerforge.schemas.generation import GeneratedScenario, GenerationRequest, VehicleDemand

STEP_S = 0.1


def generate(request: GenerationRequest, report: ProgressReporter) -> GeneratedScenario:
    """Make one scenario in the request's folder: ``scenario.xml`` and ``scenario.net.xml``.

    The same request gives the same bytes on one type of machine.

    Raises:
        NotPossible: the map holds no such site, a class finds no road, no car has such a goal.
        UnsafeInput: the map file is broken or hostile.
    """
    ego, goal = parse_ego(request.ego), parse_goal(request.goal)
    vehicles = request.vehicles
    notes: list[str] = []
    if ego.other_class is not None:
        notes.append(f"the ego is always a car; the asked {ego.other_class} drives in the traffic")
        if all(demand.vehicle_class != ego.other_class for demand in vehicles):
            vehicles = (*vehicles, VehicleDemand(vehicle_class=ego.other_class))
    demand = plan_counts(request.density, vehicles)
    folder = Path(request.folder)
    net_path = folder / "scenario.net.xml"
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        report(0.02, "reading the map")
        place = build_place(request, net_path, Path(scratch), STEP_S, report)
        everyone, dropped = lively_traffic(request, demand, place, net_path, Path(scratch), STEP_S, report)
    everyone = along_the_site(everyone, place.site, place.net, place.network)
    report(0.8, "choosing ego and goal")
    task = choose_task(ego, goal, everyone, place.network, STEP_S)
    others = tuple(vehicle for vehicle in everyone if vehicle is not task.ego)
    path = folder / "scenario.xml"
    head = head_of(request, place.site, place.net, STEP_S)
    write_scenario(path, head, place.network, others, task)
    report(0.9, "checking the scenario")
    checks = check_scenario(path, ego_collision_free=task.collision is None)
    if dropped:
        notes.append(f"{dropped} vehicle(s) left out because they overlapped another at step 0")
    return describe(
        request,
        benchmark_id=benchmark_id(request),
        demand=demand,
        site=place.site,
        radius_m=place.radius_m,
        network=place.network,
        task=task,
        everyone=everyone,
        checks=checks,
        step_s=STEP_S,
        notes=(*place.notes, *notes),
        warnings=place.warnings,
    )
