"""What the answer of ``modify_scenario`` says in words."""

from typing import Any

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


def text(*touched: TouchedVehicle, ego_after: EgoDanger = RAMMING, **others: Any) -> str:
    usual: dict[str, Any] = {"edits": (), "collisions": (), "warnings": (), "removed": (), "handed_over": ()}
    result = ModifyScenarioResult(
        scenario_id=None,
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


def test_the_line_of_danger_names_vehicle_and_time_and_that_edits_are_not_seen() -> None:
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


def test_an_answer_to_fifty_edits_of_a_hundred_vehicles_stays_short_and_useful() -> None:
    routes = [route(key, *range(key, key + 20)) for key in range(70_000, 70_100)]
    edits = [edit(index, *routes, what=f"{'long words ' * 60}; {WHY}", done=index != 30) for index in range(50)]
    touched = [SHIFTED.model_copy(update={"vehicle_id": one.vehicle_id}) for one in routes]
    answer = text(
        *touched,
        edits=tuple(edits),
        collisions=tuple(EditCollision(vehicles=(key, key + 1), time_s=4.0) for key in range(70_000, 70_090)),
        warnings=tuple(f"note {number} {'of many words ' * 40}" for number in range(40)),
        removed=tuple(range(60_000, 60_100)),
        handed_over=tuple(range(70_000, 70_100)),
    )
    assert count_tokens(answer) <= 1500
    assert "… and 40 more edits, 39 of them done; not done: 30" in answer
    assert "70005 with 70006 at 4.0 s and 84 more" in answer
    assert "… and 34 more notes" in answer


def test_a_sentence_that_is_cut_keeps_its_end_where_it_says_why_nothing_was_done() -> None:
    edits = tuple(edit(index, what=f"{'long words ' * 60}; {WHY}", done=False) for index in range(10))
    assert text(edits=edits).count(WHY) == 10
    assert f"{'long words ' * 60}; {WHY}" in text(edits=edits[:1])


def test_lanelets_that_an_edit_before_has_told_of_are_not_told_again() -> None:
    on, elsewhere = route(31, 1, 11), route(32, 1, 12)
    told = text(edits=(edit(0, on), edit(1, on, elsewhere), edit(2, route(31, 1, 11, arrives=True))))
    assert told.count("31: lanelets 1 → 11") == 1
    assert told.count("32: lanelets 1 → 12") == 1
    assert "31: as above, arrives" in told


def test_of_a_long_way_the_beginning_and_the_end_are_told() -> None:
    assert "31: lanelets 1 → 2 → 3 → 4 → 5 → 6 → 7 → … → 20" in text(edits=(edit(0, route(31, *range(1, 21))),))


def test_vehicles_that_do_not_arrive_are_listed_before_those_that_do() -> None:
    routes = [route(key, 1, arrives=key != 29) for key in range(30)]
    assert "29: lanelets 1, does not arrive: the scenario ends at 10.0 s" in text(edits=(edit(0, *routes),))
