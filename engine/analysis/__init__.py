"""What planner runs show: rates, costs, findings, paired comparisons.

``compare``: Compare every side with the first one.
``cost_shares``: Terms by configuration, the largest first.
``mean_terms``: Mean weighted cost of each term over the planning steps (from ``since_step`` on).
``Evidence``: A set of runs with all that is known about them.
``driven_tracks``: How the obstacles of reactive traffic moved, by id.
``read_steps``: The steps of a run.
``SignedRank``: Result of the signed-rank test on differences after − before.
``rate``: The share with its interval.
``signed_rank``: Wilcoxon's signed-rank test.
``wilson_interval``: Score interval of a binomial share (Wilson 1927, "Probable inference"), here in Newcombe's (1998)
    notation.
``analyse``: An operation: rates, metrics, costs and findings of runs.
``write_run_table``: An operation: writes the table of a batch, a row a run.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .comparison import compare as compare
    from .costs import cost_shares as cost_shares
    from .costs import mean_terms as mean_terms
    from .evidence import Evidence as Evidence
    from .evidence import driven_tracks as driven_tracks
    from .evidence import read_steps as read_steps
    from .run_table import write_run_table as write_run_table
    from .statistics import SignedRank as SignedRank
    from .statistics import rate as rate
    from .statistics import signed_rank as signed_rank
    from .statistics import wilson_interval as wilson_interval
    from .summary import analyse as analyse

__getattr__, __dir__ = lazy_face(__name__, __file__)
