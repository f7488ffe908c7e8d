"""The judge of headlines: what an answer has to say is known apart from the product, and wrong answers are found."""

from typing import Any

from benchmarks.loop import headlines


def case_of(before: str, after: str) -> headlines._Case:
    figures = tuple(dict(headlines._TYPICAL) for _ in before)
    sides = (headlines._Side(0, "Default", before, figures), headlines._Side(0, "Other", after, figures))
    return headlines._Case("test", sides, (0,), ((0, 1),))


def expected(before: str, after: str) -> headlines._Expected:
    case = case_of(before, after)
    scenarios = [f"ZAM_Made-{number}_1_T-1" for number in range(len(before))]
    (found,) = headlines._judged(case, [headlines._records(side, 0, scenarios) for side in case.sides], 0)
    return found


def test_the_codes_follow_from_the_flips() -> None:
    found = {
        (before, after): expected(before, after).code
        for before, after in (
            ("ccg", "ggg"),
            ("ggg", "ggg"),
            ("c", "g"),
            ("c" * 12 + "g" * 8, "g" * 20),
            ("g" * 20, "c" * 12 + "g" * 8),
            ("c" * 8 + "g" * 12, "g" * 8 + "c" * 6 + "g" * 6),
            ("c" * 3 + "g" * 200, "g" * 203),
        )
    }
    assert list(found.values()) == [
        "flips_too_few",
        "tie",
        "one_pair_better",
        "better",
        "worse",
        "no_difference_shown",
        "alike",
    ]


def test_a_wrong_headline_is_found() -> None:
    wanted = expected("ccgg", "gggg")
    side = {"result_id": wanted.batches[0], "config_name": "made:Default"}
    sides = [
        {"label": "made:Default", **side},
        {"label": "made:Other", "result_id": wanted.batches[1], "config_name": "made:Other"},
    ]
    told: dict[str, Any] = {
        "before": "made:Default",
        "after": "made:Other",
        "success": {"pairs": 4, "only_after": 2, "only_before": 0},
        "headline_code": "flips_too_few",
        "verdict": "2 of 4 pairs flipped to success; too few pairs for a test.",
        "metrics": [],
        "run_ids": sorted(wanted.flipped),
    }

    def faults(**changes: Any) -> list[str]:
        comparison = told | changes
        head = f"{comparison['after']} against {comparison['before']}: {comparison['verdict']}"
        return list(wanted.faults(comparison, sides, head))

    assert faults() == []
    assert faults(verdict="3 of 4 pairs flipped to success; too few pairs for a test.")
    assert faults(headline_code="better")
    assert faults(before="made:Other", after="made:Default")
    assert faults(metrics=[{"name": "duration_s", "better": "after"}])
    assert faults(run_ids=["run_elsewhere"])
    assert faults(success={"pairs": 3, "only_after": 2, "only_before": 0})


def test_the_cases_are_many_and_of_every_kind() -> None:
    cases = list(headlines._Maker(1).cases())
    kinds = {case.kind for case in cases}
    assert len(cases) >= 60
    assert {"tie", "few pairs", "two batches", "versions", "by chance", "below resolution"} <= kinds
