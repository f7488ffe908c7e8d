"""Settings as a part of a configuration: assignments, ranges, ids, files."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.planners import PLANNERS
from plannerforge.engine.tuning import changed_configuration, differences, named_configuration, to_yaml, tuning_of
from plannerforge.engine.tuning.settings import changed_settings, known_settings, setting_values
from plannerforge.engine.tuning.weight_file import read_weight_file
from plannerforge.engine.vehicles.models import VEHICLES, vehicle_of
from plannerforge.schemas.errors import InvalidRequest, PlannerForgeError, UnknownName
from plannerforge.schemas.planning import PlannerConfiguration, PlannerSettings


def base(name: str = "frenetix") -> PlannerConfiguration:
    found = named_configuration(name)
    assert found is not None
    return found


def changed(*settings: str, name: str = "frenetix") -> PlannerConfiguration:
    return changed_configuration(base(name), None, (), settings)[0]


def test_settings_are_part_of_the_configuration() -> None:
    made = changed("vehicle=1", "length_m=5", "horizon_s=4", "replan_steps=1", "sampling_level=1")
    assert made.settings == PlannerSettings(vehicle=1, length_m=5, horizon_s=4, replan_steps=1, sampling_level=1)
    assert made.config_id != base().config_id
    assert made.name == "frenetix:Default [vehicle=1, length_m=5, horizon_s=4, 2 more]"
    assert {c.name: (c.before, c.after) for c in differences(base(), made)}["length_m"] == (4.508, 5.0)
    assert made.assignments[0] == "vehicle=1"


def test_default_settings_leave_the_id_as_it_was_without_settings() -> None:
    assert changed("horizon_s=3", "length_m=4.508").config_id == base().config_id == "cfg_91fad88b6c42"


def test_stating_vehicle_2_is_another_configuration_than_leaving_it_to_the_ego() -> None:
    stated = changed("vehicle=2")
    assert stated.config_id != base().config_id
    assert stated.name.endswith("vehicle=2]")
    assert stated.settings.states_vehicle
    assert vehicle_of(stated.settings, "truck") == VEHICLES[2]
    assert vehicle_of(base().settings, "truck").length_m == 7.1
    assert changed("horizon_s=4").settings.stated_values.keys() == {"horizon_s", "replan_steps", "sampling_level"}


def test_a_stored_configuration_without_settings_has_the_default_ones() -> None:
    old = json.loads(base().model_dump_json())
    del old["settings"]
    assert PlannerConfiguration.model_validate(old) == base()


def test_a_vehicle_replaces_earlier_parameters_and_a_preset_keeps_the_settings() -> None:
    assert changed("length_m=6", "vehicle=3").settings == PlannerSettings(vehicle=3)
    own = changed("vehicle=3", "length_m*2").settings
    assert own.length_m == pytest.approx(2 * VEHICLES[3].length_m)
    kept, _ = changed_configuration(changed("horizon_s=4"), "Comfort", ())
    assert kept.settings.horizon_s == 4


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("vehicle=5", "vehicle from 1 to 4"),
        ("vehicle=1.5", "1 to 4"),
        ("replan_steps=0", "from 1 to 10"),
        ("horizon_s=30", "from 1.5 to 6"),
        ("sampling_level=nan", "finite number"),
        ("wheelbase_m=6", "wheelbase_m <= length_m"),
        ("horizon=4", "horizon_s"),
        ("jerk=1", "setting"),
    ],
)
def test_an_unknown_setting_is_refused_with_the_valid_ones(text: str, says: str) -> None:
    with pytest.raises((InvalidRequest, UnknownName)) as caught:
        changed(text)
    assert says in str(caught.value)


@pytest.mark.parametrize("value", ["nan", "inf", "1e999"])
def test_a_value_that_is_not_a_number_is_refused_with_the_range_of_its_name(value: str) -> None:
    with pytest.raises(InvalidRequest) as refusal:
        changed(f"horizon_s={value}")
    assert refusal.value.valid[0] == "horizon_s from 1.5 to 6"
    with pytest.raises(InvalidRequest) as refusal:
        changed_configuration(base(), None, [f"jerk={value}"])
    assert refusal.value.valid[0] == "a weight from 0 to 1,000,000"


def test_weights_of_the_other_planner_and_settings_among_weights_are_named() -> None:
    for planner, text, says in (
        ("idm", "jerk=1", "frenetix and fiss do"),
        ("frenetix", "time_headway_s=1", "idm, .* and rss do"),
        ("idm", "horizon_s=4", "is a setting"),
    ):
        with pytest.raises(UnknownName, match=says):
            changed_configuration(base(planner), None, [text])
    with pytest.raises(UnknownName) as caught:
        named_configuration("idm:Safety")
    assert set(caught.value.valid) == {"Default", "Cautious", "Sporty"}


def test_weights_without_effect_are_offered_only_for_their_misspellings() -> None:
    external = set(base().external_weights)
    for text in ("politeness=3", "time_headway_s=1"):
        with pytest.raises(UnknownName) as refusal:
            changed_configuration(base(), None, [text])
        assert set(refusal.value.valid) == set(base().weights)
        assert not external & set(refusal.value.valid)
    with pytest.raises(UnknownName) as misspelling:
        changed_configuration(base(), None, ["occ_vee=1"])
    assert misspelling.value.valid[0] in external


def test_a_word_for_a_setting_is_answered_with_its_range_alone() -> None:
    with pytest.raises(UnknownName) as refusal:
        changed("vehicle=bmw")
    assert refusal.value.valid == ("vehicle from 1 to 4",)


@pytest.mark.parametrize(("written", "meant"), [("450cm", "length_m=4.5"), ("15ft", "length_m=4.572")])
def test_a_value_with_a_unit_is_proposed_in_the_unit_of_its_name(written: str, meant: str) -> None:
    with pytest.raises(InvalidRequest) as refusal:
        changed(f"length_m={written}")
    assert meant in [word for remedy in refusal.value.remedies for word in remedy.changes[0].words.values()]


def test_all_wrong_settings_are_reported_together() -> None:
    with pytest.raises(InvalidRequest) as refusal:
        changed("vehicle=9", "width_m=40", "replan_steps=1.5")
    assert len(refusal.value.faults) == 3


def test_the_baseline_is_configured_like_any_planner() -> None:
    made, notes = changed_configuration(base("idm"), "sporty", ["time_headway_s*2"], ["sampling_level=1"])
    assert made.weights["time_headway_s"] == 2.0
    assert made.preset == "Sporty"
    assert "sampling_level: kept, but without effect in idm" in notes
    with pytest.raises(InvalidRequest, match="would set acceleration_mps2 to 0"):
        changed_configuration(base("idm"), None, ["acceleration_mps2=0"])
    assert base("idm").config_id == base("IDM:default").config_id


@pytest.mark.parametrize("name", ["frenetix:Comfort", "idm:Sporty"])
@pytest.mark.parametrize("settings", [(), ("vehicle=4", "width_m=2.25", "horizon_s=2.5", "replan_steps=2")])
def test_a_file_contains_the_whole_configuration(tmp_path: Path, name: str, settings: tuple[str, ...]) -> None:
    made = changed(*settings, name=name)
    path = tmp_path / "config.yaml"
    path.write_text(to_yaml(made), encoding="utf-8")
    read = read_weight_file(path)
    again, _ = changed_configuration(base(read.planner), None, read.weights, read.settings)
    assert again.config_id == made.config_id
    assert again.settings == made.settings


@given(st.data())
def test_every_setting_accepts_exactly_its_range(data: st.DataObject) -> None:
    setting = data.draw(st.sampled_from(list(known_settings().values())))
    value = data.draw(st.floats(-30, 30, allow_nan=False))
    try:
        settings, _ = changed_settings(PlannerSettings(), [f"{setting.name}={value!r}"])
    except PlannerForgeError:
        return
    assert setting.lowest <= value <= setting.highest
    assert setting_values(settings)[setting.name] == value
    assert changed_settings(settings, [f"{k}={v!r}" for k, v in settings.stated_values.items()])[0] == settings


def test_every_planner_has_a_tuning_that_fits_its_presets() -> None:
    for planner in PLANNERS:
        tuning = tuning_of(planner)
        assert tuning.first_preset in tuning.presets
        assert set(tuning.idle_settings) <= set(known_settings())
        for preset in tuning.presets.values():
            assert list(preset.weights) == list(tuning.weights)
            assert all(tuning.weights[k].lowest <= v <= tuning.weights[k].highest for k, v in preset.weights.items())
