"""The reference of the docs says what the program says today: ``make reference`` writes it."""

from pathlib import Path
from types import ModuleType

import pytest
from support.tree import CHECKOUT, loaded_script

from plannerforge.tools.registry import TOOLS


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """The script that writes the pages."""
    return loaded_script("write_reference")


@pytest.fixture(scope="module")
def pages(script: ModuleType) -> dict[Path, str]:
    found: dict[Path, str] = script.pages()
    return found


def test_the_pages_are_those_that_the_program_makes(pages: dict[Path, str]) -> None:
    differing = [file.name for file, text in pages.items() if file.read_text(encoding="utf-8") != text]
    assert differing == [], "run make reference and look at the difference"


def test_no_page_of_what_is_gone_stays(pages: dict[Path, str]) -> None:
    folder = CHECKOUT / "docs" / "reference"
    assert set(folder.rglob("*.md")) - set(pages) == {folder / "index.md"}


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_every_argument_says_what_it_means(script: ModuleType, spec: object) -> None:
    for line in script.tool_page(spec).partition("## Arguments")[2].partition("## Answer")[0].splitlines():
        if line.startswith("| `") and line.count(" | ") == 3:
            assert not line.endswith("| |"), line
