"""Networks in which lanelets lie over one another or fork without end: refused by name, or cut where that is said."""

from pathlib import Path

import pytest
from support.builders import Lane, ScenarioBuilder, line

from benchmarks.growth.inputs import stack, star
from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.network import NetLayout, check_file, sumo_net
from plannerforge.schemas.errors import NotPossible


def layout_of(path: Path) -> NetLayout:
    return NetLayout.of(read_scenario(path).scenario.lanelet_network)


def with_problem(path: Path) -> Path:
    """The file with an ego, without which no scenario is read."""
    problem = ScenarioBuilder((Lane(1, line((0, 0), (9, 0))),)).xml().partition("  <planningProblem")[2]
    text = path.read_text().replace("</commonRoad>", "")
    path.write_text(
        f"{text}<planningProblem{problem.replace(chr(34) + '100' + chr(34), chr(34) + '999999' + chr(34), 1)}"
    )
    return path


def test_a_stack_of_lanelets_is_refused_before_pairs_are_compared(tmp_path: Path) -> None:
    with pytest.raises(NotPossible, match=r"more than 50,000 pairs of the 400 lanelets .* Valid: .* Next: remove"):
        layout_of(with_problem(stack(tmp_path / "stack.xml", 400)))


def test_rules_report_where_they_stopped_comparing(tmp_path: Path) -> None:
    found = [one for one in check_file(stack(tmp_path / "stack.xml", 400)).findings if "not compared" in one.message]
    assert [one.rule for one in found] == ["overlapping_lanelets"]
    assert not [one for one in check_file(stack(tmp_path / "few.xml", 100)).findings if "not compared" in one.message]


def test_a_junction_has_as_many_paths_as_sumo_knows(tmp_path: Path) -> None:
    layout = layout_of(with_problem(star(tmp_path / "star.xml", 257)))
    assert max(map(len, layout.links.values())) == 257
    with pytest.raises(NotPossible, match=r"257 paths lead through .* Valid: at most 256 paths"):
        sumo_net(layout, dict.fromkeys(layout.table.lanes, 10.0))
