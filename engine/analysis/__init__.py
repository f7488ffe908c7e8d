"""What planner runs show: rates, costs, findings, paired comparisons.

``analyse``: an operation: rates, metrics, costs and findings of runs.
``compare``: an operation: every side of a request against the first one, paired by scenario and conditions.
``Limit``: a bound on what runs show, or that they are not worse than a baseline.
``Judged``: the runs of a configuration that limits are judged on.
``parse_limit``: what the text of a limit says; refused where it says nothing.
``write_step_table``: an operation: writes the steps of a run as a table, with its series and debug values.
``write_run_table``: an operation: writes the table of a batch, a row a run.
``Course``: a run over time: motions, gap to the nearest other, time to collision.
``course_of``: a run over time, or None without its steps.
``look_at_runs``: an operation: looks at each run once; the result is stored with the run.
``known_contacts``: how the collisions of runs came about.
``METRICS``: the metrics of a run with unit, direction and the runs in which they may be compared.
``MetricSpec``: one of these metrics.
``cost_shares``: mean weighted cost of each term and its share, by configuration, the largest first.
``review_runs``: an operation: who hit whom, the closest moment and the largest motions of each run.
``RunSet``: a set of runs with their steps, configurations and scenarios.
``driven_tracks``: how the obstacles of reactive traffic moved in a run, by id.
``read_series``: the series of a run, or None if it was stored without them.
``read_steps``: the steps of a run, or None where none were kept.
``mcnemar_exact``: two-sided p of the exact McNemar test on discordant pairs.
``rate``: a share with its 95 % Wilson interval.
``success_rates``: an operation: the rates of sets of trials, with the scenario as the unit.
``wilson_interval``: the Wilson score interval of a binomial share.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .causes import known_contacts, look_at_runs
    from .comparison import compare
    from .limits import Judged, Limit, parse_limit
    from .moments import Course, course_of, review_runs
    from .run_set import METRICS, MetricSpec, RunSet, cost_shares, driven_tracks, read_series, read_steps
    from .run_table import write_run_table, write_step_table
    from .statistics import mcnemar_exact, rate, success_rates, wilson_interval
    from .summary import analyse

__getattr__, __dir__ = lazy_face(__name__, __file__)
