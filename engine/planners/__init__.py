"""Motion planners and the loop that runs them: observe, plan, follow, judge.

``check_planner``: What a planner breaks of the contract on one task; nothing where it keeps it.
``CandidateBatch``: States of n candidates at m steps, with the obstacles and lanes around them.
``responsibility``: The cost term of that name: a raw cost for each candidate, shape (n,).
``Frenetix``: The sampling planner of TUM.
``PRIMITIVE_INPUTS``: The scaled boundary values of a motion primitive, in the order of the network's inputs.
``PRIMITIVE_NODES``: How many states a motion primitive of the network has.
``PrimitiveEnds``: Where n motion primitives are to end, seen from the rear axle at their beginning.
``PrimitiveNetwork``: The network of MP-RBFN that makes motion primitives; ``shipped`` comes with the package.
``driven_poses``: The poses of a rear axle that drives scaled curvatures and speeds.
``motion_primitives``: The primitives to n ends at m times, and whether the network knows each.
``straight_lines``: Straight lines over the nodes between first and last values.
``DesiredSpeed``: How fast to drive to a goal, in m/s, and why.
``ReferenceDesiredSpeed``: The same by the rule of the Frenetix reference loop.
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
``BEYOND_GOAL_M``: How far a reference path goes on beyond its goal at least, in m.
``build_reference_path``: The path of a route for an ego at a position and speed.
``PLANNERS``: For each planner by its name the function that makes it.
``planner_names``: The names of all planners, those of others included.
``refused_planners``: Why planners of others that were found cannot be named.
``own_planner``: The planner of others of a name.
``planner_version``: A digest of the source of a planner of others; empty for built-in ones.
``built_in_version``: The version of a built-in planner, from those of packages.
``version_that_drives``: The version of a planner in words and as a digest, for workers.
``source_that_drives``: Only that digest, for any process.
``Found``: A planner of others that was found, and where.
``check_on``: What a planner of others breaks on a scenario, in words.
``PlannerCheck``: What came out of it.
``OwnPlanner``: What an entry point of the group ``plannerforge.planners`` names: the class and its declaration.
``ScenarioFile``: The file that a program plans on.
``planner_driver``: A user's planner as the loop drives it, for a ``with`` block.
``PlannerHere``: A planner that is an object of this process.
``planners_here``: Makes objects of this process known as planners while a block runs.
``is_here``: Whether a planner is an object of this process.
``programs_named``: Makes the programs of the settings known as planners while a block runs, in workers too.
``known_planner``: A planner's name as registered; ``UnknownName`` where there is none.
``make_planner``: A new planner by its name.
``run_planner``: An operation: runs a planner on one planning problem of a CommonRoad file.
``run_steps``: The driven states of a run, with costs and rejections of its plans.
``DrivenRun``: States, plans and verdict of a run.
``simulate``: The run of a planner on a planning problem, until the judge ends it.
``DrivenStates``: A driven motion as CommonRoad's benchmark sees it, with its steering angles.
``Refused``: Why CommonRoad's benchmark refuses a motion, and from which state on.
``refusal``: Why it refuses a motion that hit no road user; None if it accepts it.
``steering_of``: The steering angle in rad at every state that the turns before and after it need on average.
``write_solution``: An operation: writes a run's trajectory as a CommonRoad solution file.
``Predictor``: A function that predicts one track.
``predictor``: The function that predicts one track on a network, by the name of a prediction.
``follows``: Whether a place is straight behind the ego, in the cone that guessed futures leave out.
``check_modes``: Raises ``InvalidRequest`` where a prediction does not go with the traffic.
``open_traffic``: The others of a scenario, recorded or reactive, at the ego's first step.
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
``RecordedTraffic``: The obstacles of a scenario, following their recordings.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .driving.acceptance import DrivenStates, Refused, refusal
    from .driving.desired_speed import DesiredSpeed, ReferenceDesiredSpeed
    from .driving.solution import steering_of, write_solution
    from .external.check import PlannerCheck, check_on
    from .external.command import ScenarioFile
    from .external.conformance import check_planner
    from .external.found import Found, OwnPlanner, PlannerHere, is_here, planners_here, programs_named
    from .external.program import planner_driver
    from .frenetix.costs import CandidateBatch, responsibility
    from .frenetix.planner import Frenetix
    from .goal import Goal, goal_with_path, progress_to_goal
    from .interface import DebugValues, EgoState, Observation, Plan, PlannedTrajectory, Planner, PlanningTask
    from .prediction import Predictor, follows, predictor
    from .rbfn.network import (
        PRIMITIVE_INPUTS,
        PRIMITIVE_NODES,
        PrimitiveEnds,
        PrimitiveNetwork,
        driven_poses,
        motion_primitives,
        straight_lines,
    )
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
    from .reference_path import BEYOND_GOAL_M, ReferencePath, build_reference_path
    from .registry import (
        PLANNERS,
        built_in_version,
        check_modes,
        known_planner,
        make_planner,
        open_traffic,
        own_planner,
        planner_names,
        planner_version,
        refused_planners,
        source_that_drives,
        version_that_drives,
    )
    from .route_follower import RouteFollower
    from .runs import run_planner, run_steps
    from .simulation import DrivenRun, simulate
    from .traffic.recorded import RecordedTraffic

__getattr__, __dir__ = lazy_face(__name__, __file__)
