"""Evaluations of agents: rows that outlive a kill, parallel requests in a stable order, tables in the paper's form."""

import io
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from support.evaluations import CountingAgent, echo_session, evaluation, line_of, request, requests, score
from support.tree import CHECKOUT

from plannerforge.evals.attempts import Attempt, EvalRequest, Score
from plannerforge.evals.campaign import Evaluation, evaluate, rows_path, settle
from plannerforge.evals.corpora import corpus_files, read_corpus
from plannerforge.evals.results.comparison import compare_rows
from plannerforge.evals.results.published import published
from plannerforge.evals.results.report import report_html
from plannerforge.evals.results.rows import JUDGE_FAILED, Row, RowFile, read_rows, row_of
from plannerforge.evals.results.tables import stages_of, tables_of
from plannerforge.schemas.errors import InvalidRequest, ResourceFailure, UnknownName

pytestmark = pytest.mark.anyio


def written(rows: list[Row]) -> list[str]:
    return [table.to_markdown() for table in tables_of(rows)]


async def test_a_killed_evaluation_continues_and_gives_the_same_tables(tmp_path: Path) -> None:
    program = CHECKOUT / "tests" / "support" / "evaluations.py"
    ended = subprocess.run([sys.executable, str(program), str(tmp_path / "killed"), "sel-007"], check=False)
    assert ended.returncode == -9
    assert len(read_rows(rows_path(tmp_path / "killed", "selection"))) == 7
    agent = CountingAgent()
    resumed = await evaluate(requests(12), evaluation(agent), tmp_path / "killed", echo_session)
    whole = await evaluate(requests(12), evaluation(CountingAgent()), tmp_path / "whole", echo_session)
    assert agent.attempted == [f"sel-{number:03d}" for number in range(7, 12)]
    assert written(resumed) == written(whole)
    assert report_html(resumed) == report_html(whole)


async def test_half_a_line_at_the_end_is_done_again(tmp_path: Path) -> None:
    await evaluate(requests(3), evaluation(CountingAgent()), tmp_path, echo_session)
    path = rows_path(tmp_path, "selection")
    path.write_bytes(path.read_bytes()[:-40])
    assert [row.request_id for row in read_rows(path)] == ["sel-000", "sel-001"]
    agent = CountingAgent()
    rows = await evaluate(requests(3), evaluation(agent), tmp_path, echo_session)
    assert agent.attempted == ["sel-002"]
    assert [row.request_id for row in rows] == [row.request_id for row in read_rows(path)]


async def test_rows_come_in_the_order_of_the_requests(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    rows = await evaluate(
        requests(9),
        evaluation(CountingAgent()),
        tmp_path,
        echo_session,
        workers=4,
        on_row=lambda row, done, of: seen.append((done, of)),
    )
    assert [row.request_id for row in rows] == [one.request_id for one in requests(9)]
    assert seen == [(number, 9) for number in range(1, 10)]


async def test_a_judge_that_fails_costs_only_its_row(tmp_path: Path) -> None:
    def broken(one: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
        if one.request_id == "sel-001":
            raise ValueError("no such file")
        return score(one, attempt, workspace)

    rows = await evaluate(requests(3), Evaluation(CountingAgent(), "cp", broken), tmp_path, echo_session)
    assert [row.score.done for row in rows] == [True, False, True]
    assert rows[1].score.misses[0].startswith(JUDGE_FAILED)
    assert "1 attempts could not be judged" in written(rows)[0]


def test_two_evaluations_do_not_write_to_one_file(tmp_path: Path) -> None:
    with (
        RowFile.open(tmp_path / "rows.jsonl"),
        pytest.raises(ResourceFailure, match="another evaluation"),
        RowFile.open(tmp_path / "rows.jsonl"),
    ):
        pass


def test_a_folder_contains_one_evaluation(tmp_path: Path) -> None:
    corpus = tmp_path / "selection.jsonl"
    corpus.write_text(line_of(request(1)) + "\n")
    settle(tmp_path / "out", evaluation(CountingAgent()), [corpus])
    settle(tmp_path / "out", evaluation(CountingAgent()), [corpus])
    with pytest.raises(InvalidRequest, match="another agent"):
        settle(tmp_path / "out", evaluation(CountingAgent(name="other")), [corpus])
    corpus.write_text(line_of(request(2)) + "\n")
    with pytest.raises(InvalidRequest, match=r"another selection\.jsonl"):
        settle(tmp_path / "out", evaluation(CountingAgent()), [corpus])


def row(
    number: int, *, done: bool = True, corpus: str = "selection", columns: dict[str, bool | None] | None = None
) -> Row:
    one = request(number, corpus)
    attempt = Attempt(
        one.request_id, (), ("yes",), "answered", prompt_tokens=1000, completion_tokens=24, duration_s=2.0
    )
    given = {"sat_top1": done, "own_column": None} if columns is None else columns
    return row_of(one, attempt, Score(one.request_id, done, given, () if done else ("missed it",)), "mine", "cp")


def test_a_table_shows_own_shares_with_intervals_above_the_papers_rows() -> None:
    table = tables_of([row(number, done=number < 8) for number in range(10)])[0]
    assert table.header == ("agent", "condition", "n", "tokens", "latency (s)", "sat_top1 %", "own_column", "done %")
    assert table.own == (("mine", "cp", "10", "1,024", "2.0", "80.0\n[49.0, 94.3]", "-", "80.0\n[49.0, 94.3]"),)
    assert len(table.paper) == 10
    assert table.paper[0][0].startswith("paper: ")
    assert table.source.startswith("Appendix, Scenario Selection Module")


def test_a_table_fits_a_terminal_of_eighty_columns() -> None:
    shown = Console(file=io.StringIO(), width=80)
    for table in tables_of([row(number, done=number < 8) for number in range(10)]):
        shown.print(table.to_terminal())
    text = shown.file.getvalue()  # type: ignore[attr-defined]
    assert "80.0 [49.0, 94.3]" in text
    assert "…" not in text


@pytest.mark.parametrize("corpus", [*published().tables])
def test_every_table_of_the_paper_has_ten_models_a_condition(corpus: str) -> None:
    table = published().tables[corpus]
    for condition in ("baseline", "cp", "cp_cot", "cp_icl", "cp_icl_cot"):
        rows = table.under(condition)  # type: ignore[arg-type]
        assert len(rows) == 10
        assert {len(figures) for _, figures in rows} == {len(table.columns)}


def test_the_paper_s_figures_match_its_transcription(shared_data: Path) -> None:
    import json

    facts = json.loads((shared_data / "facts" / "results.json").read_text(encoding="utf-8"))
    by_source = {table.get("source"): table for table in facts["tables"]}
    for table in published().tables.values():
        theirs = by_source[table.source]["rows"]
        keys = [column.key for column in table.columns]
        assert [list(one) for one in table.rows] == [
            [one["model"], one["condition"], *(one[key] for key in keys)] for one in theirs
        ]


def test_a_stage_of_conversations_is_reached_past_right_stages_only() -> None:
    turns = [{"generate": True, "test": True}, {"generate": True, "test": False}, {"generate": False, "test": True}]
    rows = [row(number, corpus="e2e", done=all(one.values()), columns=dict(one)) for number, one in enumerate(turns)]
    assert [(stage.name, stage.reached, stage.passed) for stage in stages_of(rows)] == [
        ("generate", 3, 2),
        ("test", 2, 1),
    ]
    chain = tables_of(rows)[1]
    assert [cells[1:4] for cells in chain.own] == [("generate", "3", "2"), ("test", "2", "1"), ("end to end", "3", "1")]
    assert ("paper: API", "End to end", "200", "165", "-", "83", "126", "42.5") in chain.paper


def test_the_report_shows_a_miss_with_its_calls_and_escapes_its_text() -> None:
    one = request(1, category="<b>plain</b>")
    missed = row_of(
        one,
        Attempt(one.request_id, (), ("<script>",), "failed", failure="the model is gone"),
        Score(one.request_id, done=False, columns={}, misses=("nothing was found",)),
        "mine",
        "cp",
    )
    page = report_html([missed, row(2)])
    assert "1 of 2 requests done" in page
    assert "nothing was found" in page
    assert "the model is gone" in page
    assert "<script>" not in page
    assert "http" not in page.replace("http-equiv", "")


def test_a_comparison_pairs_by_request_and_names_flips() -> None:
    first = [row(number, done=number in (0, 1)) for number in range(8)]
    second = [row(number, done=number != 1) for number in range(8)] + [row(9)]
    found = compare_rows(first, second)
    assert (found.pairs, found.first_done, found.second_done, found.unpaired) == (8, 2, 7, 1)
    assert [one.request_id for one in found.lost] == ["sel-001"]
    assert len(found.gained) == 6
    assert found.p == pytest.approx(0.125)
    text = found.to_text("A", "B")
    assert "A: done 25.0%" in text
    assert "lost: sel-001 (): missed it" in text


def test_evaluations_of_other_requests_are_not_compared() -> None:
    with pytest.raises(InvalidRequest, match="no request in common"):
        compare_rows([row(1)], [row(2)])


def test_an_invalid_corpus_line_is_named(tmp_path: Path) -> None:
    path = tmp_path / "selection.jsonl"
    path.write_text(line_of(request(1)) + '\n{"id": "sel-2"}\n')
    with pytest.raises(InvalidRequest, match=r"line 2 of selection\.jsonl is not a request: task is missing"):
        read_corpus(path)
    path.write_text(line_of(request(1)) + "\n" + line_of(request(1)) + "\n")
    with pytest.raises(InvalidRequest, match=r"line 2 .* has the id sel-001"):
        read_corpus(path)


def test_corpora_are_found_by_task(tmp_path: Path) -> None:
    for name in ("selection", "modification_T", "modification_B"):
        (tmp_path / f"{name}.jsonl").touch()
    assert [path.stem for path in corpus_files(tmp_path, "modification")] == ["modification_T", "modification_B"]
    assert [path.stem for path in corpus_files(tmp_path, "all")] == ["selection", "modification_T", "modification_B"]
    with pytest.raises(InvalidRequest, match="no corpus of tuning"):
        corpus_files(tmp_path, "tuning")
    with pytest.raises(UnknownName, match="no task 'walking'"):
        corpus_files(tmp_path, "walking")


def test_all_lines_of_the_development_corpora_are_requests(shared_data: Path) -> None:
    folder = shared_data / "corpora" / "dev"
    assert sum(len(read_corpus(path)) for path in corpus_files(folder, "all")) == 670
