"""The reference of the docs says what the program says today: ``make reference`` writes it."""

import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pydantic import BaseModel, Field
from support.tree import CHECKOUT, loaded_script

from plannerforge.schemas.base import COMMON_FIELDS
from plannerforge.server.tool_schema import described_tool
from plannerforge.tools.registry import TOOLS


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """The script that writes the pages."""
    return loaded_script("write_reference")


@pytest.fixture(scope="module")
def pages(script: ModuleType) -> dict[Path, str]:
    found: dict[Path, str] = script.pages()
    return found


def test_the_pages_match_the_program_s_output(pages: dict[Path, str]) -> None:
    differing = [file.name for file, text in pages.items() if file.read_text(encoding="utf-8") != text]
    assert differing == [], "run make reference and look at the difference"


def test_pages_of_removed_parts_are_deleted(pages: dict[Path, str]) -> None:
    folder = CHECKOUT / "docs" / "reference"
    assert set(folder.rglob("*.md")) - set(pages) == {folder / "index.md"}


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_every_argument_has_a_description(script: ModuleType, spec: object) -> None:
    for line in script.tool_page(spec).partition("## Arguments")[2].partition("## Answer")[0].splitlines():
        if line.startswith("| `") and line.count(" | ") == 3:
            assert not line.endswith("| |"), line


def models_of_answers(script: ModuleType) -> list[type[BaseModel]]:
    models: set[type[BaseModel]] = set()
    for spec in TOOLS:
        if spec.result_type is not None:
            script.models_below(spec.result_type, models)
    return sorted(models, key=lambda model: (model.__module__, model.__name__))


def test_every_field_of_every_answer_has_a_description(script: ModuleType) -> None:
    models = models_of_answers(script)
    assert len(models) > 90
    silent = {model.__name__: names for model in models if (names := silent_fields(script, model))}
    assert silent == {}


def silent_fields(script: ModuleType, model: type[BaseModel]) -> list[str]:
    return [name for name, meaning in script.meanings_of(model).items() if len(_own_words(meaning)) < len("id of x")]


def _own_words(meaning: str) -> str:
    """The meaning without names of fields and units."""
    return re.sub(r"`\w+`:?|\(.*?\)", "", meaning).strip()


def test_a_field_without_a_description_is_detected(script: ModuleType) -> None:
    class Told(BaseModel):
        """A thing; ``said``: here in the docstring."""

        said: int
        length_m: float = Field(description="how long it is")
        notes: list[str]
        silent: int

    assert silent_fields(script, Told) == ["silent"]
    assert script.meanings_of(Told)["length_m"] == "how long it is (m)"


def test_descriptions_of_fields_with_one_name_are_specific(script: ModuleType) -> None:
    names = [name for model in models_of_answers(script) for name in model.model_fields]
    assert set(COMMON_FIELDS) <= set(names)


def test_descriptions_of_answers_cost_the_model_no_tokens() -> None:
    for spec in TOOLS:
        assert '"description"' not in json.dumps(_without_fields_named_so(described_tool(spec).output_schema or {}))


def _without_fields_named_so(schema: Any) -> Any:
    """The schema without the fields that are called ``description``."""
    if isinstance(schema, list):
        return [_without_fields_named_so(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        key: [*map(_without_fields_named_so, value.values())]
        if key in ("properties", "$defs")
        else _without_fields_named_so(value)
        for key, value in schema.items()
        if key != "required"
    }
