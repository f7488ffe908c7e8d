"""The report is one page that stands alone and trusts no text."""

import re
from pathlib import Path
from typing import get_args

import pytest
from PIL import Image
from support.runs import DEFAULT, SAFE, record, source

from plannerforge.engine.analysis.summary import analyse
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.rendering.reports import (
    causes_in_words,
    overview_section,
    rules_section,
    run_section,
    write_report,
)
from plannerforge.engine.rendering.words import DEFINED, words_used
from plannerforge.schemas.errors import ResourceFailure, UnsafeInput
from plannerforge.schemas.measures import MEASURES, MeasuredValue
from plannerforge.schemas.rendering import ReportImage, ReportRequest, ReportSection, ReportTable
from plannerforge.schemas.results import AnalyseRequest, CauseMoment, CollisionCauses, Rate, RuleShare
from plannerforge.schemas.reviews import ContactKind, RuleVerdict
from plannerforge.schemas.runs import BatchRecord, Outcome, Prediction, Traffic

HOSTILE = '<script>alert("x")</script>'


def request(tmp_path: Path, picture: Path) -> ReportRequest:
    section = ReportSection(
        title=HOSTILE,
        asked=HOSTILE,
        text=("A paragraph.",),
        findings=(HOSTILE,),
        tables=(ReportTable(caption="Runs", columns=("run",), rows=((HOSTILE,),)),),
        images=(ReportImage(path=str(picture), caption="A picture", alt_text='a "red" square'),),
        took_s=1.26,
    )
    return ReportRequest(title="Report", sections=(section,), path=str(tmp_path / "out" / "report.html"))


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    path = tmp_path / "red.png"
    Image.new("RGB", (20, 10), "red").save(path)
    return path


def test_page_is_self_contained_and_escaped(tmp_path: Path, picture: Path) -> None:
    written = write_report(request(tmp_path, picture), silent)
    page = Path(written.path).read_text(encoding="utf-8")
    assert (written.sections, written.images, written.size_bytes) == (1, 1, len(page.encode()))
    assert "<script" not in page
    assert page.count("&lt;script&gt;") == 5
    assert not re.search(r"(?:src|href)=\"(?!data:image/|#)", page)
    assert 'alt="a &#34;red&#34; square" width="20" height="10"' in page
    assert "1.3 s" in page


def test_page_is_the_same_bytes_again(tmp_path: Path, picture: Path) -> None:
    path = Path(write_report(request(tmp_path, picture), silent).path)
    first = path.read_bytes()
    assert Path(write_report(request(tmp_path, picture), silent).path).read_bytes() == first
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]


def test_a_file_that_is_not_a_picture_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "text.png"
    text.write_text("no picture")
    with pytest.raises(UnsafeInput, match=r"text\.png is not a PNG or GIF"):
        write_report(request(tmp_path, text), silent)


def test_a_missing_picture_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResourceFailure, match=r"gone\.png cannot be read"):
        write_report(request(tmp_path, tmp_path / "gone.png"), silent)


def test_every_outcome_kind_metric_and_condition_is_defined() -> None:
    names = [name for names in (Outcome, ContactKind, Prediction, Traffic) for name in get_args(names)]
    assert {*names, *(measure.name for measure in MEASURES)} == DEFINED


def test_a_report_defines_the_words_that_it_uses_and_no_others(tmp_path: Path) -> None:
    table = ReportTable(columns=("scenario", "outcome"), rows=(("ZAM_A-1_1_T-1", "goal reached"),))
    section = ReportSection(title="Runs", text=("The time to collision rose; Holm.",), tables=(table,))
    assert [word for word, _ in words_used([section])] == [
        "collision",
        "goal reached",
        "Holm",
        "scenario",
        "time to collision",
    ]
    written = write_report(ReportRequest(title="R", sections=(section,), path=str(tmp_path / "r.html")), silent)
    page = Path(written.path).read_text(encoding="utf-8")
    assert "<dt>goal reached</dt>" in page
    assert "<dt>timeout</dt>" not in page
    assert '<a href="#words">' in page


def test_the_overview_states_the_test_the_result_and_the_next_step() -> None:
    runs = [record(f"ZAM_T-{number}_1_T-1", config=config) for number in range(8) for config in (DEFAULT, SAFE)]
    runs[0] = record("ZAM_T-0_1_T-1", "timeout")
    runs[2] = record("ZAM_T-1_1_T-1", "invalid")
    batch = BatchRecord(
        batch_id="batch_a",
        scenarios=tuple(dict.fromkeys(run.scenario_id for run in runs)),
        configs=("cfg_a", "cfg_b"),
        prediction="lane",
        traffic="recorded",
        runs=tuple(run.run_id for run in runs),
        lost=(),
    )
    request = AnalyseRequest(results=("batch_a",), runs=tuple(map(source, runs)), breakdown="config")
    section = overview_section(batch, {"cfg_a": "Default", "cfg_b": "Safe"}, analyse(request, silent), None)
    said = dict(section.tables[0].rows)
    assert said["What was tested"].startswith(
        "2 configurations (Default; Safe) on 8 scenarios, 16 runs; recorded traffic"
    )
    assert "lane prediction" in said["What was tested"]
    assert "6 of 7 valid runs (86%" in said["Results"]
    assert "8 of 8 valid runs (100%" in said["Results"]
    assert "reached the goal; other outcomes: 1 timeout; frenetix:Safe" in said["Results"]
    assert "1 invalid" in said["Results"]
    assert said["Who caused the collisions, frenetix:Default (cfg_a)"] == "There was no collision with a known course."
    assert said["Next step"]
    rows = {row[0]: row[1:] for row in section.tables[1].rows}
    assert [(row[0], row[1], row[4]) for row in rows.values()] == [("7", "6 (86%)", "1"), ("8", "8 (100%)", "0")]


@pytest.mark.parametrize("collisions", [1, 2])
@pytest.mark.parametrize("prevented", [0, 1, 2])
def test_causes_of_collisions_agree_in_number_and_leave_out_what_did_not_happen(
    collisions: int, prevented: int
) -> None:
    prevented = min(prevented, collisions)
    evidence = tuple(
        CauseMoment(
            run_id=f"run_{number}",
            time_s=1.0,
            kind="rear_end_by_ego",
            laid_to="planning",
            preventable=number < prevented,
        )
        for number in range(collisions)
    )
    causes = CollisionCauses(
        collisions=collisions,
        looked_at=collisions,
        judged=collisions,
        kinds={"rear_end_by_ego": collisions},
        not_preventable=tuple(one.run_id for one in evidence if not one.preventable),
        unpreventable_share=Rate(count=collisions - prevented, of=collisions, share=None, low=None, high=None),
        from_behind=0,
        recorded_traffic=True,
        success_without=None,
        laid_to={"planning": collisions},
        evidence=evidence,
    )
    said = causes_in_words(causes)
    assert said.startswith(f"{collisions} collision{'s' * (collisions > 1)} (")
    assert f"{collisions} judged collision{'s' * (collisions > 1)}" in said
    assert ("No reference driver" in said) == (prevented < collisions)
    assert "other 0" not in said
    assert ("the other" in said) == (0 < prevented < collisions)
    assert "  " not in said


def test_a_run_in_detail_states_its_ending_and_its_broken_rules() -> None:
    late = record(outcome="timeout")
    analysis = analyse(AnalyseRequest(results=(late.run_id,), runs=(source(late),)), silent)
    section = run_section(late, analysis)
    assert section.text == ("Ending: timeout: ended as timeout.",)
    fast = RuleVerdict(rule="R_G3", name="speed limit", unit="m/s", robustness=-2.0, time_s=3.0, first_s=1.0)
    section = run_section(late, analysis.model_copy(update={"rules": (fast,)}))
    assert section.text[1].endswith(f": {fast.in_words()}.")


def test_rules_are_listed_by_configuration_including_inapplicable_ones() -> None:
    runs = [record(f"ZAM_Town-{n}_1_T-1") for n in range(2)]
    result = analyse(AnalyseRequest(results=("batch_a",), runs=tuple(map(source, runs))), silent)
    rate = Rate(count=1, of=2, share=0.5, low=0.09, high=0.91)
    told = {"unit": "m", "config_id": "cfg_a", "config_name": "Default"}
    shares = (
        RuleShare(rule="R_G1", name="safe distance", violated=rate, worst=3.2, run_ids=("run_1",), **told),
        RuleShare(
            rule="R_IN2",
            name="red light",
            violated=Rate(count=0, of=0, share=None, low=None, high=None),
            worst=None,
            run_ids=(),
            **told,
        ),
    )
    section = rules_section(result.model_copy(update={"rule_shares": shares}))
    assert section.tables[0].rows == (("R_G1 safe distance", "1 of 2", "9 to 91%", "3.2 m", "run_1"),)
    assert section.text == ("These rules applied to no run: R_IN2 red light.",)


def test_a_run_in_detail_shows_its_measures() -> None:
    shown = [
        MeasuredValue(
            name="time_to_brake_s", value=0.84, time_s=2.3, obstacle_id=39, obstacle_class="car", relation="ahead"
        ),
        MeasuredValue(name="post_encroachment_time_s", why="no path crossed the ego's within 10 s"),
        MeasuredValue(
            name="maximum_steering_rate_radps", value=0.5, time_s=1.0, note="the vehicle's limit is 0.4 rad/s"
        ),
    ]
    done = record()
    analysis = analyse(AnalyseRequest(results=(done.run_id,), runs=(source(done),)), silent)
    section = run_section(done, analysis, shown)
    assert section.tables[0].rows == (
        ("time to brake (TTB)", "0.84 s", "car 39 ahead", "2.3 s"),
        ("post-encroachment time (PET)", "not available: no path crossed the ego's within 10 s", "–", "–"),
        ("peak steering rate", "0.5 rad/s (the vehicle's limit is 0.4 rad/s)", "–", "1.0 s"),
    )
    assert {"time to brake", "post-encroachment time", "peak steering rate"} <= {
        word for word, _ in words_used([section])
    }
