"""The docs are complete: what can be named in a call or a setting has an entry."""

import re
from pathlib import Path

import pytest

from plannerforge.engine.cosimulation.driver import PARAMETERS, presets
from plannerforge.engine.network.rules.check import all_rules
from plannerforge.schemas.errors import error_classes
from plannerforge.schemas.modification import EDITS
from plannerforge.server.settings import Settings
from plannerforge.tools.registry import TOOLS

CHECKOUT = Path(__file__).resolve().parent.parent


def names_in(page: str) -> set[str]:
    return set(re.findall(r"`([^`\n]+)`", (CHECKOUT / page).read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("README.md", [spec.name for spec in TOOLS]),
        ("README.md", list(Settings.model_fields)),
        ("docs/errors.md", list(error_classes())),
        ("docs/rules.md", [rule.rule_id for rule in all_rules()]),
        ("docs/edits.md", [*EDITS, *presets(), *PARAMETERS]),
    ],
    ids=["tools", "settings", "errors", "rules", "edits"],
)
def test_every_name_has_its_entry(page: str, names: list[str]) -> None:
    assert set(names) - names_in(page) == set()


def test_links_between_the_pages_lead_somewhere() -> None:
    for page in [CHECKOUT / "README.md", CHECKOUT / "CONTRIBUTING.md", *(CHECKOUT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\((?!https?://|#)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} → {target}"
