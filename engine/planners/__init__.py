"""Motion planners and the loop that runs them: observe, plan, follow, judge.

``check_planner``: Returns a planner's breaches of the contract on one task; empty if it keeps the contract.
``progress_to_goal``: Returns the share of the path to the goal that positions cover; None if there is no path.
``DebugValues``: Named numbers, texts and polygons that a planner reports together with a plan.
``Goal``: The goal region of a planning problem; the ego must meet one of its states.
``RouteFollower``: Generates motions along the route of a task; the quickest way to write your own planner.
``ReferencePath``: Points of a path about one metre apart, and the lanelets of its route.
``goal_with_path``: Returns the goal state that an ego drives to and the path to it; None if there is no route.
``EgoState``: The ego at one time step: centre in m, heading in rad, speed, acceleration and yaw rate.
``Observation``: What a planner sees before it plans: the ego and the predicted obstacles.
``Plan``: The answer of a planner: a trajectory (or None), its costs, and the numbers of rejected candidates.
``PlannedTrajectory``: States of the ego's centre, one per step, starting with the present one.
``Planner``: The protocol that every planner satisfies.
``PlanningTask``: Everything that stays the same during a run.
``PLANNERS``: Maps the name of each built-in planner to its factory.
``planner_names``: Returns the names of all planners, including user-supplied ones.
``refused_planners``: Returns the reasons why user-supplied planners cannot be used.
``own_planner``: Returns the user-supplied planner with a name.
``planner_version``: Returns a digest of a user-supplied planner's source; empty for built-in planners.
``built_in_version``: Returns the version of a built-in planner, derived from its packages.
``source_that_drives``: Returns only the digest of a planner's version, in any process.
``Found``: A user-supplied planner and its origin.
``check_on``: Describes a user-supplied planner's breaches of the contract on a scenario.
``PlannerCheck``: The result of ``check_on``.
``OwnPlanner``: The target of an entry point of the group ``plannerforge.planners``: the class and its declaration.
``PlannerObject``: A planner that is an object of this process.
``registered_objects``: Registers objects of this process as planners while a block runs.
``is_planner_object``: Returns whether a planner is an object of this process.
``programs_named``: Registers the programs in the settings as planners while a block runs, in workers too.
``known_planner``: Returns a planner's registered name; raises ``UnknownName`` if there is no such planner.
``make_planner``: Creates a planner by its name.
``is_built_in``: Returns whether a planner is not user-supplied.
``needs_file``: Returns whether a planner is a program, which reads the scenario's file.
``ScenarioFile``: The file of a scenario, for planners that are programs.
``ended_after``: Ends a planner's program after a block.
``open_traffic``: Yields the other road users of a run, as recorded or reacting to the ego.
``DrivenRun``: The states, plans and verdict of a run.
``driven_ego``: Returns the driven states of the ego as a track.
``run_steps``: Returns the driven states of a run as they are stored.
``uses_prediction``: Returns whether a planner uses predictions of others.
``run_planner``: An operation that runs a planner on one planning problem of a CommonRoad file.
``simulate``: Runs a planner on a planning problem until the judge ends the run.
``steering_of``: Returns the steering angle in rad at every state, the mean of those for the turns before and after it.
``write_solution``: An operation that writes a run's trajectory as a CommonRoad solution file.
``Predictor``: A function that predicts one track.
``predictor``: Returns the function that predicts one track on a network, by the name of a prediction.
``check_modes``: Raises ``InvalidRequest`` if a prediction cannot be combined with the traffic.
``check_world``: Raises ``InvalidRequest`` if a planner could see more than the sensors of a world.
``SimulatedVehicle``: The ego as a vehicle model that follows plans under a tracking controller.
``CarefulDriver``: The competent and careful driver of UN R157.
``FuzzyDriver``: The driver of the fuzzy safety model.
``RssDriver``: The driver of Responsibility-Sensitive Safety.
``FullBraking``: A driver that brakes fully at once.
``KeepLane``: A driver that keeps its lane and speed.
``ReferenceDriver``: The protocol of reference drivers.
``brakes_of``: Returns how hard a vehicle class brakes, and how fast its deceleration builds up.
``DriverScene``: A reference driver in the ego's place, among road users that move as recorded.
``DriverPath``: A path along which a reference driver drives.
``NominalMotion``: The ego's motion until its reference driver reacts.
``lane_line``: Returns the line along the ego's lane and route, starting at the initial state of a planning problem.
``going_on``: Returns a track extended to a later step: straight ahead, and still braking if the road user was braking.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .driving.dynamics import SimulatedVehicle
    from .driving.solution import steering_of, write_solution
    from .external.check import PlannerCheck, check_on
    from .external.command import ScenarioFile
    from .external.conformance import check_planner
    from .external.found import Found, OwnPlanner, PlannerObject, is_planner_object, programs_named, registered_objects
    from .external.program import ended_after
    from .goal import Goal, goal_with_path, progress_to_goal
    from .interface import DebugValues, EgoState, Observation, Plan, PlannedTrajectory, Planner, PlanningTask
    from .prediction import Predictor, predictor
    from .reference_drivers.drives import DriverScene, NominalMotion, going_on
    from .reference_drivers.lanes import lane_line
    from .reference_drivers.models import (
        CarefulDriver,
        FullBraking,
        FuzzyDriver,
        KeepLane,
        ReferenceDriver,
        RssDriver,
        brakes_of,
    )
    from .reference_drivers.paths import DriverPath
    from .reference_path import ReferencePath
    from .registry import (
        PLANNERS,
        built_in_version,
        check_modes,
        check_world,
        is_built_in,
        known_planner,
        make_planner,
        needs_file,
        open_traffic,
        own_planner,
        planner_names,
        planner_version,
        refused_planners,
        source_that_drives,
        uses_prediction,
    )
    from .route_follower import RouteFollower
    from .runs import driven_ego, run_planner, run_steps
    from .simulation import DrivenRun, simulate

__getattr__, __dir__ = lazy_face(__name__, __file__)
