"""The analysis of a set of runs."""

import math
from pathlib import Path

import pytest
from support.builders import town_road
from support.runs import DEFAULT, SAFE, driven, metrics, record, source

from plannerforge.engine.analysis.summary import analyse
from plannerforge.engine.execution.executor import silent
from plannerforge.schemas.errors import InvalidRequest, NotPossible, ResourceFailure, UnknownName
from plannerforge.schemas.results import AnalyseRequest, AnalyzeResultsResult
from plannerforge.schemas.runs import LimitExcess, LostCell, RunSource, ScenarioSource


def analysed(*runs: RunSource, **changes: object) -> AnalyzeResultsResult:
    values = {"results": ("batch_x",), "runs": runs, "configs": (DEFAULT, SAFE)} | changes
    return analyse(AnalyseRequest.model_validate(values), silent)


def five_runs() -> list[RunSource]:
    outcomes = ["goal_reached", "collision", "goal_reached", "invalid", "timeout"]
    return [source(record(f"DEU_Town-{n}_1_T-1", outcome)) for n, outcome in enumerate(outcomes)]  # type: ignore[arg-type]


def test_invalid_items_are_in_no_denominator() -> None:
    found = analysed(*five_runs())
    assert found.success is not None
    assert (found.runs, found.success.count, found.success.of, found.invalid_count) == (5, 2, 4, 1)
    assert found.invalid[0].scenario_id == "DEU_Town-3_1_T-1"
    assert {item.outcome: (item.count, found.valid_count) for item in found.outcomes} == {
        "goal_reached": (2, 4),
        "collision": (1, 4),
        "timeout": (1, 4),
    }
    assert "5 runs (4 valid, 1 invalid): goal 2/4 = 50%" in found.to_text()


def test_runs_without_steps_are_reported_only_if_costs_are_requested() -> None:
    assert not any("no recorded steps" in note for note in analysed(*five_runs()).notes)
    assert analysed(*five_runs(), detail="costs").note_figures["stepless_runs"] == 4


def test_refused_goals_are_shown_next_to_the_rate_by_the_papers_rule() -> None:
    outcomes = ["goal_reached", "goal_refused", "collision", "invalid"]
    found = analysed(*(source(record(f"DEU_Town-{n}_1_T-1", one)) for n, one in enumerate(outcomes)))  # type: ignore[arg-type]
    assert (found.success.count, found.success.of) == (1, 3)
    assert found.by_any_motion is not None
    assert (found.by_any_motion.count, found.by_any_motion.of) == (2, 3)
    assert "benchmark refuses: goal 2/3" in found.to_text()
    assert analysed(*five_runs()).by_any_motion is None


def test_runs_judged_by_the_older_rule_are_counted() -> None:
    older = record("DEU_Town-9_1_T-1").model_copy(update={"success_rule": "driven@1"})
    notes = analysed(*five_runs(), source(older)).notes
    assert any("1 of 5 valid runs are judged by driven@1" in note for note in notes)
    assert not any("driven@1" in note for note in analysed(*five_runs()).notes)


def test_lost_cells_are_named_and_counted_nowhere() -> None:
    lost = LostCell(scenario_id="X", config_id="cfg_a", error="[worker_timeout] late")
    found = analysed(*five_runs(), lost=(lost,))
    assert found.runs == 5
    assert found.note_figures["lost_cells"] == 1
    assert "worker_timeout" in found.to_text()


def test_only_invalid_runs_give_no_rate() -> None:
    found = analysed(source(record(outcome="invalid")), source(record("ZAM_B-1_1_T-1", "invalid")))
    assert found.success is not None
    assert found.success.share is None
    assert "goal 0/0" in found.to_text()


def test_several_configurations_are_pooled_only_on_request() -> None:
    runs = [source(record("DEU_A-1_1_T-1")), source(record("DEU_A-1_1_T-1", "collision", SAFE))]
    apart = analysed(*runs)
    assert apart.success is None
    assert (apart.outcomes, apart.metrics) == ((), ())
    assert [{one.n for one in group.metrics} for group in apart.groups] == [{1}, {1}]
    assert [group.failed_runs for group in apart.groups] == [{}, {"collision": (runs[1].record.run_id,)}]
    main = [one for one in apart.findings if one.name == "main_failure"]
    assert [one.run_ids for one in main] == [(runs[1].record.run_id,)]
    assert all("1 of 1 valid run" in one.statement for one in main), "the other configuration's runs are not its own"
    assert [(group.success.count, group.success.of) for group in apart.groups] == [(1, 1), (0, 1)]
    assert len(analysed(*runs, breakdown="country").groups) == 2
    pooled = analysed(*runs, breakdown="pooled")
    assert pooled.success is not None
    assert (pooled.success.count, pooled.success.of, pooled.groups) == (1, 2, ())


@pytest.mark.parametrize("where", ["outcome=collision", "!outcome=goal_reached", "outcome=collision|timeout"])
@pytest.mark.parametrize("breakdown", ["none", "country"])
def test_runs_chosen_by_how_they_ended_have_no_rate(where: str, breakdown: str) -> None:
    runs = [source(record("DEU_A-1_1_T-1")), *(source(record(f"DEU_A-{n}_1_T-1", "collision")) for n in (2, 3))]
    found = analysed(*runs, where=(where,), breakdown=breakdown)
    assert found.chosen_by_outcome == (where,)
    assert (found.runs, found.success) == (2, None)
    assert all(one.rate is None for one in found.outcomes)
    assert all(group.success.share is None for group in found.groups)
    assert where in found.to_text()
    assert "goal 0/2" not in found.to_text()
    assert analysed(*runs, where=("country=DEU",)).success is not None


def test_groups_follow_the_requested_breakdown() -> None:
    runs = [source(record("DEU_A-1_1_T-1")), source(record("C-USA_B-1_1_T-1", "collision"))]
    by_country = analysed(*runs, breakdown="country").groups
    assert [(group.name, group.success.count) for group in by_country] == [("DEU", 1), ("USA", 0)]
    scenarios = (ScenarioSource(scenario_id="DEU_A-1_1_T-1", path="-", obstacles={"car": 3, "truck": 9}),)
    by_count = analysed(*runs, breakdown="obstacle_count", scenarios=scenarios).groups
    assert [group.name for group in by_count] == ["10–19 obstacles", "unknown"]
    by_class = analysed(*runs, breakdown="obstacle_class", scenarios=scenarios).groups
    assert [group.name for group in by_class] == ["unknown", "with car", "with truck"]


def test_cost_of_several_configurations_is_not_averaged() -> None:
    one = analysed(source(record()), source(record("ZAM_B-1_1_T-1")))
    two = analysed(source(record()), source(record(config=SAFE)))
    assert "mean_total_cost" in {item.name for item in one.metrics}
    assert "mean_total_cost" not in {item.name for item in two.metrics}


def test_metrics_count_only_if_they_are_defined() -> None:
    runs = [source(record()), source(record("ZAM_B-1_1_T-1", figures=metrics(minimum_distance_m=None)))]
    found = {item.name: item for item in analysed(*runs).metrics}
    assert (found["minimum_distance_m"].n, found["duration_s"].n) == (1, 2)


@pytest.mark.parametrize(
    ("condition", "kept"),
    [
        ("outcome=collision", 1),
        ("!outcome=collision", 4),
        ("country=DEU", 5),
        ("city=town", 5),
        ("config=frenetix:Default", 5),
        ("duration_s>=5", 4),
        ("minimum_distance_m<0.5", 0),
    ],
)
def test_conditions_choose_runs(condition: str, kept: int) -> None:
    if kept:
        assert analysed(*five_runs(), where=(condition,)).runs == kept
    else:
        with pytest.raises(NotPossible, match="no run meets"):
            analysed(*five_runs(), where=(condition,))


@pytest.mark.parametrize(
    ("condition", "error", "named"),
    [
        ("outcom=collision", UnknownName, "outcome"),
        ("outcome=colision", UnknownName, "collision"),
        ("outcome>=3", InvalidRequest, "outcome="),
        ("duration_s=long", InvalidRequest, "duration_s>=1"),
    ],
)
def test_invalid_conditions_name_the_valid_ones(condition: str, error: type[Exception], named: str) -> None:
    with pytest.raises(error) as raised:
        analysed(*five_runs(), where=(condition,))
    assert named in str(raised.value)


def test_the_timeline_shows_the_gap_to_the_hit_vehicle(tmp_path: Path) -> None:
    scenario = ScenarioSource(scenario_id="ZAM_Town-1_1_T-1", path=str(town_road().write(tmp_path / "town.xml")))
    run = source(record(outcome="collision", obstacle_id=35), tmp_path, velocity_offset=3.0, prediction=1.0)
    found = analysed(run, detail="timeline", scenarios=(scenario,)).timeline
    assert len(found) == 10
    assert (found[-1].time_s, found[-1].obstacle_id, found[-1].largest_cost) == (4.0, 35, "velocity_offset")
    assert found[-1].largest_cost_share == pytest.approx(0.75)
    # The ego's centre is at 80 m, the other's at 165 + 8 · 4 = 197 m; half of both lengths are 2.254 and 2.25 m.
    assert found[-1].gap_m == pytest.approx(117 - 4.504, abs=1e-3)


def test_timeline_of_several_runs_is_refused() -> None:
    with pytest.raises(NotPossible, match="5"):
        analysed(*five_runs(), detail="timeline")


def test_a_timeline_shows_the_requested_span(tmp_path: Path) -> None:
    run = source(record(), tmp_path, prediction=1.0)
    found = analysed(run, detail="timeline", where=("time_s=1..2",))
    assert [found.timeline[0].time_s, found.timeline[-1].time_s] == [1.0, 2.0]
    assert "In the requested time span" in found.to_text()
    assert analysed(run, detail="timeline", where=("time_s<=0.5",)).timeline[-1].time_s == 0.5


@pytest.mark.parametrize(
    ("where", "detail", "said"),
    [
        (("time_s=60..70",), "timeline", "the run ends at"),
        (("time_s=1..2", "time_s=3..4"), "timeline", "given 2 times"),
        (("time_s=soon",), "timeline", "not a time interval"),
        (("time_s=1..2",), "summary", "time_s only"),
    ],
)
def test_spans_that_cannot_be_shown_are_refused(tmp_path: Path, where: tuple[str, ...], detail: str, said: str) -> None:
    with pytest.raises(InvalidRequest, match=said):
        analysed(source(record(), tmp_path), detail=detail, where=where)


def test_rows_are_sorted_with_the_hardest_first() -> None:
    worst, near, far = metrics(risk_score=0), metrics(risk_score=1), metrics(risk_score=4)
    runs = [
        source(record("ZAM_Far-1_1_T-1", figures=far)),
        source(record("ZAM_Near-1_1_T-1", figures=near)),
        source(record("ZAM_Hit-1_1_T-1", "collision", figures=worst)),
    ]
    found = analysed(*runs, detail="rows")
    assert [row.scenario_id.split("-")[0] for row in found.rows] == ["ZAM_Hit", "ZAM_Near", "ZAM_Far"]
    assert "Hardest first" in found.to_text()


def test_findings_that_suggest_no_weight_say_so(tmp_path: Path) -> None:
    assert "do not suggest changing any weight" in analysed(source(record(), tmp_path), detail="findings").to_text()
    harsh = metrics(maximum_lateral_acceleration_mps2=4.0)
    runs = [source(record(f"ZAM_T-{n}_1_T-1", figures=harsh)) for n in range(12)]
    assert "do not suggest changing any weight" not in analysed(*runs, detail="findings").to_text()


def test_missing_steps_are_a_failure_of_ours(tmp_path: Path) -> None:
    run = RunSource(record=record(), steps_path=str(tmp_path / "gone.json"))
    with pytest.raises(ResourceFailure, match="cannot be read"):
        analysed(run, detail="costs")


def test_correlations_need_enough_runs(tmp_path: Path) -> None:
    runs = [source(record(f"ZAM_T-{n}_1_T-1", "collision" if n < 6 else "goal_reached")) for n in range(14)]
    scenarios = tuple(
        ScenarioSource(scenario_id=run.record.scenario_id, path="-", obstacles={"car": 20 - n})
        for n, run in enumerate(runs)
    )
    assert "at least 12 are needed" in analysed(*runs[:8], scenarios=scenarios, detail="findings").notes[-1]
    found = analysed(*runs, scenarios=scenarios).correlations
    assert [item.feature for item in found] == ["obstacles"]
    assert found[0].rho < -0.8
    assert found[0].p <= found[0].p_holm < 0.01


def test_default_answer_of_a_large_batch_stays_small() -> None:
    runs = [
        source(record(f"DEU_LongNamedTown-{n}_{n}_T-1", "collision" if n % 3 else "goal_reached", config))
        for n in range(150)
        for config in (DEFAULT, SAFE)
    ]
    found = analysed(*runs)
    assert len(found.to_text()) < 4500
    assert len(found.model_dump_json()) < 10_500


def test_a_brief_answer_on_one_run_is_short_and_does_not_repeat_itself(tmp_path: Path) -> None:
    scenario = ScenarioSource(scenario_id="ZAM_Town-1_1_T-1", path=str(town_road().write(tmp_path / "town.xml")))
    run = source(record(), tmp_path, velocity_offset=3.0, prediction=1.0)
    said = analysed(run, scenarios=(scenario,)).to_text()
    assert len(said.splitlines()) <= 12
    assert "Cost: mostly velocity_offset, 75% of 3 per planning step." in said
    assert "prediction" not in said
    assert said.count("Minimum distance 2 m") == 1


def test_a_missing_metric_is_null_with_the_reason(tmp_path: Path) -> None:
    alone = metrics(
        minimum_distance_m=None, minimum_time_to_collision_s=None, minimum_time_headway_s=None, risk_score=None
    )
    result = analysed(source(record(figures=alone), tmp_path))
    assert {item.name for item in result.undefined} == {
        "minimum_distance_m",
        "minimum_time_to_collision_s",
        "minimum_time_headway_s",
        "risk_score",
    }
    assert "risk score undefined: no other" in result.to_text()
    both = analysed(source(record(figures=alone)), source(record("ZAM_B-1_1_T-1", figures=alone)))
    assert "time headway undefined: no vehicle ahead" in both.to_text()


def test_two_runs_have_a_range_and_equal_values_are_one_figure() -> None:
    near = metrics(minimum_distance_m=1.0, mean_total_cost=9.93)
    said = analysed(source(record(figures=near)), source(record("ZAM_B-1_1_T-1"))).to_text()
    assert "Range over 2 valid runs: minimum distance 1–2 m; time to collision 4 s;" in said
    assert "mean total cost 3–9.93." in said
    three = [source(record(f"ZAM_T-{n}_1_T-1", figures=metrics(minimum_distance_m=n + 1.0))) for n in range(3)]
    assert "Median (range) over 3 valid runs: minimum distance 2 (1–3) m;" in analysed(*three).to_text()


def test_a_success_shows_its_most_critical_moment_instead_of_its_end(tmp_path: Path) -> None:
    scenario = ScenarioSource(scenario_id="ZAM_Town-1_1_T-1", path=str(town_road().write(tmp_path / "town.xml")))
    near = analysed(source(record(), tmp_path), scenarios=(scenario,)).review
    assert near is not None
    assert near.closest is None  # the record's gap is not what the tracks show
    # The truck begins 20 m ahead in the next lane and draws away.
    gap = math.hypot(20 - (4.508 + 8) / 2, 3.5 - (1.61 + 2.5) / 2)
    run = source(record(figures=metrics(minimum_distance_m=gap)), tmp_path)
    found = analysed(run, detail="timeline", scenarios=(scenario,))
    assert found.review is not None
    assert found.review.closest is not None
    assert (found.review.closest.obstacle_id, found.review.closest.time_s) == (33, 0.0)
    assert found.timeline[-1].time_s == 1.5
    assert "Around the most critical moment (m to ID: gap to road user ID):" in found.to_text()


def test_costs_and_rows_are_shown_on_request(tmp_path: Path) -> None:
    run = source(record(), tmp_path, velocity_offset=3.0, prediction=1.0)
    assert "prediction: 25% of the cost" in analysed(run, detail="costs").to_text()
    assert "run_cfg_a_DEU_Town-1_1_T-1_constant_velocity_0" in analysed(*five_runs(), detail="rows").to_text()


def test_rows_come_in_pages_with_every_run_once() -> None:
    runs = [source(record(f"DEU_A-{n}_1_T-1", "collision" if n % 3 else "goal_reached")) for n in range(1, 24)]
    seen, offset = list[str](), 0
    while True:
        page = analysed(*runs, detail="rows", limit=10, offset=offset)
        seen += [row.run_id for row in page.rows]
        if page.next_offset is None:
            break
        assert f"offset={page.next_offset}" in page.to_text()
        offset = page.next_offset
    assert sorted(seen) == sorted(one.record.run_id for one in runs)
    with pytest.raises(InvalidRequest, match="beyond the last"):
        analysed(*runs, detail="rows", offset=23)


def test_rows_state_the_direction_of_collisions(tmp_path: Path) -> None:
    scenario = ScenarioSource(scenario_id="ZAM_Town-1_1_T-1", path=str(town_road().write(tmp_path / "town.xml")))
    runs = [source(record(outcome="collision", obstacle_id=32, seed=seed), tmp_path) for seed in range(2)]
    found = analysed(*runs, detail="rows", scenarios=(scenario,))
    assert [row.contact.kind for row in found.rows if row.contact] == ["rear_end_by_other"] * 2
    assert (
        "collision: hit from behind by car 32 at 4.0 s (ego 10.0 m/s, not braking; car 32: 10.0 m/s" in found.to_text()
    )


def test_a_finding_counts_all_of_its_runs_and_names_the_first() -> None:
    harsh = metrics(maximum_lateral_acceleration_mps2=4.0)
    runs = [source(record(f"ZAM_T-{n}_1_T-1", figures=harsh)) for n in range(12)]
    result = analysed(*runs)
    finding = next(finding for finding in result.findings if finding.name == "uncomfortable_turns")
    assert (len(finding.run_ids), finding.run_count) == (8, 12)
    assert {one.run_id for one in finding.moments} == set(finding.run_ids), "each run has the moment to look at"
    named = [f"{one.run_id} ({one.time_s:.1f} s)" for one in finding.moments[:2]]
    assert f"Runs: {', '.join(named)} and 10 more" in result.to_text()


STEERING = LimitExcess(name="steering rate", value=0.75, limit=0.4, unit="rad/s", time_s=2.3)


def test_infeasible_motions_are_reported_for_one_run_and_counted_for_several(tmp_path: Path) -> None:
    wild = record().model_copy(update={"beyond_vehicle": (STEERING,)})
    calm = record("ZAM_B-1_1_T-1").model_copy(update={"beyond_vehicle": ()})
    one = analysed(source(wild, tmp_path)).to_text()
    assert "steering rate 0.75 rad/s at 2.3 s (limit 0.4); " in one
    several = analysed(source(wild), source(calm), source(record("ZAM_C-1_1_T-1")))
    assert several.beyond_vehicle is not None
    assert several.beyond_vehicle.in_words() == (
        "The vehicle cannot drive 1 of 2 motions (limits exceeded: steering rate 1)."
    )
    assert analysed(source(calm), source(record("ZAM_C-1_1_T-1"))).beyond_vehicle is None


def test_traffic_rules_are_reported_for_one_run_and_shares_for_several(tmp_path: Path) -> None:
    road = town_road().with_vehicles()
    scenario = ScenarioSource(scenario_id="ZAM_Town-1_1_T-1", path=str(road.write(tmp_path / "road.xml")))
    runs = [source(record(), tmp_path, (driven(50.0, 0.0, 9.0),)), source(record(seed=1), tmp_path)]
    one = analysed(runs[0], scenarios=(scenario,))
    broken = [verdict for verdict in one.rules if verdict.violated]
    assert [verdict.rule for verdict in broken] == ["R_G1"]
    safe_m = 10.0 * 0.4 + 10.0**2 / 20 - 9.0**2 / 21
    assert broken[0].degree == pytest.approx(safe_m - (10.0 - 4.0 - (4.508 + 4.5) / 2), abs=0.01)
    assert "traffic rules broken: R_G1 (safe distance) by" in one.to_text()
    all_rules = analysed(runs[0], scenarios=(scenario,), detail="rules").to_text()
    assert "- not applicable: " in all_rules.splitlines()[-1]
    assert "R_G3 speed limit" in all_rules.splitlines()[-1]
    two = analysed(*runs, scenarios=(scenario,), detail="rules")
    safe = next(share for share in two.rule_shares if share.rule == "R_G1")
    assert (safe.violated.count, safe.violated.of, safe.run_ids) == (1, 1, (runs[0].record.run_id,))
    assert "R_G1 safe distance: broken in 1/1 = 100%" in two.to_text()
    assert "R_G3 speed limit" in two.to_text().partition("not applicable in any run: ")[2]
