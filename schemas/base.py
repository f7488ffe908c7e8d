"""Base classes of all models: frozen, strict about unknown fields and finite numbers; and how an answer is written."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from pydantic import BaseModel, ConfigDict

LONGEST_PATH = 4000
"""Characters; the limit of Linux is 4,096 bytes."""


class Model(BaseModel):
    """A frozen value that refuses unknown fields and numbers that are not finite.

    What checks a model is built when the model is first used: a server that starts uses few of them.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, ser_json_inf_nan="constants", defer_build=True
    )


class Arguments(Model):
    """The arguments of a tool: flat (primitives, enumerations, lists of primitives or of one flat object)."""

    longest_texts: ClassVar[Mapping[str, int]] = {}
    """Characters that an argument's text may have where it is no name or id, which have 200 at most."""


@dataclass(frozen=True)
class Answer:
    """What a tool says, in the order in which it is read: each part one line an item, an empty part none.

    ``headline``: what came out, with its id; ``decided``: what was done or chosen and why; ``figures``: what was
    measured; ``listed``: what was asked to be listed, an item a line; ``warnings``: what needs an act; ``next_step``:
    the call that goes on from here. Technical notes stand in the structured answer, and here where a detail asks.
    """

    headline: str
    decided: Sequence[str] = ()
    figures: Sequence[str] = ()
    listed: Sequence[str] = ()
    warnings: Sequence[str] = ()
    next_step: str = ""

    def to_text(self) -> str:
        """The parts in their order."""
        warnings = (f"Warning: {warning}" for warning in self.warnings)
        following = [f"Next: {self.next_step}"] if self.next_step else []
        return "\n".join([self.headline, *self.decided, *self.figures, *self.listed, *warnings, *following])


def first_of(lines: Sequence[str], most: int, rest: str) -> list[str]:
    """The first ``most`` lines; where there are more, how many, and ``rest``: the call that shows them."""
    more = len(lines) - most
    return [*lines[:most], *([f"… {more} more: {rest}"] if more > 0 else [])]


class Result(Model):
    """The structured answer of a tool; its text says the same, because hosts show the model only one of them."""

    @abstractmethod
    def answer(self) -> Answer:
        """What the text says."""

    def to_text(self) -> str:
        """The answer as compact text."""
        return self.answer().to_text()
