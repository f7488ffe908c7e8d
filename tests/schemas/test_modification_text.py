"""What the answer of ``modify_scenario`` says in words."""

from typing import Any

import pytest

from plannerforge.schemas.modification import (
    EditCollision,
    EditReport,
    EgoDanger,
    ModifyScenarioResult,
    TouchedVehicle,
    VehicleRoute,
)
from plannerforge.server.tokens import count_tokens

CALM = EgoDanger(minimum_distance_m=1.49, minimum_time_to_collision_s=None, risk_score=4)
RAMMING = EgoDanger(
    minimum_distance_m=0.0, minimum_time_to_collision_s=0.0, risk_score=0, most_critical_id=39, most_critical_time_s=6.5
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


WHY = "a later edit replaces it"


def text(*touched: TouchedVehicle, ego_after: EgoDanger | None = RAMMING, **others: Any) -> str:
    usual: dict[str, Any] = {"edits": (), "collisions": (), "warnings": (), "removed": (), "handed_over": ()}
    result = ModifyScenarioResult(
        scenario_id=others.pop("scenario_id", None),
        base_id="ZAM_Builder-1_1_T-1",
        touched=touched,
        ego_before=CALM,
        ego_after=ego_after,
        checked_by="closed_form",
        checkers_agree=None,
        untouched=1,
        **usual | others,
    )
    return result.to_text()


def edit(index: int, *routes: VehicleRoute, what: str = "tau=1.5 for all", done: bool = True) -> EditReport:
    return EditReport(index=index, op="set_behaviour", letter="B", done=done, what=what, routes=routes)


def route(vehicle_id: int, *lanelets: int, arrives: bool | None = None) -> VehicleRoute:
    reason = "the scenario ends at 10.0 s" if arrives is False else ""
    return VehicleRoute(vehicle_id=vehicle_id, lanelets=lanelets, arrives=arrives, reason=reason)


def test_the_answer_states_only_what_is_new_for_the_ego() -> None:
    (changes,) = (line for line in text(SHIFTED).splitlines() if line.startswith("Change "))
    for figure in ("1.49 m → 0 m", "within 60 s → 0 s", "4 → 0", "new collision with road user 39 at 6.5 s"):
        assert figure in changes
    assert (
        "Unchanged risk for an ordinary driver as the ego: risk score 4 (0 = collision, 5 = negligible)."
        in text(ego_after=CALM).splitlines()
    )
    nearer = text(ego_after=CALM.model_copy(update={"minimum_distance_m": 0.7}))
    (change,) = (line for line in nearer.splitlines() if line.startswith("Change "))
    assert change.endswith(": minimum distance 1.49 m → 0.7 m.")


def test_a_figure_that_cannot_be_computed_gives_the_reason() -> None:
    assert "Ego's risk: unknown, because" in text(ego_after=None)
    nobody = EgoDanger(minimum_distance_m=None, minimum_time_to_collision_s=None, risk_score=None)
    assert "1.49 m → none nearby" in text(ego_after=nobody)


def test_the_verdict_on_a_motion_that_was_only_moved_in_time_is_its_recording_s() -> None:
    assert "100.0% of the motion of vehicle 44 is infeasible, as in the recording" in text(SHIFTED)
    driven = SHIFTED.model_copy(update={"cause": "edited"})
    assert "as in the recording" not in text(driven)


def test_an_answer_to_fifty_edits_of_a_hundred_vehicles_stays_short_and_useful() -> None:
    routes = [route(key, key, arrives=False) for key in range(70_000, 70_100)]
    edits = [edit(index, *routes, what=f"{'long words ' * 60}; {WHY}", done=index != 30) for index in range(50)]
    touched = [SHIFTED.model_copy(update={"vehicle_id": one.vehicle_id}) for one in routes]
    told: dict[str, Any] = {
        "edits": tuple(edits),
        "collisions": tuple(EditCollision(vehicles=(key, key + 1), time_s=4.0) for key in range(70_000, 70_090)),
        "warnings": tuple(f"note {number} {'of many words ' * 40}" for number in range(40)),
        "removed": tuple(range(60_000, 60_100)),
        "handed_over": tuple(range(70_000, 70_100)),
    }
    brief, whole = text(*touched, **told), text(*touched, detail="checks", **told)
    assert count_tokens(brief) <= 1100
    undone = "6, 7, 8, 9, 10, 11, 12, 13 and 36 more"
    assert f"… 44 more edits (not done or off target: {undone}): modify_scenario with detail=checks" in brief
    assert "70002 hits 70003 at 4.0 s; … 87 more: modify_scenario with detail=checks" in brief
    assert "… 39 more: modify_scenario with detail=checks" in brief
    assert count_tokens(brief) < count_tokens(whole) <= 6000


def test_a_shortened_sentence_keeps_its_end_with_the_reason() -> None:
    edits = tuple(edit(index, what=f"{'long words ' * 60}; {WHY}", done=False) for index in range(6))
    assert text(edits=edits).count(WHY) == 6
    assert f"{'long words ' * 60}; {WHY}" in text(edits=edits[:1])


def test_an_edit_that_misses_its_value_is_not_called_done_and_gives_the_next_step() -> None:
    late = route(31, 1, 11, arrives=False).model_copy(update={"advice": "send 31 to lanelet 11, which it reaches"})
    told = text(edits=(edit(0, late),))
    assert "1 edit off target" in told.splitlines()[0]
    assert "  31: target not reached: the scenario ends at 10.0 s (lanelets 1 → 11)" in told
    assert told.endswith("Next: send 31 to lanelet 11, which it reaches")
    assert "done" not in told


@pytest.mark.parametrize("done", [True, False])
def test_an_edit_that_was_not_done_by_all_states_what_was_requested_instead_of_what_happened(*, done: bool) -> None:
    partly = edit(0, route(1, 4, arrives=True), route(2, 5, arrives=False), done=done)
    assert partly.verdict != "done"
    for told in (text(edits=(partly,)), text(edits=(partly, edit(1)))):
        assert f"set_behaviour, {partly.verdict}; requested: tau=1.5 for all" in told
    assert "requested" not in text(edits=(edit(0),))


def test_the_headline_of_several_edits_counts_their_results() -> None:
    edits = (edit(0), edit(1, done=False), edit(2, route(1, 4, arrives=True), route(2, 5, arrives=False)))
    assert "3 edits: 1 done, 1 without effect, 1 on target for 1 of 2." in text(edits=edits).splitlines()[0]


def test_vehicles_without_differences_are_reported_once() -> None:
    routes = [route(key, 4, 5, arrives=True) for key in (31, 32, 33)]
    assert text(edits=(edit(0, *routes),)).count("lanelets 4 → 5") == 1
    assert "31, 32, 33: target reached, lanelets 4 → 5" in text(edits=(edit(0, *routes),))


def test_routes_without_a_target_are_reported_in_detail_only() -> None:
    edits = (edit(0, route(31, *range(1, 21))),)
    assert "lanelets" not in text(edits=edits)
    assert "31: lanelets 1 → 2 → 3 → 4 → 5 → 6 → 7 → … → 20" in text(edits=edits, detail="checks")


def test_an_additionally_driven_vehicle_is_named_with_the_reason() -> None:
    reacting = SHIFTED.model_copy(update={"cause": "handed_over", "reason": "would hit 12 at 3.4 s"})
    assert "Simulated instead of recorded, to avoid collisions: 44 (would hit 12 at 3.4 s)." in text(reacting)


def test_the_vehicles_that_a_word_refers_to_follow_the_edit() -> None:
    meant = edit(0).model_copy(update={"meant": "lead: 361 car 43 m ahead, same lane"})
    assert "set_behaviour: tau=1.5 for all (lead: 361 car 43 m ahead, same lane)" in text(edits=(meant,))


def test_an_edit_of_an_edited_scenario_names_the_scenario_that_all_edits_start_from() -> None:
    told = text(scenario_id="ZAM_New-1_1_T-1", earlier=1, root_id="ZAM_Root-1_1_T-1")
    assert "ZAM_Root-1_1_T-1" in told.splitlines()[0]


def test_not_all_traffic_reacts_if_a_vehicle_keeps_its_recording() -> None:
    first = next(line for line in text(traffic="reactive").splitlines() if "traffic reacts" in line)
    assert first.startswith("All drivable traffic reacts")
