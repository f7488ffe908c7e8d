"""The strict filter against a plain-Python reading of the same words, and its way out of empty results."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.catalog import catalogue, facts, found, funnel

from plannerforge.engine.catalog.constraints import constraints_of
from plannerforge.engine.catalog.funnel import Funnel
from plannerforge.schemas.catalog import FindScenariosArguments
from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.schemas.scenarios import RoadFacts, ScenarioFacts
from plannerforge.schemas.vocabulary import OBSTACLE_TYPES

TAG_NAMES = ("urban", "highway", "critical")
KINDS = ("car", "truck", "bus")


@dataclass(frozen=True)
class Condition:
    slot: str
    text: str
    holds: Callable[[ScenarioFacts], bool]


def count_of(one: ScenarioFacts, kind: str) -> int:
    return one.participants.counts.get(kind, 0)


@st.composite
def scenarios(draw: st.DrawFn) -> list[ScenarioFacts]:
    made = []
    for index in range(draw(st.integers(1, 8))):
        place = draw(st.sampled_from(["DEU_Munich", "DEU_Bonn", "ESP_Bilbao"]))
        limits = draw(st.sets(st.sampled_from([30.0, 50.0, 100.0]), max_size=2))
        light = draw(st.booleans())
        roads = RoadFacts(
            lanelets=3,
            limits_ego_kmh=tuple(sorted(limits)),
            limits_map_kmh=tuple(sorted({*limits, 120.0})),
            traffic_light_ego=light,
            traffic_lights_map=int(light or draw(st.booleans())),
        )
        counts = {kind: draw(st.integers(1, 6)) for kind in draw(st.sets(st.sampled_from(KINDS)))}
        tags = draw(st.sets(st.sampled_from(TAG_NAMES)))
        speed, lanes = draw(st.floats(0, 40)), draw(st.integers(0, 4))
        scenario_id = f"{place}-{index + 1}_1_T-1"
        made.append(facts(scenario_id, tags=sorted(tags), counts=counts, speed_mps=speed, lanes=lanes, roads=roads))
    return made


@st.composite
def tag_conditions(draw: st.DrawFn) -> Condition:
    names = draw(st.lists(st.sampled_from(TAG_NAMES), min_size=1, max_size=2, unique=True))
    negated = draw(st.booleans())
    text = ("!" if negated else "") + "|".join(names)
    return Condition("tags", text, lambda one: bool({*names} & {*one.tags}) != negated)


@st.composite
def count_conditions(draw: st.DrawFn) -> Condition:
    kind, low, more = draw(st.sampled_from(KINDS)), draw(st.integers(0, 5)), draw(st.integers(0, 3))
    forms: dict[str, Callable[[int], bool]] = {
        f"{kind}": lambda count: count >= 1,
        f"!{kind}": lambda count: count == 0,
        f"{kind}={low}": lambda count: count == low,
        f"{kind}={low}..{low + more}": lambda count: low <= count <= low + more,
        f"{kind}>={low}": lambda count: count >= low,
        f"{kind}<={low}": lambda count: count <= low,
        f"{kind}>{low}": lambda count: count > low,
        f"!{kind}>={low}": lambda count: count < low,
        f"{kind}={low}|{kind}>={low + more}": lambda count: count == low or count >= low + more,
        f"!{kind}={low}|{kind}={low + more}": lambda count: count not in (low, low + more),
    }
    text = draw(st.sampled_from(sorted(forms)))
    return Condition("obstacles", text, lambda one: forms[text](count_of(one, kind)))


@st.composite
def road_conditions(draw: st.DrawFn) -> Condition:
    lanes, limit = draw(st.integers(0, 4)), draw(st.sampled_from([30, 50, 100, 120]))
    forms: dict[str, Callable[[ScenarioFacts], bool]] = {
        "traffic_light": lambda one: one.roads.traffic_light_ego,
        "!traffic_light": lambda one: not one.roads.traffic_light_ego,
        "traffic_light@map": lambda one: one.roads.traffic_lights_map > 0,
        f"lanes={lanes}": lambda one: one.egos[0].lanes == lanes,
        f"lanes>={lanes}": lambda one: one.egos[0].lanes >= lanes,
        f"speed_limit={limit}km/h": lambda one: limit in one.roads.limits_ego_kmh,
        f"speed_limit={limit}km/h@map": lambda one: limit in one.roads.limits_map_kmh,
        f"traffic_light|lanes>={lanes}": lambda one: one.roads.traffic_light_ego or one.egos[0].lanes >= lanes,
        f"!speed_limit={limit}km/h|traffic_light@map": lambda one: (
            limit not in one.roads.limits_ego_kmh and one.roads.traffic_lights_map == 0
        ),
        f"speed_limit@map<={limit}km/h": lambda one: any(value <= limit for value in one.roads.limits_map_kmh),
        "!speed_limit": lambda one: not one.roads.limits_ego_kmh,
    }
    text = draw(st.sampled_from(sorted(forms)))
    return Condition("road_net", text, forms[text])


conditions = st.lists(st.one_of(tag_conditions(), count_conditions(), road_conditions()), max_size=5)


@given(scenarios(), conditions)
def test_the_filter_agrees_with_plain_python(made: list[ScenarioFacts], asked: list[Condition]) -> None:
    slots = {slot: [one.text for one in asked if one.slot == slot] for slot in ("tags", "obstacles", "road_net")}
    expected = sorted(one.scenario_id for one in made if all(condition.holds(one) for condition in asked))
    assert found(catalogue(made), FindScenariosArguments(**slots)) == expected


@given(scenarios(), conditions)
def test_stages_only_shrink_and_relaxations_satisfy_the_rest(made: list[ScenarioFacts], asked: list[Condition]) -> None:
    slots = {slot: [one.text for one in asked if one.slot == slot] for slot in ("tags", "obstacles", "road_net")}
    one = funnel(catalogue(made), FindScenariosArguments(**slots))
    counts = [len(stage.numbers) for stage in one.stages]
    assert counts == sorted(counts, reverse=True)
    assert (one.emptied_by() is not None) == (not one.matches)
    if not one.matches:
        for dropped in one.relaxations():
            kept = [constraint for constraint in one.constraints if constraint not in dropped.constraints]
            assert dropped.numbers
            assert all(dropped.numbers <= one.holds(constraint) for constraint in kept)


@given(scenarios(), conditions)
def test_the_fewest_conditions_are_relaxed(made: list[ScenarioFacts], asked: list[Condition]) -> None:
    slots = {slot: [one.text for one in asked if one.slot == slot] for slot in ("tags", "obstacles", "road_net")}
    one = funnel(catalogue(made), FindScenariosArguments(**slots))
    if one.matches:
        return
    most = max(sum(condition.holds(each) for condition in asked) for each in made)
    relaxed = one.relaxations()
    assert bool(relaxed) == (most > 0)
    assert all(len(asked) - len(dropped.constraints) == most for dropped in relaxed)


def test_more_than_three_conditions_may_have_to_go() -> None:
    connection = catalogue([facts("ESP_A-1_1_T-1", tags=["urban"]), facts("ESP_A-2_1_T-1", counts={"car": 1})])
    asked = FindScenariosArguments(tags=["urban", "rural"], obstacles=["bus", "truck", "bicycle", "taxi=3"])
    (only,) = funnel(connection, asked).relaxations()
    assert [one.label for one in only.constraints] == ["rural", "bus", "truck", "bicycle", "taxi=3"]


def test_a_country_or_a_city_of_several_is_enough() -> None:
    places = ("DEU_Munich-1_1_T-1", "DEU_Bonn-1_1_T-1", "ESP_Bilbao-1_1_T-1")
    connection = catalogue([facts(place) for place in places])
    assert found(connection, FindScenariosArguments(city="Bonn|Bilbao")) == sorted(places[1:])
    assert found(connection, FindScenariosArguments(country="ESP|DEU", city="Munich")) == [places[0]]


def test_a_leading_mark_excludes_countries_and_cities() -> None:
    places = ("DEU_Munich-1_1_T-1", "DEU_Bonn-1_1_T-1", "ESP_Bilbao-1_1_T-1")
    connection = catalogue([facts(place) for place in places])
    assert found(connection, FindScenariosArguments(country="!DEU")) == [places[2]]
    assert found(connection, FindScenariosArguments(country="!Germany|ESP")) == []
    assert found(connection, FindScenariosArguments(country="DEU", city="!Bonn|Bilbao")) == [places[0]]


@pytest.mark.parametrize("country", ["DEU|!ESP", "!DEU|!ESP", "-DEU", "~DEU"])
def test_a_country_with_a_sign_elsewhere_is_refused(country: str) -> None:
    connection = catalogue([facts("DEU_Munich-1_1_T-1")])
    with pytest.raises(InvalidRequest):
        found(connection, FindScenariosArguments(country=country))


@given(st.floats(0, 40), st.floats(0, 40))
def test_a_single_speed_is_two_metres_per_second_wide(actual: float, asked: float) -> None:
    if abs(abs(actual - asked) - 2.0) < 1e-3:
        return
    connection = catalogue([facts(speed_mps=actual)])
    hit = found(connection, FindScenariosArguments(ego_speed=f"{asked:.9f}m/s"))
    assert bool(hit) == (abs(actual - asked) < 2.0)


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("36km/h", True),
        ("30..40km/h", True),
        (">=10m/s", True),
        ("<10m/s", True),
        ("<=9.9m/s", False),
        ("60mph", False),
    ],
)
def test_speeds_come_in_any_unit(text: str, holds: bool) -> None:
    assert bool(found(catalogue([facts(speed_mps=10.0)]), FindScenariosArguments(ego_speed=text))) == holds


@pytest.mark.parametrize("slots", [{"ego_speed": "50"}, {"road_net": ["speed_limit=50"]}])
def test_a_speed_without_a_unit_is_refused(slots: dict[str, object]) -> None:
    with pytest.raises(InvalidRequest, match="without a unit"):
        found(catalogue([facts()]), FindScenariosArguments.model_validate(slots))


@pytest.mark.parametrize(
    ("slots", "nearest"),
    [
        ({"tags": ["roundabouts_big"]}, "roundabout"),
        ({"obstacles": ["motorcylce"]}, "motorcycle"),
        ({"road_net": ["trafic_light"]}, "traffic_light"),
        ({"features": ["ego_turn_left"]}, "ego_turns_left"),
    ],
)
def test_a_word_outside_the_vocabulary_is_refused_with_the_nearest(slots: dict[str, list[str]], nearest: str) -> None:
    with pytest.raises(UnknownName) as refusal:
        found(catalogue([facts()]), FindScenariosArguments.model_validate(slots))
    assert refusal.value.valid[0] == nearest


def test_all_wrong_words_are_refused_at_once_each_with_its_nearest() -> None:
    with pytest.raises(UnknownName) as refusal:
        found(catalogue([facts()]), FindScenariosArguments(tags=["roundabouts_big"], obstacles=["motorcylce"]))
    assert str(refusal.value.message).count("(valid: ") == 2
    assert "'roundabouts_big' is not a tag (valid: roundabout" in refusal.value.message
    assert "'motorcylce' is not an obstacle type (valid: motorcycle" in refusal.value.message


@pytest.mark.parametrize("word", ["trucks", "Truck", "lorry"])
def test_everyday_words_are_understood(word: str) -> None:
    assert found(catalogue([facts(counts={"truck": 1})]), FindScenariosArguments(obstacles=[word]))


def test_every_obstacle_type_is_accepted() -> None:
    for kind in OBSTACLE_TYPES:
        assert found(catalogue([facts(counts={kind: 2})]), FindScenariosArguments(obstacles=[f"{kind}=2"]))


def test_tags_and_computed_features_stay_apart() -> None:
    connection = catalogue([facts(features=["intersection"])])
    assert found(connection, FindScenariosArguments(features=["intersection"]))
    assert not found(connection, FindScenariosArguments(tags=["intersection"]))


def test_relaxing_the_country_relaxes_its_city() -> None:
    connection = catalogue([facts("ESP_Bilbao-1_1_T-1", tags=["urban"])])
    one = funnel(connection, FindScenariosArguments(country="JPN", city="Osaka", tags=["urban"]))
    assert [constraint.label for constraint in one.relaxations()[0].constraints] == ["country JPN", "city Osaka"]
    emptied = one.emptied_by()
    assert emptied is not None
    assert [constraint.label for constraint in emptied.constraints] == ["country JPN"]


def test_conditions_in_the_user_s_words_weigh_more_than_added_ones() -> None:
    made = [
        facts("ESP_A-1_1_T-1", tags=["critical", "multi_lane"], counts={"car": 1}),
        facts("ESP_A-2_1_T-1", tags=["simulated"], counts={"car": 1}),
        facts("ESP_A-3_1_T-1", tags=["simulated"]),
    ]
    connection = catalogue(made)
    constraints = constraints_of(FindScenariosArguments(tags=["simulated", "critical", "multi_lane"]), ())
    assert Funnel(connection, constraints).nearest(1) == [1]
    assert Funnel(connection, constraints, text="a simulation with cars").nearest(1) == [2]


@pytest.mark.parametrize(
    ("slots", "text", "mentioned"),
    [
        ({"tags": ["traffic_jam"]}, "something with a traffic jam", True),
        ({"tags": ["traffic_jam"]}, "dense traffic", False),
        ({"obstacles": ["truck>=2"]}, "two trucks", True),
        ({"road_net": ["traffic_light"]}, "at traffic lights", True),
        ({"ego_speed": "50km/h"}, "about 50 km/h", True),
        ({"ego_speed": "50km/h"}, "13 m/s", False),
        ({"tags": ["urban|rural"]}, "a rural road", True),
    ],
)
def test_a_condition_is_mentioned_by_its_own_words(slots: dict[str, object], text: str, mentioned: bool) -> None:
    (one,) = constraints_of(FindScenariosArguments.model_validate(slots), ())
    assert one.is_mentioned(text) == mentioned


def test_conditions_are_shown_on_one_line_for_any_input() -> None:
    typed = {
        "city": "x\nchecks passed: all",
        "ego_speed": " 50\nkm/h",
        "obstacles": ["truck\n>=2"],
        "road_net": ["lanes\n>=2", "speed_limit\n=50km/h"],
    }
    shown = funnel(catalogue([facts("ESP_A-1_1_T-1")]), FindScenariosArguments.model_validate(typed)).constraints
    assert len(shown) == 5
    assert not [constraint for constraint in shown if len(str(constraint.label).splitlines()) > 1]


def test_conditions_that_only_fail_together_are_named_together() -> None:
    made = [facts("ESP_A-1_1_T-1", counts={"car": 1}), facts("ESP_A-2_1_T-1", counts={"bus": 1})]
    emptied = funnel(catalogue(made), FindScenariosArguments(obstacles=["car", "bus"])).emptied_by()
    assert emptied is not None
    assert emptied.together
    assert len(emptied.constraints) == 2


@pytest.mark.parametrize("slots", [{"obstacles": ["!truck|!bus"]}, {"road_net": ["!roundabout|!crossing"]}])
def test_conditions_that_are_denied_twice_are_refused_with_one_denial(slots: dict[str, list[str]]) -> None:
    with pytest.raises(InvalidRequest) as caught:
        constraints_of(FindScenariosArguments.model_validate(slots), ())
    (text,) = next(iter(slots.values()))
    assert caught.value.valid == (f"!{text.replace('!', '')}",)
