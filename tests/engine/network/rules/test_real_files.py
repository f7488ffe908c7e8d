"""What the rules find in 100 real files: a change of a rule shows in the counts."""

from collections import Counter
from pathlib import Path

from plannerforge.engine.network.rules.check import check_file

FILES_WITH = {
    "bound_crosses_itself": 4,
    "bounds_cross": 1,
    "heading_jump": 1,
    "incoming_without_exit": 1,
    "intersection_without_incoming": 34,
    "neighbour_apart": 2,
    "overlapping_lanelets": 1,
    "repeated_points": 15,
    "sign_without_plate": 2,
    "too_tight": 1,
    "unknown_lanelet_at_intersection": 4,
}
"""Files with at least one finding, by rule; docs/rules.md says what they are."""


def test_rules_find_the_known_defects_of_100_real_files_and_nothing_else(shared_data: Path) -> None:
    files = sorted((shared_data / "data" / "commonroad").glob("*.xml"))
    chosen = [*files[::2], *files[1:5:2]]
    checked = [check_file(path) for path in chosen]
    found = Counter(rule for file in checked for rule in {finding.rule for finding in file.findings})
    assert len(chosen) == 100
    assert not any(file.unreadable for file in checked)
    assert dict(found) == FILES_WITH
    assert sum(not file.findings for file in checked) == 50
