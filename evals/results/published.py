"""The paper's figures, with the labels of their tables, from ``published.json``."""

from functools import cache
from importlib.resources import files

from pydantic import TypeAdapter

from ...schemas.base import Model
from ..attempts import Condition

Cell = float | None


class PublishedColumn(Model):
    """A column of a table of the paper: its key, its heading, and its number of decimals."""

    key: str
    label: str
    decimals: int


class PublishedTable(Model):
    """A table of the paper: ten models in five conditions.

    ``rows`` have model, condition and a figure for each column; ``requests`` is the number of requests that a row
    summarises.
    """

    source: str
    requests: int
    headline: str
    columns: tuple[PublishedColumn, ...]
    rows: tuple[tuple[str | Cell, ...], ...]

    def under(self, condition: Condition) -> list[tuple[str, tuple[Cell, ...]]]:
        """Return models with their figures under a condition, sorted by the main column, best first."""
        column = next(index for index, known in enumerate(self.columns) if known.key == self.headline)
        found = [(str(row[0]), _figures(row)) for row in self.rows if row[1] == condition]
        return sorted(found, key=lambda pair: -(pair[1][column] or 0.0))


class PublishedStage(Model):
    """A stage of the paper's end-to-end chain: requests in and out, for a commercial and an open model."""

    stage: str
    name: str
    commercial_in: int
    commercial_out: int
    commercial_fr_pct: Cell
    commercial_cum_sr_pct: Cell
    commercial_latency_s: Cell
    commercial_tokens_k: Cell
    open_in: int
    open_out: int
    open_fr_pct: Cell
    open_cum_sr_pct: Cell
    open_latency_s: Cell
    open_tokens_k: Cell


class PublishedChain(Model):
    """The paper's end-to-end table."""

    source: str
    rows: tuple[PublishedStage, ...]


class Published(Model):
    """All published figures shown next to our own; ``tables`` are keyed by the name of the corpus."""

    paper: str
    tables: dict[str, PublishedTable]
    end_to_end: PublishedChain


@cache
def published() -> Published:
    """Return the paper's figures."""
    text = files(__package__).joinpath("published.json").read_text(encoding="utf-8")
    return TypeAdapter(Published).validate_json(text)


def _figures(row: tuple[str | Cell, ...]) -> tuple[Cell, ...]:
    return tuple(value if isinstance(value, float | int) else None for value in row[2:])
