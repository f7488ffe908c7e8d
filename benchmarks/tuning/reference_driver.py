"""Runs Frenetix-Motion-Planner in its own environment: ``python -P reference_driver.py CHECKOUT``.

Each input line is a JSON object with a scenario to drive, and each output line holds the result; ``reference.py``,
which starts this file, defines the fields. Output of its libraries goes to standard error, which is kept as the log.
This file imports nothing of the project and writes nothing into the checkout: it reads the configuration through a link
in a folder of the run.

Everything stays as configured except for the requested values (weights, prediction) and for work that only costs time:
no pictures, messages or logs, and one thread. The learned prediction is the checkout's own copy for onnxruntime
(``wale_net_lite``), because the package that it imports needs torch. The logs of a run come from the planner's own
fields after each plan.
"""

import functools
import json
import logging
import math
import os
import sys
import tempfile
import time
import types
from pathlib import Path
from typing import Any

_LAST_PLANS = 11
"""Number of plans with predictions to return: those of the last horizon of 3 s and one more."""
_CONSTRAINTS = {5: "curvature", 6: "yaw_rate", 7: "curvature_rate", 8: "acceleration"}
"""The constraint of each index in the planner's list of rejections."""


def _drive(asked: dict[str, Any], checkout: Path) -> dict[str, Any]:
    """Drive one planning problem to its end, or to an exception of its loop."""
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "logs").mkdir()
        (Path(scratch) / "configurations").symlink_to(checkout / "configurations")
        plans: list[dict[str, Any]] = []
        simulation, fault = None, ""
        spent, began = _processor_s(), time.perf_counter()
        try:
            simulation = _simulation(asked, scratch)
            _watch(simulation.agents[0].planner_interface.planner, plans)
            simulation.run_simulation()
        except Exception as error:  # noqa: BLE001 - whatever its loop raises is the outcome of this one run
            fault = _left_out(Path(scratch)) or _reason(error)
        spent, on_clock_s = _processor_s() - spent, time.perf_counter() - began
    agent = simulation.agents[0] if simulation else None
    for plan in plans[:-_LAST_PLANS]:
        del plan["predicted"]
    return {
        "fault": fault,
        "status": agent.status.name if agent else "",
        "message": str(agent.agent_state.message) if agent else "",
        "met": _met(simulation) if agent and agent.status.name == "COLLISION" else "",
        "plans": plans,
        **(_states(agent.record_state_list, agent.vehicle.wb_rear_axle) if agent else {}),
        "processor_s": spent,
        "wall_s": on_clock_s,
    }


def _simulation(asked: dict[str, Any], root: str) -> Any:
    """Return its simulation, set up as its own start script does."""
    from cr_scenario_handler.simulation.simulation import Simulation
    from cr_scenario_handler.utils.configuration_builder import ConfigurationBuilder
    from omegaconf import OmegaConf

    path = Path(asked["scenario"])
    of_loop = ConfigurationBuilder.build_sim_configuration(path.stem, str(path.parent), root)
    of_loop.simulation.use_multiagent = of_loop.simulation.multiprocessing = False
    of_loop.visualization.show_plots = of_loop.visualization.save_plots = False
    of_loop.prediction.mode = asked["prediction"]
    if asked["sees_behind"]:
        of_loop.prediction.cone_angle = 0
    of_planner = ConfigurationBuilder.build_frenetplanner_configuration(path.stem, root)
    if set(of_planner.cost.cost_weights) != set(asked["weights"]):
        raise ValueError(f"its weights are {sorted(of_planner.cost.cost_weights)}, not {sorted(asked['weights'])}")
    of_planner.cost.cost_weights = OmegaConf.create(asked["weights"])
    of_planner.debug.use_cpp = True
    of_planner.debug.activate_logging = of_planner.debug.multiproc = False
    return Simulation(of_loop, of_planner)


def _watch(planner: Any, plans: list[dict[str, Any]]) -> None:
    """Note after each plan how its candidates fared."""
    make_plan, find_free = planner.plan, planner.trajectory_collision_check
    tried: dict[str, int] = {}

    def found_free(feasible: list[Any]) -> Any:
        found = find_free(feasible)
        at = next((index for index, sample in enumerate(feasible) if sample is found), len(feasible))
        tried.update(feasible=len(feasible), free=int(found is not None))
        tried["road_edge"] = sum(sample.boundary_harm > 0 for sample in feasible[:at])
        return found

    def planned() -> Any:
        tried.clear()
        made = make_plan()
        kind = "none" if not made else "regular" if tried.get("free") else "fallback"
        counts = planner._infeasible_count_kinematics
        plans.append(
            {
                "step": int(planner.x_0.time_step),
                "kind": kind,
                "candidates": len(planner.all_traj or ()),
                "feasible": tried.get("feasible", 0),
                "rejected": {
                    **{name: int(counts[index]) for index, name in _CONSTRAINTS.items()},
                    "collision": int(planner.infeasible_count_collision),
                    "road_edge": tried.get("road_edge", 0),
                },
                "desired_mps": float(planner.desired_velocity),
                "predicted": {
                    str(key): [[round(float(x), 3), round(float(y), 3)] for x, y in one["pos_list"]]
                    for key, one in (planner.predictions or {}).items()
                },
            }
        )
        return made

    planner.plan, planner.trajectory_collision_check = planned, found_free


def _met(simulation: Any) -> str:
    """Return what its collision check found at the end: ``still`` (the road's edge or a static obstacle) or
    ``moving``.
    """
    from commonroad_dc.collision.trajectory_queries import trajectory_queries

    body = simulation.agents[0].collision_objects[-1]
    at = trajectory_queries.trajectories_collision_static_obstacles([body], simulation._cc_stat)
    return "moving" if at[0] == -1 else "still"


def _states(recorded: list[Any], behind_m: float) -> dict[str, Any]:
    """Return the driven states; it plans for the rear axle, handed over is the centre."""
    return {
        "first_step": int(recorded[0].time_step),
        "x_m": [float(state.position[0] + behind_m * math.cos(state.orientation)) for state in recorded],
        "y_m": [float(state.position[1] + behind_m * math.sin(state.orientation)) for state in recorded],
        "heading_rad": [float(state.orientation) for state in recorded],
        "speed_mps": [float(state.velocity) for state in recorded],
        "acceleration_mps2": [float(state.acceleration) for state in recorded],
    }


def _left_out(folder: Path) -> str:
    """Return why it left the ego out, if it did: it continues without it and keeps the reason in a file."""
    files = sorted(folder.rglob("log_failures_agents.csv"))
    if not files:
        return ""
    lines = [line.strip(' "') for line in files[0].read_text().splitlines()]
    return next((line[:160] for line in reversed(lines) if "Error" in line or "Exception" in line), "left out")


def _reason(error: Exception) -> str:
    """Return the error, and the function that raised it."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    where = trace.tb_frame.f_code.co_name if trace else "?"
    return f"{type(error).__name__}: {str(error)[:120]} (in {where})"


def _processor_s() -> float:
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def _load(checkout: Path) -> None:
    """Import the loop, its learned prediction from the checkout itself."""
    sys.path.insert(0, str(checkout))
    from wale_net_lite import wale_net

    options = wale_net.onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    wale_net.onnxruntime.InferenceSession = functools.partial(
        wale_net.onnxruntime.InferenceSession, sess_options=options
    )
    package, module = types.ModuleType("prediction"), types.ModuleType("prediction.main")
    setattr(module, "WaleNet", wale_net.WaleNet)  # noqa: B010 - a module made here has no such name for a type checker
    sys.modules |= {"prediction": package, "prediction.main": module}
    import cr_scenario_handler.simulation.simulation  # noqa: F401 - loaded here, so that no run's time holds it


def _main() -> None:
    """Answer line by line."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # native libraries print past sys.stdout
    sys.stdout = sys.stderr
    checkout = Path(sys.argv.pop()).resolve()  # its configuration would take it for an option
    logging.disable(logging.CRITICAL)
    _load(checkout)
    for line in sys.stdin:
        answers.write(json.dumps(_drive(json.loads(line), checkout)) + "\n")
        answers.flush()


if __name__ == "__main__":
    _main()
