"""Pictures, animations, charts and reports.

``analysis_section``: Findings with the runs behind them.
``batch_section``: Every run of a batch with its outcome, the reason, and its figures.
``comparison_section``: Verdicts, tests and flips.
``report_image``: A drawn picture with its caption.
``scenario_section``: What a scenario shows, and how it was made.
``render``: An operation: draws pictures, animations and charts into a folder.
``write_report``: An operation: writes an HTML page of sections.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .pictures import render as render
    from .reports import analysis_section as analysis_section
    from .reports import batch_section as batch_section
    from .reports import comparison_section as comparison_section
    from .reports import report_image as report_image
    from .reports import scenario_section as scenario_section
    from .reports import write_report as write_report

__getattr__, __dir__ = lazy_face(__name__, __file__)
