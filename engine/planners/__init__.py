"""Motion planners and the loop that runs them: observe, plan, follow, judge.

``CandidateBatch``: States of n candidates at m steps.
``responsibility``: Sum over obstacles of ``exp(−smallest gap / 2 m)`` where the ego is responsible, per candidate,
    shape (n,).
``Frenetix``: The planner.
``EgoState``: The ego at one time step.
``Observation``: What the planner sees before it plans.
``Plan``: An answer of a planner.
``PlannedTrajectory``: States of the centre, one a step beginning with the present.
``Planner``: A motion planner.
``PlanningTask``: Everything that stays the same during a run.
``BEYOND_GOAL_M``: Candidates of the planner's horizon must not leave the path.
``build_reference_path``: The path of a route for an ego that starts at ``position`` with ``speed_mps``.
``PLANNERS``: TODO.
``known_planner``: The name as registered, whatever its case.
``make_planner``: A new planner.
``run_planner``: Run a planner on one planning problem of a CommonRoad file.
``DrivenRun``: What a run has given so far.
``simulate``: Run a planner on a planning problem until the judge ends it.
``check_modes``: Refuse to tell a planner the future of vehicles that have none yet.
``open_traffic``: The others of a scenario, standing at the ego's first step.
``RecordedTraffic``: Dynamic and static obstacles of a scenario, following their recordings.
``write_solution``: An operation: writes a run's trajectory as a CommonRoad solution file.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .frenetix.costs import CandidateBatch as CandidateBatch
    from .frenetix.costs import responsibility as responsibility
    from .frenetix.planner import Frenetix as Frenetix
    from .interface import EgoState as EgoState
    from .interface import Observation as Observation
    from .interface import Plan as Plan
    from .interface import PlannedTrajectory as PlannedTrajectory
    from .interface import Planner as Planner
    from .interface import PlanningTask as PlanningTask
    from .reference_path import BEYOND_GOAL_M as BEYOND_GOAL_M
    from .reference_path import build_reference_path as build_reference_path
    from .registry import PLANNERS as PLANNERS
    from .registry import known_planner as known_planner
    from .registry import make_planner as make_planner
    from .runs import run_planner as run_planner
    from .simulation import DrivenRun as DrivenRun
    from .simulation import simulate as simulate
    from .solution import write_solution as write_solution
    from .traffic.modes import check_modes as check_modes
    from .traffic.modes import open_traffic as open_traffic
    from .traffic.recorded import RecordedTraffic as RecordedTraffic

__getattr__, __dir__ = lazy_face(__name__, __file__)
