"""Tables of an evaluation in the paper's format: a row for each agent, the paper's rows below, and the cost.

Our own shares have their 95 % Wilson interval. The paper's headings are used if a scorer has the same column.
"""

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich.table import Column
from rich.table import Table as RichTable

from ...engine.analysis import wilson_interval
from ...server.tokens import count_tokens
from .published import PublishedStage, PublishedTable, published
from .rows import JUDGE_FAILED, Row

NO_FIGURE = "-"
_PAPER_MODELS = 3
"""Rows of the paper in a table, the best by its main column first; the report shows all (chosen)."""


@dataclass(frozen=True)
class ResultTable:
    """A table in display form: cells are text, rows of the paper are ``published``."""

    title: str
    source: str
    header: tuple[str, ...]
    own: tuple[tuple[str, ...], ...]
    paper: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = ()

    def to_markdown(self) -> str:
        """Return the table for a document."""
        lines = [f"### {self.title}", "", _line(self.header), _line(["---"] * len(self.header))]
        lines += [_line(cell.replace("\n", "<br>") for cell in row) for row in (*self.own, *self.paper)]
        notes = [*self.notes, *([f"Rows of the paper: {self.source}"] if self.paper else [])]
        return "\n".join([*lines, *(f"\n{note}." for note in notes)]) + "\n"

    def to_terminal(self, paper_rows: int = _PAPER_MODELS) -> RichTable:
        """Return the table for a terminal, with only the first rows of the paper.

        A table with only one row of our own is transposed, because a terminal has no room for a dozen columns.
        """
        notes = [*self.notes, *([f"rows of the paper: {self.source}"] if self.paper else [])]
        upright = len(self.own) == 1
        shown = (*self.own, *(self.paper[:paper_rows] if upright else self.paper))
        header = ("", *(row[0] for row in shown)) if upright else self.header
        columns = [Column(text, no_wrap=number == 1 or (upright and number == 0)) for number, text in enumerate(header)]
        table = RichTable(*columns, title=self.title, caption="; ".join(notes) or None)
        lines = zip(self.header[1:], *(row[1:] for row in shown), strict=True) if upright else shown
        for line in lines:
            table.add_row(*(cell.replace("\n", " ") for cell in line))
        return table


def tables_of(rows: Sequence[Row]) -> list[ResultTable]:
    """Return a table for each corpus, in the order of the rows, and the stages of conversations."""
    corpora = dict.fromkeys(row.request.corpus for row in rows)
    found = []
    for corpus in corpora:
        chosen = [row for row in rows if row.request.corpus == corpus]
        found.append(_corpus_table(corpus, chosen))
        if corpus == "e2e":
            found.append(_chain_table(chosen))
    return [*found, _cost_table(rows)] if found else []


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def _corpus_table(corpus: str, rows: Sequence[Row]) -> ResultTable:
    paper = published().tables.get(corpus)
    keys = _columns(rows, paper)
    labels = {_own_key(column.key): column.label for column in paper.columns} if paper else {}
    header = ("agent", "condition", "n", "tokens", "latency (s)", *(labels.get(key, key) for key in keys), "done %")
    verdicts = [[row.score.columns.get(key) for row in rows] for key in keys]
    own = (
        rows[0].agent,
        rows[0].condition,
        str(len(rows)),
        _mean((row.tokens for row in rows), 0),
        _mean((row.attempt.duration_s for row in rows), 1),
        *(_share([verdict for verdict in column if verdict is not None]) for column in verdicts),
        _share([row.score.done for row in rows]),
    )
    shown = _paper_rows(paper, keys, rows) if paper else ()
    failed = sum(miss.startswith(JUDGE_FAILED) for row in rows for miss in row.score.misses)
    notes: tuple[str, ...] = ("own shares in per cent with their 95 % Wilson interval",)
    notes += (f"{failed} attempts could not be judged, and count as not done",) if failed else ()
    return ResultTable(corpus, paper.source if paper else "", header, (own,), shown, notes)


def _own_key(key: str) -> str:
    """Return a column's key as in scorers: the paper's without its unit."""
    return key.removesuffix("_pct")


def _columns(rows: Sequence[Row], paper: PublishedTable | None) -> list[str]:
    """Return the columns of the rows: first the paper's, in its order, then the others, in the scorer's order."""
    there = list(dict.fromkeys(key for row in rows for key in row.score.columns))
    if rows[0].request.corpus == "e2e":
        return []
    known = [_own_key(column.key) for column in paper.columns] if paper else []
    return [key for key in known if key in there] + [key for key in there if key not in known]


def _paper_rows(paper: PublishedTable, keys: Sequence[str], rows: Sequence[Row]) -> tuple[tuple[str, ...], ...]:
    at = {_own_key(column.key): (index, column.decimals) for index, column in enumerate(paper.columns)}

    def cell(figures: Sequence[float | None], key: str) -> str:
        if key not in at or figures[at[key][0]] is None:
            return NO_FIGURE
        index, decimals = at[key]
        return f"{figures[index]:.{decimals}f}"

    condition, headline = rows[0].condition, _own_key(paper.headline)
    return tuple(
        (
            f"paper: {model}",
            condition,
            str(paper.requests),
            cell(figures, "tokens"),
            cell(figures, "latency_s"),
            *(cell(figures, key) for key in keys),
            cell(figures, headline),
        )
        for model, figures in paper.under(condition)
    )


def _share(verdicts: Sequence[bool]) -> str:
    if not verdicts:
        return NO_FIGURE
    low, high = wilson_interval(sum(verdicts), len(verdicts))
    return f"{sum(verdicts) / len(verdicts) * 100:.1f}\n[{low * 100:.1f}, {high * 100:.1f}]"


def _mean(values: Iterable[float], decimals: int) -> str:
    known = list(values)
    return f"{statistics.fmean(known):,.{decimals}f}" if known else NO_FIGURE


@dataclass(frozen=True)
class Stage:
    """A stage of conversations: how many reached it and passed it, and the mean cost of its calls."""

    name: str
    reached: int
    passed: int
    latency_s: float
    answer_tokens: float


def stages_of(rows: Sequence[Row]) -> list[Stage]:
    """Return the kinds of turns in conversations, in order of first appearance.

    Scorers of conversations have a column for each kind. A conversation reaches a kind if all earlier kinds were
    correct.
    """
    reached: dict[str, list[Row]] = {}
    passed: dict[str, int] = {}
    for row in rows:
        for kind, verdict in row.score.columns.items():
            reached.setdefault(kind, []).append(row)
            passed[kind] = passed.get(kind, 0) + (verdict is True)
            if verdict is not True:
                break
    ordered = sorted(reached, key=lambda kind: _KINDS.index(kind) if kind in _KINDS else len(_KINDS))
    return [_stage(kind, reached[kind], passed[kind]) for kind in ordered]


_KINDS = ("generate", "select", "modify", "test", "tune", "analyse", "compare")


def _stage(kind: str, rows: Sequence[Row], passed: int) -> Stage:
    calls = [
        call
        for row in rows
        for call in row.attempt.calls
        if call.turn < len(row.request.turns) and kind in row.request.turns[call.turn].action.split("+")
    ]
    tokens = sum(count_tokens(call.text) for call in calls)
    return Stage(kind, len(rows), passed, sum(call.duration_s for call in calls) / len(rows), tokens / len(rows))


def _chain_table(rows: Sequence[Row]) -> ResultTable:
    chain, agent, done = published().end_to_end, rows[0].agent, [row.score.done for row in rows]
    own = [
        (
            agent,
            stage.name,
            str(stage.reached),
            str(stage.passed),
            _percent(stage.reached - stage.passed, stage.reached),
            NO_FIGURE,
            f"{stage.latency_s:.1f}",
            f"{stage.answer_tokens / 1000:.1f}",
        )
        for stage in stages_of(rows)
    ]
    tokens = _mean(((row.tokens + row.answer_tokens) / 1000 for row in rows), 1)
    latency = _mean((row.attempt.duration_s for row in rows), 1)
    whole = (str(len(done)), str(sum(done)), NO_FIGURE, _share(done), latency, tokens)
    own.append((agent, "end to end", *whole))
    paper = [_published_stage(model, stage) for model in _BY_MODEL for stage in chain.rows]
    header = ("agent", "stage", "in", "out", "failed %", "of all %", "latency (s)", "tokens (k)")
    notes = (
        "a kind of turn is reached if all earlier kinds in the conversation are correct",
        "the paper's models are a commercial one behind an API and an open one",
        "own tokens of a stage are those of its answers; the total includes the model's",
    )
    return ResultTable("end to end, by stage", chain.source, header, tuple(own), tuple(paper), notes)


_BY_MODEL = {"commercial": "API", "open": "open"}
"""The paper's two end-to-end runs, by a commercial model behind an API and an open one, with their short names."""


def _published_stage(model: str, stage: PublishedStage) -> tuple[str, ...]:
    given = stage.model_dump()
    figures = [given[f"{model}_{key}"] for key in ("in", "out", "fr_pct", "cum_sr_pct", "latency_s", "tokens_k")]
    name = stage.name.replace("Modification, ", "- ")
    return (f"paper: {_BY_MODEL[model]}", name, *(NO_FIGURE if one is None else f"{one:g}" for one in figures))


def _percent(count: int, of: int) -> str:
    return f"{count / of * 100:.1f}" if of else NO_FIGURE


def _cost_table(rows: Sequence[Row]) -> ResultTable:
    header = (
        "corpus",
        "prompt tokens",
        "completion tokens",
        "tokens of answers",
        "model rounds",
        "calls",
        "latency (s)",
    )
    corpora = dict.fromkeys(row.request.corpus for row in rows)
    own = []
    for corpus in corpora:
        chosen = [row for row in rows if row.request.corpus == corpus]
        own.append(
            (
                corpus,
                _mean((row.attempt.prompt_tokens for row in chosen), 0),
                _mean((row.attempt.completion_tokens for row in chosen), 0),
                _mean((row.answer_tokens for row in chosen), 0),
                _mean((row.attempt.rounds for row in chosen), 1),
                _mean((len(row.attempt.calls) for row in chosen), 1),
                _mean((row.attempt.duration_s for row in chosen), 1),
            )
        )
    notes = ("means of a request; prompts and completions as the model's server counted them, answers in o200k_base",)
    return ResultTable("what it cost", "", header, tuple(own), (), notes)
