"""docs/measures.md is held to the one file of definitions, and so are stored metrics and the words of reports."""

from pathlib import Path

import pytest

from plannerforge.engine.analysis import METRICS
from plannerforge.engine.analysis.measures import (
    CROSSED_WITHIN_S,
    EXPOSED_S,
    LONGEST_S,
    MOST_MEASURED,
    MOST_NEEDED_MPS2,
    MOST_THREAT,
)
from plannerforge.engine.analysis.prevention import RSS_FRONT_MPS2, RSS_OWN_MPS2, RSS_RESPONSE_S
from plannerforge.engine.rendering.words import DEFINITIONS
from plannerforge.engine.vehicles import HARDEST_BRAKING_MPS2
from plannerforge.engine.vehicles.models import HARDEST_LATERAL_MPS2
from plannerforge.schemas.measures import MEASURES, Measure, RunMetrics, definition_rows, measure_named

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "measures.md").read_text(encoding="utf-8")


def test_the_table_of_the_page_is_the_file_of_definitions() -> None:
    rows = [f"| {' | '.join(row)} |" for row in definition_rows()]
    assert [line for line in PAGE.splitlines() if line.startswith("| `")] == rows


def test_names_and_words_are_unique() -> None:
    for values in ([one.name for one in MEASURES], [one.words for one in MEASURES]):
        assert len(set(values)) == len(values)
    abbreviations = [one.abbreviation for one in MEASURES if one.abbreviation]
    assert len(set(abbreviations)) == len(abbreviations)


def test_the_stored_ones_are_the_fields_of_a_run_in_their_order_of_display() -> None:
    stored = [one.name for one in MEASURES if one.stored]
    assert set(stored) == set(RunMetrics.model_fields)
    assert [spec.name for spec in METRICS] == stored


def test_reports_explain_every_measure_by_its_definition() -> None:
    for one in MEASURES:
        assert DEFINITIONS[one.words.partition(" (")[0]].startswith(one.meaning)


@pytest.mark.parametrize("one", MEASURES, ids=lambda one: one.name)
def test_a_definition_has_all_required_parts(one: Measure) -> None:
    assert all((one.words, one.unit, one.meaning, one.method, one.span, one.none))
    assert "|" not in "".join((one.words, one.unit, one.method, one.source, one.span, one.cap, one.none))


def test_parameters_in_the_definitions_match_the_code() -> None:
    def told(name: str) -> str:
        known = measure_named(name)
        assert known is not None
        return f"{known.method} {known.cap}"

    assert f"{EXPOSED_S:g} s or less" in told("time_exposed_s")
    assert f"({EXPOSED_S:g} s −" in told("time_integrated_s2")
    assert f"beyond {LONGEST_S:g} s" in told("leader_time_to_collision_s")
    assert f"beyond {CROSSED_WITHIN_S:g} s" in told("post_encroachment_time_s")
    assert f"{MOST_NEEDED_MPS2:g} means" in told("deceleration_to_avoid_mps2")
    assert f"{MOST_THREAT:g} means" in told("brake_threat_number")
    assert f"÷ {HARDEST_BRAKING_MPS2:g} m/s²" in told("brake_threat_number")
    assert f"{HARDEST_LATERAL_MPS2:g} m/s² lateral" in told("time_to_react_s")
    safe = f"v · {RSS_RESPONSE_S:g} s + v² ÷ (2 · {RSS_OWN_MPS2:g} m/s²) − v_ahead² ÷ (2 · {RSS_FRONT_MPS2:g} m/s²)"
    assert safe in told("rss_margin_m")
    assert f"at most {MOST_MEASURED} valid ones, drawn at random" in PAGE
