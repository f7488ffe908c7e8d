"""Pictures, animations, charts, reports and views.

``render``: an operation: draws a picture, an animation or a chart into a folder.
``write_report``: an operation: writes sections as one HTML page.
``write_view``: an operation: writes the data of a view, which its page shows.
``empty_page``: the page of a kind of view without data, for a host that brings them.
``filled_page``: the page with its data, to be opened in a browser.
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
    from .views.boards import write_view
    from .views.pages import empty_page, filled_page

__getattr__, __dir__ = lazy_face(__name__, __file__)
