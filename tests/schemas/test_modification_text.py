"""What the answer of ``modify_scenario`` says in words."""

from plannerforge.schemas.modification import EgoDanger, ModifyScenarioResult, TouchedVehicle
from plannerforge.schemas.modification_text import modification_text

CALM = EgoDanger(minimum_distance_m=1.49, minimum_time_to_collision_s=None, risk_score=4)
RAMMING = EgoDanger(
    minimum_distance_m=0.0,
    minimum_time_to_collision_s=0.0,
    risk_score=0,
    most_critical_id=39,
    most_critical_time_s=6.5,
)
CLOSE = RAMMING.model_copy(update={"minimum_distance_m": 0.9, "minimum_time_to_collision_s": 0.5, "risk_score": 2})
SHIFTED = TouchedVehicle(
    vehicle_id=44,
    cause="shifted",
    from_time_s=1.0,
    until_time_s=10.0,
    leaves_network=False,
    feasible=False,
    feasible_share=0.0,
)


def text(*touched: TouchedVehicle, ego_after: EgoDanger = RAMMING) -> str:
    return modification_text(
        ModifyScenarioResult(
            scenario_id=None,
            base_id="ZAM_Builder-1_1_T-1",
            edits=(),
            touched=touched,
            removed=(),
            handed_over=(),
            collisions=(),
            ego_before=CALM,
            ego_after=ego_after,
            checked_by="closed_form",
            checkers_agree=None,
            untouched=1,
            warnings=(),
        )
    )


def test_the_line_of_danger_says_whom_the_ego_meets_when_and_that_it_does_not_see_the_edits() -> None:
    assert (
        "to an ego that drives ordinarily, blind to edited traffic: minimum distance 1.49 m → 0 m, time to collision "
        "none → 0 s, risk score 4 → 0 (0 collision … 5 negligible); collision with 39 at 6.5 s"
    ) in text().splitlines()
    assert text(ego_after=CLOSE).endswith("risk score 4 → 2 (0 collision … 5 negligible); most critical: 39 at 6.5 s")
    assert text(ego_after=CALM).endswith("(0 collision … 5 negligible)")


def test_the_verdict_on_a_motion_that_was_only_moved_in_time_is_its_recording_s() -> None:
    assert "44 shifted from 1.0 s, there at 10.0 s, 0.0% of the steps feasible, as in its recording" in text(SHIFTED)
    driven = SHIFTED.model_copy(update={"cause": "edited"})
    assert "0.0% of the steps feasible, as" not in text(driven)
