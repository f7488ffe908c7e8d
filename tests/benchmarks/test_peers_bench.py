"""The bench on foreign files counts what it says, and its judges can find a fault."""

from pathlib import Path

from lxml import etree
from support.builders import town_road
from support.foreign_maps import two_roads

from benchmarks.maps.peers.bench import measure
from benchmarks.maps.peers.judges import bad_goals, commonroad_verdict, net_verdict
from plannerforge.engine.maps.foreign.opendrive import convert_opendrive


def test_files_are_counted_by_format_and_judged(tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / "peers" / name).mkdir(parents=True)
    (tmp_path / "peers" / "one" / "a.xodr").write_text(two_roads(rule="LHT"), encoding="utf-8")
    town_road().write(tmp_path / "peers" / "other" / "town.xml")
    figures = measure(tmp_path / "peers", tmp_path, part="all", limit=None, asam=None)
    assert (figures["opendrive"], figures["commonroad"], figures["accepted"]) == (1, 1, 2)
    assert figures["links"] == 2
    for key in ("wrong_refusals", "crashes", "lost_links", "invalid_goals", "wrong_side"):
        assert figures[key] == 0


def test_a_torn_network_and_a_wrong_side_are_found(tmp_path: Path) -> None:
    source = tmp_path / "a.xodr"
    source.write_text(two_roads(), encoding="utf-8")
    convert_opendrive(source, tmp_path / "a.net.xml", tmp_path)
    verdict = net_verdict(tmp_path / "a.net.xml", {}, "LHT")
    assert (verdict.links, verdict.lost) == (2, 2)
    assert verdict.wrong_side == 2


def test_a_goal_without_a_time_is_found(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "town.xml")
    assert (bad_goals(path), commonroad_verdict(path)) == (0, "")
    root = etree.parse(path).getroot()
    goal = root.findall("planningProblem/goalState")[0]
    goal.remove(goal.findall("time")[0])
    path.write_bytes(etree.tostring(root))
    assert bad_goals(path) == 1
    assert commonroad_verdict(path) != ""
