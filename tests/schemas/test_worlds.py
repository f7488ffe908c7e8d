"""Worlds as arguments: presets, values, and two spellings of one world."""

import pytest

from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.schemas.worlds import PERFECT, PRESETS, World, combination_notes, world_of


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_named_as_it_is_called(name: str) -> None:
    assert world_of(name) == PRESETS[name].world
    assert PRESETS[name].world.in_words() == name


def test_later_items_count_and_a_world_can_be_read_back_from_its_words() -> None:
    world = world_of("missed=0.5, camera, missed=0.2, seed=3")
    assert world == PRESETS["camera"].world.model_copy(update={"missed": 0.2, "seed": 3})
    assert world_of(world.in_words()) == world
    assert world_of(["camera", "missed=0.2", "seed=3"]) == world


@pytest.mark.parametrize("first", PRESETS)
@pytest.mark.parametrize("second", PRESETS)
def test_two_presets_give_the_worse_of_each_value_in_either_order(first: str, second: str) -> None:
    both = world_of(f"{first}, {second}")
    assert both == world_of([second, first])
    for name in World.model_fields.keys() - {"ego"}:
        values = [getattr(PRESETS[one].world, name) for one in (first, second)]
        assert getattr(both, name) == (min(values) if name in ("range_m", "view_deg") else max(values)), name
    assert world_of(both.in_words()) == both


def test_a_combination_says_what_it_gives_and_a_single_preset_needs_no_note() -> None:
    (note,) = combination_notes("camera, fog, missed=0.3")
    assert "camera and fog" in note
    assert combination_notes("camera, missed=0.3") == combination_notes("perfect, fog") == ()
    assert world_of("missed=0.3, camera, fog").missed == 0.3


@pytest.mark.parametrize("text", ["", "perfect", "missed=0", "seed=4", "correlation_s=1, kept_s=1"])
def test_a_world_without_an_imperfection_is_perfect(text: str) -> None:
    assert world_of(text) is PERFECT
    assert world_of(text).stated == {}


def test_two_spellings_of_one_world_are_stated_alike() -> None:
    assert world_of("occlusion").stated == world_of("visible=0.2").stated == {"visible": 0.2}


@pytest.mark.parametrize(
    ("text", "error", "valid"),
    [
        ("fogg", UnknownName, "fog"),
        ("latency=0.2", UnknownName, "latency_s"),
        ("missed=2", InvalidRequest, "missed from 0 to 1"),
        ("missed*2", UnknownName, "lidar"),
        ("range_m=0", InvalidRequest, "range_m from 1 to 80"),
        ("seed=0.5", InvalidRequest, "seed from 0 to 2,147,483,647"),
        ("missed=range_m", InvalidRequest, "missed from 0 to 1"),
    ],
)
def test_an_unknown_world_is_refused_with_what_is_valid(text: str, error: type[InvalidRequest], valid: str) -> None:
    with pytest.raises(error) as refused:
        world_of(text)
    assert valid in refused.value.valid


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("lidar, radar, range_m=5000, night_vision", "lidar,range_m=80"),
        ("fogg, missed=2", "fog,missed=1"),
        ("camera, ego=kinematik", "camera,ego=kinematic"),
        ("ego=hovercraft, fog", "fog"),
        ("radar", None),
    ],
)
def test_all_faults_of_a_world_are_refused_together_with_the_world_that_is_left(text: str, left: str | None) -> None:
    with pytest.raises(InvalidRequest) as refused:
        world_of(text)
    (remedy,) = refused.value.remedies
    assert remedy.changes[0].values == {"world": left}
    if left is not None:
        assert not world_of(left).is_perfect


def test_every_imperfection_alone_makes_a_world_imperfect() -> None:
    qualifiers = {"correlation_s", "missed_s", "ghosts_s", "localisation_s", "kept_s", "actuator_s", "seed"}
    assert not World(ego="kinematic").is_perfect
    for name in World.model_fields.keys() - qualifiers - {"ego"}:
        assert not World(**{name: 1.0}).is_perfect, name
