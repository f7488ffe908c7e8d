"""OpenSCENARIO files as logical scenarios: ranges, distributions, actions and triggers, and what is refused by name."""

from pathlib import Path
from typing import Any

import pytest
from support.openscenario import CAR, WALKER, after_s, at, ego_near, lane_change, single, speed, story, varied

from plannerforge.engine.execution import Limits
from plannerforge.engine.exploration.concrete import concrete_edits
from plannerforge.engine.exploration.logical import logical_scenario_in
from plannerforge.schemas.errors import InvalidRequest, OutsideRoots, UnknownName, UnsafeInput
from plannerforge.schemas.exploration import LogicalScenario
from plannerforge.schemas.modification import Edit


def read(folder: Path, text: str, more: str = "") -> LogicalScenario:
    """Return the logical scenario of a story, or of a distribution of it."""
    (folder / "story.xosc").write_text(text, encoding="utf-8")
    path = folder / "story.xosc"
    if more:
        path = folder / "variation.xosc"
        path.write_text(more, encoding="utf-8")
    return logical_scenario_in(path, allowed=Limits((folder,)).allowed_path)


def edits_of(logical: LogicalScenario, **values: float) -> tuple[Edit, ...]:
    """Return the edits for values of the parameters."""
    return concrete_edits(logical, values)


def within(low: float, high: float) -> str:
    """Return a range."""
    return f'<Range lowerLimit="{low}" upperLimit="{high}"/>'


VALUES = "".join(f'<Element value="{value}" weight="1"/>' for value in (20, 50))
BINS = f'<Bin weight="1">{within(20, 30)}</Bin><Bin weight="3">{within(30, 50)}</Bin>'


def test_a_braking_lead_keeps_the_gap_between_the_bodies(tmp_path: Path) -> None:
    logical = read(tmp_path, story())
    assert [(one.name, one.low, one.high, one.base_value) for one in logical.parameters[:2]] == [
        ("gap", 10, 90, 40),
        ("rate", 1, 8, 3),
    ]
    assert logical.parameters[2].is_fixed
    assert logical.traffic == "recorded"
    ego, added, kept, braked = edits_of(logical, gap=30.0, rate=5.0)
    assert (ego.op, ego.speed) == ("set_ego", "20m/s")
    # Both bodies are as long as in the file, so the distance of the centres is that of the reference points.
    assert (added.at, added.lane, added.offset_m, added.speed) == ("ego", None, pytest.approx(30.0), "20m/s")
    assert (kept.op, kept.speed) == ("set_speed", "20m/s")
    assert (braked.speed, braked.rate_mps2, braked.time_s) == ("0m/s", 5.0, 2.0)


@pytest.mark.parametrize(("lane", "ego", "side"), [("-1", "-2", "left"), ("-3", "-2", "right"), ("3", "2", "right")])
def test_the_side_of_a_cut_in_follows_from_the_lanes(lane: str, ego: str, side: str, tmp_path: Path) -> None:
    dynamics = '<LaneChangeActionDynamics dynamicsShape="sinusoidal" dynamicsDimension="time" value="3"/>'
    logical = read(
        tmp_path,
        story(
            place=f'<LanePosition roadId="0" laneId="{lane}" s="{"${50 + $Gap}" if ego < "0" else "${50 - $Gap}"}"/>',
            ego=f'<LanePosition roadId="0" laneId="{ego}" s="50"/>',
            begins="${$Speed / 3.6 - $Rate}",
            action=lane_change(dynamics),
            condition=ego_near(
                '<RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal" value="20"'
                ' freespace="true" rule="lessThan"/>'
            ),
        ),
    )
    assert logical.traffic == "reactive"
    _, added, _, changed = edits_of(logical, gap=40.0)
    assert (added.lane, added.offset_m, added.speed) == (side, pytest.approx(40.0), "17m/s")
    assert changed.lane == ("right" if side == "left" else "left")
    assert changed.lateral_s == 3.0
    # From the ego's front to the other's centre: 20 m and half a body along the road, one lane to the side, at 20 m/s.
    assert changed.when == f"gap<={((20 + 2.25) ** 2 + 3.5**2) ** 0.5 / 20:.4f}s"


def test_the_time_between_two_others_is_computed_from_their_speeds(tmp_path: Path) -> None:
    standing = (
        f'<ScenarioObject name="Block">{CAR.format("b", "car")}</ScenarioObject></Entities>',
        f'<Private entityRef="Block"><PrivateAction>{at("<RelativeLanePosition entityRef=%s dLane=%s ds=%s/>")}'
        "</PrivateAction></Private></Actions>" % ('"Other"', '"0"', '"100"'),
    )
    dynamics = '<LaneChangeActionDynamics dynamicsShape="linear" dynamicsDimension="rate" value="1"/>'
    target = '<LaneChangeTarget><RelativeTargetLane entityRef="Block" value="1"/></LaneChangeTarget>'
    text = story(
        action=f"<LateralAction><LaneChangeAction>{dynamics}{target}</LaneChangeAction></LateralAction>",
        condition=ego_near(
            '<RelativeDistanceCondition entityRef="Block" relativeDistanceType="longitudinal" value="$Gap"'
            ' freespace="true" rule="lessThan"/>'
        ).replace('<EntityRef entityRef="Ego"/>', '<EntityRef entityRef="Other"/>'),
    )
    text = text.replace("</Entities>", standing[0]).replace("</Actions></Init>", f"{standing[1]}</Init>")
    changed = edits_of(read(tmp_path, text), gap=55.5)[-1]
    assert (changed.op, changed.lane, changed.lateral_s) == ("change_lane", "left", 3.5)
    assert changed.time_s == pytest.approx((100 - 4.5 - 55.5) / 20)


def test_a_pedestrian_crosses_from_the_side_of_its_way(tmp_path: Path) -> None:
    ends = "".join(
        f'<Vertex time="{time}"><Position><LanePosition roadId="0" laneId="-2" s="${{50 + $Gap}}" offset="{aside}"/>'
        f"</Position></Vertex>"
        for time, aside in (("0", "-5"), ("${10 / $Rate}", "5"))
    )
    walk = (
        f"<RoutingAction><FollowTrajectoryAction><Trajectory name='t' closed='false'><Shape><Polyline>{ends}</Polyline>"
        f"</Shape></Trajectory></FollowTrajectoryAction></RoutingAction>"
    )
    logical = read(
        tmp_path,
        story(
            other=WALKER,
            place='<LanePosition roadId="0" laneId="-2" s="${50 + $Gap}" offset="-5"/>',
            begins="0",
            action=walk,
            condition=ego_near('<TimeHeadwayCondition entityRef="Other" value="2" freespace="true" rule="lessThan"/>'),
        ),
    )
    _, added = edits_of(logical, gap=80.0, rate=2.0)
    assert (added.vehicle_class, added.side, added.speed) == ("pedestrian", "right", "2m/s")
    # The ego's centre is at 200 m, 1.4 m ahead of its reference point.
    assert added.position == "278.6m"
    assert added.when == f"gap<={(2 * 20 + 0.25) / 20:.4f}s"


@pytest.mark.parametrize(
    ("inner", "low", "high", "middle"),
    [
        (f"<UniformDistribution>{within(20, 60)}</UniformDistribution>", 20, 60, None),
        ('<NormalDistribution expectedValue="40" variance="25"/>', 24.55, 55.45, 40),
        (f'<NormalDistribution expectedValue="40" variance="25">{within(30, 50)}</NormalDistribution>', 30, 50, 40),
        ('<LogNormalDistribution expectedValue="40" variance="100"/>', 18.13, 83.05, 38.8),
        ('<PoissonDistribution expectedValue="30"/>', 15, 48, 30),
        (f"<Histogram>{BINS}</Histogram>", 20, 50, 36.67),
        (f"<ProbabilityDistributionSet>{VALUES}</ProbabilityDistributionSet>", 20, 50, 20),
    ],
)
def test_a_distribution_gives_a_range_and_shares(
    inner: str, low: float, high: float, middle: float | None, tmp_path: Path
) -> None:
    logical = read(tmp_path, story(), varied(single("Gap", inner)))
    gap = logical.parameter("gap")
    assert (gap.low, gap.high) == (pytest.approx(low, rel=0.01), pytest.approx(high, rel=0.01))
    assert gap.distribution is not None
    assert gap.distribution.source.startswith("variation.xosc")
    if middle is not None:
        assert gap.distribution.share_below(middle) == pytest.approx(0.5, abs=0.06)
    assert logical.parameter("rate").is_fixed  # only the distribution's own ranges count


def test_deterministic_values_give_ranges_without_frequencies(tmp_path: Path) -> None:
    range_ = '<DistributionRange stepWidth="5"><Range lowerLimit="20" upperLimit="60"/></DistributionRange>'
    sets = "".join(
        f'<ParameterValueSet><ParameterAssignment parameterRef="Rate" value="{rate}"/>'
        f'<ParameterAssignment parameterRef="Speed" value="{kmh}"/></ParameterValueSet>'
        for rate, kmh in ((2, 50), (6, 100))
    )
    text = varied(
        f'<DeterministicSingleParameterDistribution parameterName="Gap">{range_}'
        f"</DeterministicSingleParameterDistribution><DeterministicMultiParameterDistribution>"
        f"<ValueSetDistribution>{sets}</ValueSetDistribution></DeterministicMultiParameterDistribution>",
        "Deterministic",
    )
    logical = read(tmp_path, story(), text)
    assert {one.name: (one.low, one.high) for one in logical.parameters} == {
        "gap": (20, 60),
        "rate": (2, 6),
        "speed": (50, 100),
    }
    assert all(one.distribution is None for one in logical.parameters)
    assert any("ParameterValueSet" in note for note in logical.notes)


def test_a_parameter_that_decides_the_lanes_keeps_its_declared_value(tmp_path: Path) -> None:
    lanes = '<DistributionSet><Element value="1"/><Element value="-1"/></DistributionSet>'
    text = varied(
        f'<DeterministicSingleParameterDistribution parameterName="Lane">{lanes}'
        "</DeterministicSingleParameterDistribution>",
        "Deterministic",
    )
    logical = read(tmp_path, story(place='<RelativeLanePosition entityRef="Ego" dLane="$Lane" ds="$Gap"/>'), text)
    assert "lane" not in [one.name for one in logical.parameters]
    assert any(note.startswith("Lane keeps its declared value") for note in logical.notes)
    assert edits_of(logical)[1].lane == "left"


def test_a_catalogue_next_to_the_file_describes_a_vehicle(tmp_path: Path) -> None:
    (tmp_path / "vehicles").mkdir()
    entry = CAR.format("lorry", "truck").replace('length="4.5"', 'length="$Long"')
    entry = entry.replace(
        "<BoundingBox>",
        '<ParameterDeclarations><ParameterDeclaration name="Long" parameterType="double" value="7"/>'
        "</ParameterDeclarations><BoundingBox>",
    )
    (tmp_path / "vehicles" / "all.xosc").write_text(f'<OpenSCENARIO><Catalog name="v">{entry}</Catalog></OpenSCENARIO>')
    text = story(other='<CatalogReference catalogName="v" entryName="lorry"/>').replace(
        "<Entities>",
        '<CatalogLocations><VehicleCatalog><Directory path="./vehicles"/></VehicleCatalog></CatalogLocations>'
        "<Entities>",
    )
    assert edits_of(read(tmp_path, text))[1].vehicle_class == "truck"
    with pytest.raises(InvalidRequest, match="lorries"):
        read(tmp_path, text.replace('entryName="lorry"', 'entryName="lorries"'))
    with pytest.raises(OutsideRoots):
        read(tmp_path, text.replace("./vehicles", "../.."))


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"place": '<WorldPosition x="1" y="2"/>'}, "WorldPosition"),
        ({"place": '<RelativeLanePosition entityRef="Ego" dLane="3" ds="$Gap"/>'}, "lanes from the ego"),
        ({"place": '<RelativeLanePosition entityRef="Ego" dLane="0" ds="$Gap" offset="1"/>'}, "'Other'"),
        ({"place": '<RelativeLanePosition entityRef="Egon" dLane="0" ds="$Gap"/>'}, "Egon"),
        ({"place": '<RelativeLanePosition entityRef="Ego" dLane="0" ds="$Gapp"/>'}, "Gapp"),
        ({"place": '<RelativeLanePosition entityRef="Ego" dLane="0" ds="${$Gap ^ 2}"/>'}, "not allowed"),
        ({"place": '<RelativeLanePosition entityRef="Ego" dLane="0" ds="${sqrt(0 - $Gap)}"/>'}, "cannot be computed"),
        ({"place": '<RelativeLanePosition dLane="0" entityRef="Other" ds="1"/>'}, "refer to each other"),
        ({"other": '<MiscObject name="box"/>'}, "MiscObject"),
        ({"place": ""}, "Position"),
        ({"other": WALKER}, "does not cross"),
        ({"other": CAR.format("o", "bicycle"), "place": '<LanePosition laneId="-4" s="60"/>'}, "lanes from the ego"),
        ({"action": "<LateralAction><LaneOffsetAction/></LateralAction>"}, "LaneOffsetAction"),
        ({"action": speed("3")}, "in one step"),
        ({"condition": after_s("")}, "SimulationTimeCondition"),
        ({"condition": ego_near('<OffroadCondition duration="1"/>')}, "OffroadCondition"),
        (
            {"condition": ego_near('<TimeHeadwayCondition entityRef="Other" value="2" rule="greaterThan"/>')},
            "TimeHeadwayCondition",
        ),
    ],
)
def test_what_has_no_counterpart_is_refused_by_name(given: dict[str, Any], named: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidRequest, match=r"story\.xosc") as refusal:
        read(tmp_path, story(**given))
    assert named in refusal.value.message
    assert refusal.value.next_step


def test_hostile_and_foreign_files_are_refused(tmp_path: Path) -> None:
    bomb = '<!DOCTYPE o [<!ENTITY a "1"><!ENTITY b SYSTEM "file:///etc/hostname">]>'
    for text in (story(before=bomb), "<OpenSCENARIO>", "<OpenDRIVE/>", "<a>" * 200):
        with pytest.raises(UnsafeInput):
            read(tmp_path, text)
    with pytest.raises(OutsideRoots):
        read(tmp_path, story(), varied("", file="../../elsewhere.xosc"))
    with pytest.raises(InvalidRequest, match="Storyboard"):
        read(tmp_path, "<OpenSCENARIO><FileHeader/></OpenSCENARIO>")
    with pytest.raises(UnknownName, match="Gapp"):
        read(tmp_path, story(), varied(single("Gapp", '<PoissonDistribution expectedValue="3"/>')))
    with pytest.raises(InvalidRequest, match="UserDefinedDistribution"):
        read(tmp_path, story(), varied(single("Gap", "<UserDefinedDistribution/>")))
    with pytest.raises(InvalidRequest, match="variance"):
        read(tmp_path, story(), varied(single("Gap", '<NormalDistribution expectedValue="3" variance="0"/>')))
    many = "".join(f'<ParameterDeclaration name="A{n}" value="${{$A{n + 1}+$A{n + 1}}}"/>' for n in range(2_000))
    with pytest.raises(InvalidRequest, match="refers to itself"):
        read(
            tmp_path,
            story(place='<RelativeLanePosition entityRef="Ego" dLane="0" ds="$A0"/>').replace(
                "</ParameterDeclarations>", f"{many}</ParameterDeclarations>"
            ),
        )
    with pytest.raises(InvalidRequest, match="refers to itself"):
        read(tmp_path, story().replace('value="72"', 'value="${$Speed + 1}"'))
