"""The CommonRoad reactive planner (TUM) as a planner program with its own Python environment.

It plans a whole run on recorded traffic in its own loop, and answers with the driven trajectory.
"""

import json
import os
import sys

sys.stdout.flush()
ANSWERS = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # the libraries' output goes to the log

import numpy as np  # noqa: E402
from commonroad.common.file_reader import CommonRoadFileReader  # noqa: E402
from commonroad_clcs.config import CLCSParams  # noqa: E402
from commonroad_route_planner.fast_api.fast_api import generate_reference_path_from_scenario_and_planning_problem  # noqa: E402
from commonroad_rp.reactive_planner import ReactivePlanner  # noqa: E402
from commonroad_rp.state import ReactivePlannerState  # noqa: E402
from commonroad_rp.utility.config import ReactivePlannerConfiguration  # noqa: E402
from commonroad_rp.utility.utils_coordinate_system import CoordinateSystem  # noqa: E402


def prepared(request):
    """Return the planner with its route, vehicle and weights."""
    scenario, problems = CommonRoadFileReader(request["scenario_file"]).open()
    problem = problems.planning_problem_dict[request["problem_id"]]
    for name in ("acceleration", "yaw_rate", "slip_angle"):
        if getattr(problem.initial_state, name, None) is None:
            setattr(problem.initial_state, name, 0.0)
    weights, vehicle = request["weights"], request["settings"]
    config = ReactivePlannerConfiguration()
    config.debug.multiproc, config.debug.logging_level = False, "ERROR"
    config.planning.dt = request["step_s"]
    config.planning.time_steps_computation = round(weights["horizon_s"] / request["step_s"])
    config.planning.planning_horizon = config.planning.time_steps_computation * request["step_s"]
    config.sampling.d_min, config.sampling.d_max = -weights["lateral_m"], weights["lateral_m"]
    config.vehicle.length, config.vehicle.width = vehicle["length_m"], vehicle["width_m"]
    config.update(scenario=scenario, planning_problem=problem)
    planner = ReactivePlanner(config)
    route = generate_reference_path_from_scenario_and_planning_problem(scenario, problem)
    planner.set_reference_path(coordinate_system=CoordinateSystem(route.reference_path, clcs_params=CLCSParams()))
    return planner


def drive(planner, request):
    """Return the rear axle's states, one per time step, the plans' costs, and the reason for an early end."""
    states, costs, rejected, plan, index = [planner.x_0], [], {}, None, 0
    last_step = request["last_step"] + round(2.0 / request["step_s"])
    planner.record_state_and_input(planner.x_0)
    while states[-1].time_step < last_step and not planner.goal_reached():
        if plan is None or index >= planner.config.planning.replanning_frequency:
            planner.set_desired_velocity(current_speed=planner.x_0.velocity)
            found = planner.plan()
            if found is None:
                rejected = {"collision": planner.infeasible_count_collision, **planner.infeasible_reason_dict}
                break
            plan, index = found, 0
            costs.append(float(planner.optimal_cost))
        index += 1
        states.append(plan[0].state_list[index])
        planner.record_state_and_input(states[-1])
        planner.reset(
            initial_state_cart=states[-1],
            initial_state_curv=(plan[1][index], plan[2][index]),
            collision_checker=planner.collision_checker,
            coordinate_system=planner.coordinate_system,
        )
    rest = plan[0].state_list[index + 1 :] if plan is not None else []
    return [*states, *rest], costs, rejected


def answer(request):
    """Return the answer to a request by the published schema."""
    planner = prepared(request)
    states, costs, rejected = drive(planner, request)
    centers = [ReactivePlannerState.shift_state_to_center(s, planner.vehicle_params.wb_rear_axle) for s in states]
    driven = {
        "x_m": [float(state.position[0]) for state in centers],
        "y_m": [float(state.position[1]) for state in centers],
        "heading_rad": [float(state.orientation) for state in centers],
        "speed_mps": [max(float(state.velocity), 0.0) for state in centers],
    }
    return {
        "scenario_id": request["scenario_id"],
        "problem_id": request["problem_id"],
        "trajectory": driven if len(centers) > 1 else None,
        "costs": {"mean_total": float(np.mean(costs))} if costs else {},
        "rejected": {name: int(count) for name, count in rejected.items()},
        "candidates": int(planner.total_count_samples),
    }


for line in sys.stdin:
    print(json.dumps(answer(json.loads(line))), file=ANSWERS, flush=True)
os._exit(0)  # the libraries' objects print errors when they are destroyed
