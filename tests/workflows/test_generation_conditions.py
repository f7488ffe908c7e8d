"""Conditions of a call: what words mean, what they do to density and classes, what is refused, what recipes hold."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from plannerforge.engine.execution import Limits
from plannerforge.engine.traffic import SPEED_FACTORS, heavy_factor, vehicles_per_lane_km
from plannerforge.engine.traffic.conditions import CAR_SHARES, HEAVY_SHARES
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.errors import InvalidRequest, OutsideRoots, PlannerForgeError
from plannerforge.schemas.generation import (
    NATURAL_SHARES,
    WEATHERS,
    GenerateScenariosArguments,
    GenerationRequest,
    TrafficConditions,
    VehicleDemand,
)
from plannerforge.workflows.context import Services, WorkflowContext
from plannerforge.workflows.generation.flow_tables import with_tables_read
from plannerforge.workflows.generation.specification import (
    circumstances_of,
    read_conditions,
    read_specification,
    with_natural_mix,
)


@pytest.fixture
def allowed(tmp_path: Path) -> Path:
    """A folder that tools may read."""
    folder = tmp_path / "allowed"
    folder.mkdir()
    return folder


@pytest.fixture
def call(tmp_path: Path, allowed: Path) -> Iterator[WorkflowContext]:
    """A call that may read one folder."""
    workspace, unused = Workspace(tmp_path / "workspace"), cast("Any", None)
    yield WorkflowContext(Services(workspace, unused, unused, unused, Limits(roots=(allowed,))))
    workspace.close()


def arguments(*conditions: str, **others: object) -> GenerateScenariosArguments:
    return GenerateScenariosArguments.model_validate({"conditions": list(conditions), **others})


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ("rush hour", "17:30"),
        ("night", "02:30"),
        ("7:05", "07:05"),
        ("5pm", "17:00"),
        ("12am", "00:00"),
        ("9h30", "09:30"),
    ],
)
def test_times_are_read_as_people_write_them(text: str, time: str) -> None:
    read = read_conditions(arguments(f"time={text}")).conditions
    assert read is not None
    assert read.time == time


def test_the_hour_sets_the_density_unless_one_is_given() -> None:
    free, given = read_conditions(arguments("time=rush_hour")), read_conditions(arguments("time=17:30", density="low"))
    assert free.conditions is not None
    assert given.conditions is not None
    assert free.conditions.per_lane_km == vehicles_per_lane_km(17) == 26.5
    assert given.conditions.per_lane_km is None
    assert any("26.5 vehicles per lane-km" in note for note in free.notes)
    assert any("density=low" in note for note in given.notes)


def test_hours_rank_as_their_shares_of_the_day() -> None:
    hours = range(24)
    assert sum(CAR_SHARES) == pytest.approx(100, abs=2)
    assert sum(HEAVY_SHARES) == pytest.approx(100, abs=2)
    assert sorted(hours, key=vehicles_per_lane_km) == sorted(hours, key=lambda hour: CAR_SHARES[hour])
    assert heavy_factor(10) > 1.5 > 1 > heavy_factor(17)


def test_natural_traffic_has_the_classes_of_the_statistics_and_goods_of_the_hour() -> None:
    mixed = with_natural_mix(
        (VehicleDemand(vehicle_class="bus", least=2),), TrafficConditions(natural_mix=True, time="10:30")
    )
    shares = {demand.vehicle_class: demand.share for demand in mixed}
    assert set(shares) == set(NATURAL_SHARES)
    assert shares["bus"] is None, "what was counted stays as it was"
    assert shares["delivery"] == NATURAL_SHARES["delivery"]
    assert shares["truck"] == pytest.approx(NATURAL_SHARES["truck"] * heavy_factor(10), abs=1e-5)
    assert with_natural_mix(mixed, None) == mixed


def test_every_weather_is_reported_with_its_effects() -> None:
    for weather in WEATHERS:
        (note,) = read_conditions(arguments(f"weather={weather}")).notes
        assert ("slower" in note) is (weather in SPEED_FACTORS)
    assert read_conditions(arguments("weather=rain")).notes[0].startswith("'rain' is read as light_rain")


@pytest.mark.parametrize(
    ("conditions", "named"),
    [
        (["density=4"], ["density", "time=…"]),
        (["time=25:00"], ["time=25:00", "rush_hour"]),
        (["weather=sunny"], ["no weather 'sunny'", "good"]),
        (["drivers=crazy"], ["no driver preset or published calibration 'crazy'", "aggressive", "m25_gaps"]),
        (["drivers=gb_30mph+gb_rural"], ["gb_30mph and gb_rural both set speedFactor"]),
        (["drivers=aggressive+m25_gaps"], ["calibration 'aggressive'", "gb_motorway+m25_gaps"]),
        (["mix=all"], ["mix=natural"]),
        (["time=night", "time=noon"], ["time occurs twice"]),
        (["snow"], ["snow"]),
    ],
)
def test_a_meaningless_condition_is_refused_with_valid_ones(conditions: list[str], named: list[str]) -> None:
    with pytest.raises(PlannerForgeError) as refusal:
        read_conditions(arguments(*conditions))
    assert [word for word in named if word not in refusal.value.text] == []


def test_published_calibrations_are_reported_with_their_values_and_source() -> None:
    read = read_conditions(arguments("drivers=GB motorway+m25-gaps", "weather=fog"))
    assert read.conditions is not None
    assert read.conditions.drivers == "gb_motorway+m25_gaps"
    assert read.conditions.calibrations == ("gb_motorway", "m25_gaps")
    note = read.notes[0]
    assert [
        word for word in ("Department for Transport", "0.99 ± 0.11", "Al-Obaedi", "1.1 ± 0.42 s") if word not in note
    ] == []


@pytest.mark.parametrize(
    ("conditions", "words"),
    [
        (["time=rush_hour", "weather=snow"], {"rush_hour", "snow"}),
        (["time=night"], {"night"}),
        (["time=noon"], set()),
        (["drivers=cautious"], set()),
        ([], set()),
    ],
)
def test_names_of_the_conditions_in_the_catalogue(conditions: list[str], words: set[str]) -> None:
    assert set(circumstances_of(read_conditions(arguments(*conditions)).conditions)) == words


COUNTS_CASES = [
    ("counts=Main Street:600", [("Main Street", "", 600, "")]),
    ("counts=4711:250:north; A 9 : 1200", [("4711", "", 250, "north"), ("A 9", "", 1200, "")]),
    ("counts=Elm: 10:Westbound", [("Elm", "", 10, "west")]),
    ("od=north>Main Street:300;west>east:12.5", [("north", "Main Street", 300, ""), ("west", "east", 12.5, "")]),
]


@pytest.mark.parametrize(("text", "flows"), COUNTS_CASES)
def test_flows_are_read_as_they_are_written(text: str, flows: list[tuple[str, str, float, str]]) -> None:
    read = read_conditions(arguments(text, "time=rush_hour")).conditions
    assert read is not None
    assert [(flow.road, flow.to, flow.per_h, flow.direction) for flow in read.flows] == flows
    assert read.per_lane_km is None, "counts stand in the place of the hour's density"


def test_counts_and_origins_are_listed_side_by_side() -> None:
    read = read_conditions(arguments("counts=A:5", "od=B>C:6", "trips=fringe")).conditions
    assert read is not None
    assert [str(flow) for flow in read.flows] == ["A", "B to C"]
    assert read.trips == "fringe"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("counts=Main Street", "is not a flow"),
        ("counts=A>B:5", "is not a flow"),
        ("od=A:5", "is not a flow"),
        ("counts=A:5:up", "directions: north"),
        ("counts=A:0", "above 0"),
        ("counts=A:999999", "20,000"),
        ("counts=;", "has 0 flows"),
        ("trips=some", "fringe"),
    ],
)
def test_flows_that_cannot_be_are_refused(text: str, named: str) -> None:
    with pytest.raises(PlannerForgeError) as refusal:
        read_conditions(arguments(text))
    assert named in refusal.value.text


@pytest.mark.parametrize(
    ("text", "key", "flows"),
    [
        ("road,vehicles_per_h\nMain Street,600\n4711,0\nElm,5\n", "counts", ["Main Street", "Elm"]),
        ("Street;Flow;Direction\nA;600;north\n\n", "counts", ["A (northbound)"]),
        ("\ufefffrom\tto\tvehicles\nnorth\tsouth\t60\n", "od", ["north to south"]),
    ],
)
def test_a_table_of_counts_is_read(call: WorkflowContext, allowed: Path, text: str, key: str, flows: list[str]) -> None:
    path = allowed / "counts.csv"
    path.write_text(text, encoding="utf-8")
    read = read_conditions(arguments(*with_tables_read([f"{key}={path}"], call))).conditions
    assert read is not None
    assert [str(flow) for flow in read.flows] == flows


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"", "lacks the columns road"),
        (b"road,length\nA,5\n", "columns vehicles_per_h"),
        (b"road,flow\nA,many\n", "line 2 of counts.csv"),
        (b"road,flow\nA,nan\n", "line 2 of counts.csv"),
        (b"road,flow\n,5\n", "line 2 of counts.csv"),
        (b"\xff\xfe\x00", "is not UTF-8 text"),
        (b"road,flow\n" + b"A,5\n" * 300_000, "larger than 1 MB"),
    ],
)
def test_a_table_that_cannot_be_read_is_refused(
    call: WorkflowContext, allowed: Path, content: bytes, named: str
) -> None:
    path = allowed / "counts.csv"
    path.write_bytes(content)
    with pytest.raises(InvalidRequest) as refusal:
        with_tables_read([f"counts={path}"], call)
    assert named in refusal.value.text


def test_a_table_is_in_a_folder_that_tools_may_read(call: WorkflowContext) -> None:
    with pytest.raises(OutsideRoots):
        with_tables_read(["counts=/etc/hosts.csv"], call)


def test_all_faults_of_the_conditions_are_reported_at_once() -> None:
    with pytest.raises(InvalidRequest) as refusal:
        read_conditions(arguments("time=99", "weather=sunny", "drivers=crazy"))
    assert all(word in refusal.value.text for word in ("time=99", "sunny", "crazy"))


def test_a_recipe_without_conditions_is_that_of_before() -> None:
    request = GenerationRequest(map_path="a", map_id="b", place="c", country=None, attribution="d", folder="e")
    assert "conditions" not in request.model_dump(mode="json")
    with_some = request.model_copy(update={"conditions": TrafficConditions(weather="snow")})
    assert with_some.model_dump(mode="json")["conditions"]["weather"] == "snow"


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("cut_in", "cut_in"),
        ("cut-in:lorry", "cut_in:truck"),
        ("truck cuts in", "cut_in:truck"),
        ("lead brakes", "lead_brakes_hard"),
        ("crossing:pedestrian", "crossing:pedestrian"),
    ],
)
def test_a_manoeuvre_of_others_is_understood_by_name_and_in_words(text: str, asked: str) -> None:
    read = read_conditions(arguments(f"others={text}"))
    assert (str(read.others), read.conditions) == (asked, None)


@pytest.mark.parametrize(
    ("text", "valid"),
    [
        ("unprotected_left", "goal=through:unprotected_left"),
        ("cut_inn", "cut_in"),
        ("cut_in:pedestrian", "others=crossing:pedestrian"),
        ("cut_in:trukc", "truck"),
    ],
)
def test_a_manoeuvre_that_others_cannot_make_is_refused_with_similar_ones(text: str, valid: str) -> None:
    with pytest.raises(InvalidRequest) as refusal:
        read_conditions(arguments(f"others={text}"))
    assert valid in refusal.value.valid


def test_the_class_that_is_to_make_a_manoeuvre_joins_the_traffic() -> None:
    def classes(*vehicles: str) -> list[str]:
        call = arguments("others=cut_in:truck", vehicles=list(vehicles))
        return [demand.vehicle_class for demand in read_specification(call).vehicles]

    assert classes() == ["truck"]
    assert classes("truck=3", "bus=1") == ["truck", "bus"]
    with pytest.raises(InvalidRequest):
        classes("truck=0")


def test_a_density_that_cover_varies_overrides_the_hour() -> None:
    varied = read_conditions(arguments("time=rush_hour", cover=["density=low|high"]))
    other = read_conditions(arguments("time=rush_hour", cover=["turn=left|right"]))
    assert varied.conditions is not None
    assert varied.conditions.per_lane_km is None
    assert other.conditions is not None
    assert other.conditions.per_lane_km == vehicles_per_lane_km(17)
