"""Who may be put onto a lanelet, by its users, its type and the kind of road."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from support.builders import Lane, ScenarioBuilder, driving, line
from support.edits import Applied, apply_to

from plannerforge.schemas.errors import InvalidRequest, NotPossible


@dataclass(frozen=True)
class Marked(ScenarioBuilder):
    """A road whose first lanelet has a type and users of its own."""

    kind: str = "urban"
    users: tuple[str, ...] = ()

    def xml(self) -> str:
        marks = "".join(f"<userOneWay>{user}</userOneWay>" for user in self.users)
        return (
            super()
            .xml()
            .replace("<laneletType>urban<", f"<laneletType>{self.kind}<", 1)
            .replace("</laneletType>", f"</laneletType>{marks}", 1)
        )


def put(folder: Path, name: str, kind: str, users: tuple[str, ...] = (), tags: tuple[str, ...] = ("urban",)) -> Applied:
    """The edit that puts a road user onto the marked lanelet."""
    lanes = (Lane(1, line((0, 0), (200, 0))), Lane(2, line((0, 50), (200, 50))))
    others = (driving(31, (10, 50), 5.0, 41),)
    base = Marked(lanes, others, tags=tags, kind=kind, users=users).write(folder / "base.xml")
    edit = {"op": "add_vehicle", "vehicle_class": name, "at": "1", "position": "100m", "speed": "1m/s"}
    return apply_to(base, folder / "out", edit)


@pytest.mark.parametrize(
    ("name", "kind", "users"),
    [
        ("bicycle", "bicycleLane", ("bicycle",)),
        ("bicycle", "bicycleLane", ()),
        ("bus", "busLane", ()),
        ("taxi", "busLane", ("bus", "taxi")),
        ("emergency", "busLane", ("bus",)),
        ("truck", "urban", ("vehicle",)),
        ("delivery", "urban", ("truck",)),
        ("pedestrian", "urban", ("vehicle",)),
        ("pedestrian", "busLane", ()),
    ],
)
def test_a_lanelet_admits_its_named_and_implied_users(
    tmp_path: Path, name: str, kind: str, users: tuple[str, ...]
) -> None:
    assert put(tmp_path, name, kind, users).outcome.edits[0].done


@pytest.mark.parametrize(
    ("name", "kind", "users", "reason"),
    [
        ("truck", "bicycleLane", ("bicycle",), "it is for bicycle"),
        ("car", "bicycleLane", (), "it is a bicycleLane"),
        ("car", "busLane", ("bus",), "it is for bus"),
        ("car", "busLane", (), "it is a busLane"),
        ("truck", "urban", ("car",), "it is for car"),
    ],
)
def test_others_are_refused_with_a_lanelet_that_is_open(
    tmp_path: Path, name: str, kind: str, users: tuple[str, ...], reason: str
) -> None:
    with pytest.raises(NotPossible, match=f"a {name} is not allowed on lanelet 1: {reason}") as caught:
        put(tmp_path, name, kind, users)
    assert caught.value.valid == ("2",)


@pytest.mark.parametrize(
    ("kind", "users", "may"),
    [
        ("bicycleLane", (), True),
        ("urban", ("bicycle", "car"), True),
        ("urban", (), False),
        ("urban", ("vehicle",), False),
    ],
)
def test_a_lanelet_s_own_users_and_type_come_before_the_tags_of_a_motorway(
    tmp_path: Path, kind: str, users: tuple[str, ...], may: bool
) -> None:
    if may:
        assert put(tmp_path, "bicycle", kind, users, ("interstate",)).outcome.edits[0].done
    else:
        with pytest.raises(NotPossible, match="it belongs to a motorway"):
            put(tmp_path, "bicycle", kind, users, ("interstate",))


def walker(folder: Path, **arguments: object) -> Applied:
    """The edit that puts a pedestrian onto a sidewalk of 200 m."""
    lanes = (Lane(1, line((0, 0), (200, 0))), Lane(2, line((0, 50), (200, 50))))
    base = Marked(lanes, (driving(31, (10, 50), 5.0, 41),), kind="sidewalk").write(folder / "base.xml")
    return apply_to(base, folder / "out", {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "1"} | arguments)


@pytest.mark.parametrize(
    ("arguments", "what", "walked_m"),
    [
        ({"position": "30m"}, "walks along lanelet 1 from 30.0 m at 1.4 m/s", 5.6),
        ({"position": "30m", "offset_m": 5.0}, "walks along lanelet 1 from 35.0 m at 1.4 m/s", 5.6),
        ({"position": "30m", "speed": "0m/s"}, "stands on lanelet 1 at 30.0 m at 0 m/s", 0.0),
    ],
)
def test_a_pedestrian_on_a_footpath_walks_along_it_or_stands(
    tmp_path: Path, arguments: dict[str, object], what: str, walked_m: float
) -> None:
    applied = walker(tmp_path, **arguments)
    assert what in applied.outcome.edits[0].what
    places = applied.tracks()[101].positions
    assert float(places[-1, 0] - places[0, 0]) == pytest.approx(walked_m)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"position": "final"}, r"no room for a pedestrian at 200\.0 m"),
        ({"offset_m": -3.0}, r"no room for a pedestrian at -3\.0 m"),
        ({"lane": "left"}, "lane is relative to the ego or a vehicle"),
    ],
)
def test_a_place_that_is_not_on_the_footpath_is_refused(
    tmp_path: Path, arguments: dict[str, object], reason: str
) -> None:
    with pytest.raises(InvalidRequest, match=reason):
        walker(tmp_path, **arguments)
