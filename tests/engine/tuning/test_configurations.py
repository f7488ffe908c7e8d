"""Weights, presets, changes and the configurations they make."""

import json
import math
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.planners.frenetix.costs import OWN_TERMS
from plannerforge.engine.tuning import changed_configuration, differences, named_configuration, to_yaml, tuning_of
from plannerforge.engine.tuning.settings import apply_assignments
from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.schemas.planning import PlannerConfiguration

TABLE = """
                            Default Comfort Balanced Sporty Safety
acceleration                0       0.2     0.3      0.2    0
jerk                        0       0.2     0.3      0.15   0
lateral_jerk                0.2     0.8     0.5      0.25   0.2
longitudinal_jerk           0.2     0.8     0.5      0.25   0.2
orientation_offset          0       0       0.1      0.2    0
path_length                 0       0       0.2      0.6    0
lane_center_offset          0       0.5     0.7      0.6    0
velocity_offset             1       0.3     0.6      1      1
velocity                    0       0       0.2      0.4    0
distance_to_reference_path  5       1       2        2      5
distance_to_obstacles       0       0.3     0.8      0.6    1
prediction                  0.2     0.2     0.3      0.2    0.5
responsibility              0       0.1     0.2      0.1    0.3
"""
FRENETIX = tuning_of("frenetix")
NAMES = st.sampled_from(sorted(FRENETIX.weights))
VALUES = st.floats(0.0, 1e6, allow_nan=False)


def base(name: str = "frenetix:Default") -> PlannerConfiguration:
    found = named_configuration(name)
    assert found is not None
    return found


def test_the_five_presets_have_exactly_these_values() -> None:
    head, *rows = [line.split() for line in TABLE.strip().splitlines()]
    for index, short_name in enumerate(head):
        wanted = {row[0]: float(row[index + 1]) for row in rows}
        assert FRENETIX.preset(short_name).weights == wanted
    assert [preset.short_name for preset in FRENETIX.presets.values()] == head


@pytest.mark.shared_data
def test_the_presets_agree_with_the_published_facts(shared_data: Path) -> None:
    facts = json.loads((shared_data / "facts" / "presets.json").read_text(encoding="utf-8"))["frenetix"]
    assert {entry["name"]: entry["values"] for entry in facts["presets"]} == {
        name: preset.weights for name, preset in FRENETIX.presets.items()
    }
    assert [entry["name"] for entry in facts["weights"]] == list(FRENETIX.weights)
    assert [entry["name"] for entry in facts["external_weights"]] == list(FRENETIX.external)


def test_every_weight_names_the_code_that_computes_it_and_ours_are_ours() -> None:
    ours = {name for name, weight in FRENETIX.weights.items() if weight.computed_by == "ours"}
    assert ours == set(OWN_TERMS)
    assert all(weight.acts for weight in FRENETIX.weights.values())
    assert not any(weight.acts for weight in FRENETIX.external.values())


@pytest.mark.parametrize("word", ["safety-conservative", "SAFETY", " Safety ", "Efficiency-Sporty", "sporty"])
def test_presets_are_found_by_both_names_in_any_case(word: str) -> None:
    assert FRENETIX.preset(word).short_name in ("Safety", "Sporty")


def test_an_unknown_preset_is_refused_with_all_of_them() -> None:
    with pytest.raises(UnknownName) as caught:
        FRENETIX.preset("agressive")
    assert set(caught.value.valid) == set(FRENETIX.presets)


def test_the_four_kinds_of_changes() -> None:
    changed = apply_assignments(
        base().weights, ["jerk=0.5", "prediction*2", "lateral_jerk+0.1", "velocity=lateral_jerk"]
    )
    assert changed.values["jerk"] == 0.5
    assert changed.values["prediction"] == pytest.approx(0.4)
    assert changed.values["lateral_jerk"] == pytest.approx(0.3)
    assert changed.values["velocity"] == pytest.approx(0.3)
    assert changed.notes == ()


def test_zero_times_two_stays_zero_and_is_reported() -> None:
    changed = apply_assignments(base().weights, ["jerk*2"])
    assert changed.values["jerk"] == 0.0
    assert "is 0" in changed.notes[0]


@pytest.mark.parametrize("text", ["jerk=-1", "lateral_jerk-0.3", "prediction*-1", "jerk=1e9"])
def test_weights_outside_their_range_are_refused(text: str) -> None:
    with pytest.raises(InvalidRequest):
        apply_assignments(base().weights, [text])


@pytest.mark.parametrize("text", ["jerk=nan", "jerk=inf", "jerk", "jerk==1", "jerk=1;prediction=2", "jerk=1e999"])
def test_an_invalid_change_is_refused(text: str) -> None:
    with pytest.raises(InvalidRequest):
        apply_assignments(base().weights, [text])


def test_an_unknown_weight_is_refused_with_the_nearest_first_and_without_changes() -> None:
    with pytest.raises(UnknownName) as caught:
        changed_configuration(base(), None, ["jerk=0.5", "colision=1"])
    assert caught.value.valid
    with pytest.raises(UnknownName) as caught:
        apply_assignments(base().weights, ["lateral_jrk=1"])
    assert caught.value.valid[0] == "lateral_jerk"


@given(NAMES, VALUES)
def test_setting_changes_that_weight_only(name: str, value: float) -> None:
    changed = apply_assignments(base().weights, [f"{name}={value!r}"]).values
    assert changed[name] == value
    assert {key: v for key, v in changed.items() if key != name} == {
        key: v for key, v in base().weights.items() if key != name
    }


@given(NAMES, st.floats(0.0, 100.0), st.sampled_from("*+-="), st.floats(-100.0, 100.0))
def test_a_change_gives_a_valid_weight_or_is_refused(name: str, start: float, operator: str, operand: float) -> None:
    weights = dict(base().weights) | {name: start}
    try:
        value = apply_assignments(weights, [f"{name}{operator}{operand!r}"]).values[name]
    except InvalidRequest:
        return
    assert value >= 0
    assert math.isfinite(value)


@given(st.dictionaries(NAMES, VALUES, max_size=5))
def test_the_id_is_derived_from_the_content(values: dict[str, float]) -> None:
    changes = [f"{name}={value!r}" for name, value in values.items()]
    first, _ = changed_configuration(base(), None, changes)
    second, _ = changed_configuration(base("frenetix:Comfort"), "Default", list(reversed(changes)))
    assert first.config_id == second.config_id
    assert (first.config_id == base().config_id) == (first.weights == base().weights)


def test_a_preset_replaces_all_weights_before_the_changes() -> None:
    made, _ = changed_configuration(base("frenetix:Comfort"), "Safety", ["jerk=0.1"])
    assert made.weights == FRENETIX.presets["Safety-Conservative"].weights | {"jerk": 0.1}
    assert made.base == base("frenetix:Comfort").config_id
    assert made.preset == "Safety-Conservative"


def test_differences_name_before_and_after() -> None:
    changes = differences(base(), base("frenetix:Safety-Conservative"))
    assert {(c.name, c.before, c.after) for c in changes} == {
        ("distance_to_obstacles", 0.0, 1.0),
        ("prediction", 0.2, 0.5),
        ("responsibility", 0.0, 0.3),
    }


def test_the_yaml_contains_every_weight() -> None:
    made, _ = changed_configuration(base(), None, ["jerk=0.123456789", "occ_pm=0"])
    content = yaml.safe_load(to_yaml(made))
    assert content["cost_weights"] == made.weights
    assert content["external_cost_weights"] == made.external_weights


def test_a_weight_of_an_absent_module_is_kept_and_reported_as_without_effect() -> None:
    made, notes = changed_configuration(base(), None, ["occ_pm=1"])
    assert made.external_weights["occ_pm"] == 1.0
    assert "without effect" in notes[0]


@pytest.mark.parametrize("text", ["frenetix", "Frenetix:default", "frenetix:Default"])
def test_names_of_planners_and_presets_are_configurations(text: str) -> None:
    assert base(text).config_id == base().config_id


@pytest.mark.parametrize("text", ["frenetic", "frenetix:Saf", "frenetix:"])
def test_unknown_names_are_refused(text: str) -> None:
    with pytest.raises(UnknownName):
        named_configuration(text)


def test_an_id_is_not_a_name() -> None:
    assert named_configuration("cfg_0123456789ab") is None


@pytest.mark.parametrize(
    ("planner", "word", "preset"),
    [
        *(("frenetix", "safe", "Safety-Conservative"), ("frenetix", "careful", "Safety-Conservative")),
        *(("frenetix", "Comfortable", "Comfort"), ("frenetix", "reset", "Default"), ("idm", "careful", "Cautious")),
    ],
)
def test_a_preset_by_a_word_of_the_paper_s_prompts_is_reported(planner: str, word: str, preset: str) -> None:
    made, notes = changed_configuration(named_configuration(planner), word, [])
    assert made.preset == preset
    assert f"'{word}' is read as the preset {preset}" in notes


def test_another_word_for_a_preset_is_refused_with_all_of_them() -> None:
    with pytest.raises(UnknownName) as refusal:
        changed_configuration(named_configuration("frenetix"), "komfortabel", [])
    assert refusal.value.valid[0] == "Comfort"
    assert len(refusal.value.valid) == 5


def test_an_unknown_planner_is_named_as_it_was_written() -> None:
    with pytest.raises(UnknownName, match="'ZAM_A-1_1_T-1'"):
        named_configuration("ZAM_A-1_1_T-1")
