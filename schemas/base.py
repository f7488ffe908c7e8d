"""Base classes of all models: frozen, strict about unknown fields and finite numbers."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from pydantic import BaseModel, ConfigDict

LONGEST_PATH = 4000
"""Characters; the limit of Linux is 4,096 bytes."""


class Model(BaseModel):
    """A frozen value that refuses unknown fields and numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, ser_json_inf_nan="constants")


class Arguments(Model):
    """The arguments of a tool: flat (primitives, enumerations, lists of primitives or of one flat object)."""

    longest_texts: ClassVar[Mapping[str, int]] = {}
    """Characters that an argument's text may have where it is no name or id, which have 200 at most."""


class Result(Model):
    """The structured answer of a tool; its text says the same, because hosts show the model only one of them."""

    @abstractmethod
    def to_text(self) -> str:
        """The answer as compact text."""
