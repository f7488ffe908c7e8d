"""Analyses planner runs: rates, costs, findings and paired comparisons.

``analyse``: the operation that returns the rates, metrics, costs and findings of runs.
``compare``: the operation that compares every side of a request with the first, paired by scenario and conditions.
``Limit``: a bound on figures of runs, or the requirement that they are not worse than a baseline.
``Judged``: the runs of a configuration to which limits are applied.
``parse_limit``: parses the text of a limit; raises an error if it is not a limit.
``write_step_table``: the operation that writes the steps of a run as a table, with its series and debug values.
``write_run_table``: the operation that writes the table of a batch, one row per run.
``Course``: a run over time: motions, gap to the nearest other road user, time to collision.
``course_of``: returns a run over time, or None if its steps are missing.
``contact_in``: explains the collision in a run that is not stored.
``drivers_that_avoid``: returns the reference drivers that would hit nothing if they drove from the ego's start.
``look_at_runs``: the operation that examines each run once; the result is stored with the run.
``known_contacts``: explains the collisions in runs.
``METRICS``: the metrics of a run, with their units, directions and the runs in which they may be compared.
``MetricSpec``: one of these metrics.
``cost_shares``: returns the mean weighted cost of each term and its share, by configuration, largest share first.
``review_runs``: the operation that returns who hit whom, the closest approach and the largest motions of each run.
``RunSet``: a set of runs with their steps, configurations and scenarios.
``driven_tracks``: returns the tracks of the obstacles of reactive traffic in a run, by id.
``read_series``: returns the series of a run, or None if it was stored without them.
``read_steps``: returns the steps of a run, or None if they were not kept.
``mcnemar_exact``: returns the two-sided p of the exact McNemar test on discordant pairs.
``rate``: returns a share with its 95% Wilson interval.
``success_rates``: the operation that returns the rates of sets of trials, with the scenario as the unit.
``wilson_interval``: returns the Wilson score interval of a binomial share.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .causes import known_contacts, look_at_runs
    from .comparison import compare
    from .limits import Judged, Limit, parse_limit
    from .moments import Course, contact_in, course_of, review_runs
    from .prevention import drivers_that_avoid
    from .run_set import METRICS, MetricSpec, RunSet, cost_shares, driven_tracks, read_series, read_steps
    from .run_table import write_run_table, write_step_table
    from .statistics import mcnemar_exact, rate, success_rates, wilson_interval
    from .summary import analyse

__getattr__, __dir__ = lazy_face(__name__, __file__)
