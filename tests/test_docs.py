"""The docs are complete: what can be named in a call or a setting has an entry."""

import re
from pathlib import Path
from typing import get_args

import pytest
from support.tree import LAYERS

from plannerforge.agent.settings import AgentSettings
from plannerforge.engine.analysis.traffic_rules import TRAFFIC_RULES
from plannerforge.engine.cosimulation.driver import PARAMETERS, presets
from plannerforge.engine.network.rules.check import all_rules
from plannerforge.engine.traffic import published_calibrations
from plannerforge.schemas.errors import error_classes
from plannerforge.schemas.modification import EDITS
from plannerforge.schemas.vocabulary import CIRCUMSTANCES, MEASURES
from plannerforge.schemas.worlds import PRESETS, Dynamics, SightCode, World, bounds_of
from plannerforge.server.settings import Settings
from plannerforge.tools.registry import TOOLS

CHECKOUT = Path(__file__).resolve().parent.parent


def names_in(page: str) -> set[str]:
    return set(re.findall(r"`([^`\n]+)`", (CHECKOUT / page).read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("README.md", [spec.name for spec in TOOLS]),
        ("docs/settings.md", list(Settings.model_fields)),
        ("docs/errors.md", list(error_classes())),
        ("docs/agent.md", list(AgentSettings.model_fields)),
        ("docs/rules.md", [rule.rule_id for rule in all_rules()]),
        ("docs/traffic_rules.md", [rule.rule for rule in TRAFFIC_RULES]),
        ("docs/edits.md", [*EDITS, *presets(), *PARAMETERS]),
        ("docs/demand.md", list(published_calibrations())),
        ("docs/selection.md", [*MEASURES, *CIRCUMSTANCES]),
        ("docs/worlds.md", [*World.model_fields, *PRESETS, *get_args(SightCode)]),
    ],
    ids=[
        *("tools", "settings", "errors", "agent", "rules", "traffic rules", "edits", "calibrations", "circumstances"),
        "worlds",
    ],
)
def test_every_name_has_its_entry(page: str, names: list[str]) -> None:
    assert set(names) - names_in(page) == set()


def test_the_page_on_worlds_states_every_default_range_and_preset() -> None:
    page = (CHECKOUT / "docs" / "worlds.md").read_text(encoding="utf-8")
    for name, field in World.model_fields.items():
        if name == "ego":
            assert "| `ego` | exact | " + ", ".join(f"`{one}`" for one in get_args(Dynamics)) in page
            continue
        low, high = bounds_of(name)
        highest = "2³¹ − 1" if name == "seed" else f"{high:g}"
        assert f"| `{name}` | {field.default:g} | {low:g} to {highest} |" in page
    for name, preset in PRESETS.items():
        values = (
            ", ".join(f"{field}={value:g}" for field, value in preset.world.stated.items()) or "all at their defaults"
        )
        assert f"| `{name}` | {preset.intent} | {values} |" in page
        assert preset.source in page or name == "perfect"


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_links_of_pages_outside_the_docs_are_valid(page: str) -> None:
    """Those of the docs are looked at, with their headings, in ``test_site.py``."""
    for target in re.findall(r"\]\((?!https?://|#)([^)#]+)", (CHECKOUT / page).read_text(encoding="utf-8")):
        assert (CHECKOUT / target).exists(), target


def test_paths_on_the_page_on_architecture_exist() -> None:
    page = (CHECKOUT / "docs" / "architecture.md").read_text(encoding="utf-8")
    paths = re.findall(r"`([\w.]+/[\w./]+)`", page)
    assert len(paths) > 70
    assert [path for path in paths if not (CHECKOUT / path).exists()] == []


@pytest.mark.parametrize("title", ["a metric stored with every run", "an edit"])
def test_worked_examples_name_existing_code(title: str) -> None:
    page = (CHECKOUT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = re.split(r"\n##", page.split(f"### Example: {title}\n")[1])[0]
    quoted = re.findall(r"`([^`]+)`", section)
    folders = {(CHECKOUT / path).parent for path in quoted if path.endswith(".py") and "/" in path}
    code = "".join(file.read_text(encoding="utf-8") for folder in folders for file in folder.glob("*.py"))
    words = {
        word for text in quoted if not re.search(r"[/.]\w*$", text) for word in re.findall(r"[A-Za-z_]\w{3,}", text)
    }
    assert len(words) > 5
    assert words <= set(re.findall(r"\w+", code))


def _rows(text: str) -> list[str]:
    """The rows of a table of figures, with a command in the last cell of each."""
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert rows[:2] == ["| what | figure | command |", "| --- | --- | --- |"]
    assert [row for row in rows[2:] if len(row.strip("| ").split(" | ")) != 3] == []
    assert [row for row in rows[2:] if not re.search(r"`[^`]+`", row.split(" | ")[-1])] == []
    return rows[2:]


def test_every_measured_figure_has_its_command() -> None:
    figures = (CHECKOUT / "benchmarks" / "FIGURES.md").read_text(encoding="utf-8")
    section = re.search(r"^## [^\n]*\(docs/measured\.md\)\n(.*?)(?=^## |\Z)", figures, re.DOTALL | re.MULTILINE)
    assert section is not None
    assert len(_rows(section[1])) > 50
    assert len(_rows((CHECKOUT / "docs" / "measured.md").read_text(encoding="utf-8"))) == 12


GLOSSARY_EXCEPTIONS = {
    "EgoDanger": "in the answers of modify_scenario",
    "ParticipantFacts": "in stored records of scenarios",
    "OsmWay": "a way of OpenStreetMap",
    "one_way_succession": 'the id of a rule, in reports; "one-way" is not a path',
    "one_way_neighbour": 'the id of a rule, in reports; "one-way" is not a path',
    "plans_giving_way": "to give way is a rule of traffic, no path",
    "ground_truth": "the name of a prediction, an argument of run_planner",
    "follows_and_lies_beside": "the id of a rule for road networks, which stays",
    "ground_distance_m": "along the surface of the earth, not a site network",
    "wrong_way": "the offence of driving against the direction of a lane",
}
"""Names with a word of the glossary's third column that may have it, and why."""


def _words(name: str) -> str:
    """The words of a name in snake_case or CamelCase, in lower case, with a space on both sides of each."""
    return f" {' '.join(re.findall(r'[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+', name)).lower()} "


def test_public_names_use_the_words_of_the_glossary() -> None:
    glossary = (CHECKOUT / "docs" / "glossary.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\|.*\| ([^|]+) \|$", glossary, re.MULTILINE)
    refused = {word.strip() for row in rows for word in row.split(",")} - {"not", "---"}
    assert len(refused) >= 9
    definition = re.compile(r"^(?:async def|def|class) ([A-Za-z]\w*)", re.MULTILINE)
    names = {
        name
        for package in LAYERS
        for file in (CHECKOUT / package).rglob("*.py")
        for name in definition.findall(file.read_text(encoding="utf-8"))
    }
    assert {name for name in names if any(f" {word} " in _words(name) for word in refused)} == set(GLOSSARY_EXCEPTIONS)
