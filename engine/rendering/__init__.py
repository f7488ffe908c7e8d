"""Pictures, animations, charts and reports.

``render``: an operation: draws a picture, an animation or a chart into a folder.
``write_report``: an operation: writes sections as one HTML page.
``analysis_section``: a section of findings with the runs behind them.
``batch_section``: a section of the runs of a batch, with outcome, reason and figures of each.
``overview_section``: a section on what was tested, what came out, whose fault it was and what is next.
``rules_section``: a section on the traffic rules that the runs of a batch broke.
``run_section``: a section on one run.
``comparison_section``: a section of verdicts, tests and flips.
``report_image``: a drawn picture with its caption.
``scenario_section``: a section on what a scenario shows, and how it was made.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .pictures import render
    from .reports import (
        analysis_section,
        batch_section,
        comparison_section,
        overview_section,
        report_image,
        rules_section,
        run_section,
        scenario_section,
        write_report,
    )

__getattr__, __dir__ = lazy_face(__name__, __file__)
