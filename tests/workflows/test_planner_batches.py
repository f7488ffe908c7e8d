"""How far a batch says it is."""

import pytest

from plannerforge.schemas.runs import LostCell
from plannerforge.workflows.runs import CellResult, own_share

STORED = CellResult(None, reused=True)
MADE = CellResult(None, LostCell(scenario_id="", config_id="", error=""))


@pytest.mark.parametrize(
    ("finished", "known", "share"),
    [
        ([], 0, 0.0),
        ([MADE] * 3, 0, 0.3),
        ([STORED] * 5, 5, 0.0),
        ([STORED] * 5 + [MADE], 5, 0.2),
        ([STORED] * 7 + [MADE], 5, 0.6),
        ([STORED] * 10, 10, 0.0),
    ],
    ids=["nothing", "new", "only looked up", "resumed", "two by somebody else", "all looked up"],
)
def test_the_share_counts_only_new_runs(finished: list[CellResult], known: int, share: float) -> None:
    assert own_share(finished, known, 10) == pytest.approx(share)
