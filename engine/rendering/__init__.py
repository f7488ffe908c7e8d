"""Renders scenarios and runs: pictures, animations, charts, reports and views.

``render``: An operation that draws a picture, an animation or a chart into a folder.
``write_report``: An operation that writes sections as one HTML page.
``write_view``: An operation that writes the data of a view for its page.
``empty_page``: Returns the page of a kind of view without data, for a host that supplies the data.
``filled_page``: Returns the page with its data, for a browser.
``analysis_section``: Returns a section on findings, with the runs that they are based on.
``batch_section``: Returns a section on the runs of a batch, with the outcome, reason and figures of each.
``overview_section``: Returns a section on the tests, the results, their causes and the next step.
``rules_section``: Returns a section on the traffic rules that the runs of a batch broke.
``run_section``: Returns a section on one run.
``comparison_section``: Returns a section on verdicts, tests and flips.
``report_image``: Returns a drawn picture with its caption.
``scenario_section``: Returns a section on the content of a scenario, and how it was created.
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
