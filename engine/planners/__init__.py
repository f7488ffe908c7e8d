"""Motion planners and the loop that runs them: observe, plan, follow, judge.

``check_planner``: What a planner breaks of the contract on one task; nothing where it keeps it.
``progress_to_goal``: The share of the reference path to the goal that positions came along; None without one.
``DebugValues``: Named numbers, texts and polygons that a planner reports together with a plan.
``Goal``: The goal region of a planning problem; one of its states has to be met.
``RouteFollower``: Makes motions along the route of a task: the shortest way to an own planner.
``ReferencePath``: Points of a path about one metre apart, and the lanelets of its route.
``goal_with_path``: The goal state that an ego drives to and the reference path there; None without a route.
``EgoState``: The ego at one time step: centre in m, heading in rad, speed, acceleration and yaw rate.
``Observation``: What a planner sees before it plans: the ego and the predicted obstacles.
``Plan``: The answer of a planner: a trajectory or None, with costs and what was rejected.
``PlannedTrajectory``: States of the centre, one a step, beginning with the present.
``Planner``: The protocol that every planner satisfies.
``PlanningTask``: Everything that stays the same during a run.
``PLANNERS``: For each planner by its name the function that makes it.
``planner_names``: The names of all planners, those of others included.
``refused_planners``: Why planners of others that were found cannot be named.
``own_planner``: The planner of others of a name.
``planner_version``: A digest of the source of a planner of others; empty for built-in ones.
``built_in_version``: The version of a built-in planner, from those of packages.
``source_that_drives``: Only that digest, for any process.
``Found``: A planner of others that was found, and where.
``check_on``: What a planner of others breaks on a scenario, in words.
``PlannerCheck``: What came out of it.
``OwnPlanner``: What an entry point of the group ``plannerforge.planners`` names: the class and its declaration.
``PlannerHere``: A planner that is an object of this process.
``planners_here``: Makes objects of this process known as planners while a block runs.
``is_here``: Whether a planner is an object of this process.
``programs_named``: Makes the programs of the settings known as planners while a block runs, in workers too.
``known_planner``: A planner's name as registered; ``UnknownName`` where there is none.
``make_planner``: A new planner by its name.
``run_planner``: An operation: runs a planner on one planning problem of a CommonRoad file.
``simulate``: The run of a planner on a planning problem, until the judge ends it.
``steering_of``: The steering angle in rad at every state that the turns before and after it need on average.
``write_solution``: An operation: writes a run's trajectory as a CommonRoad solution file.
``Predictor``: A function that predicts one track.
``predictor``: The function that predicts one track on a network, by the name of a prediction.
``check_modes``: Raises ``InvalidRequest`` where a prediction does not go with the traffic.
``CarefulDriver``: UN R157's competent and careful driver.
``FuzzyDriver``: The driver of the fuzzy safety model.
``RssDriver``: The driver of Responsibility-Sensitive Safety.
``FullBraking``: A driver that brakes fully at once.
``KeepLane``: A driver that keeps its lane and speed.
``ReferenceDriver``: The protocol of these drivers.
``brakes_of``: How hard a class of vehicle brakes, and how fast that builds up.
``DriverScene``: A reference driver in the ego's place, among others that move as they did.
``DriverPath``: A way along which a reference driver drives.
``NominalMotion``: How the ego moves until its reference driver reacts.
``lane_line``: The line that keeps to the ego's lane and route, from where a planning problem begins.
``going_on``: A track up to a later step: straight on, and braking on if it braked.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .driving.solution import steering_of, write_solution
    from .external.check import PlannerCheck, check_on
    from .external.conformance import check_planner
    from .external.found import Found, OwnPlanner, PlannerHere, is_here, planners_here, programs_named
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
        known_planner,
        make_planner,
        own_planner,
        planner_names,
        planner_version,
        refused_planners,
        source_that_drives,
    )
    from .route_follower import RouteFollower
    from .runs import run_planner
    from .simulation import simulate

__getattr__, __dir__ = lazy_face(__name__, __file__)
