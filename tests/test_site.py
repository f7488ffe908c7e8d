"""The documentation as a site: every page has its place, links lead somewhere, and built pages ask no other host."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml
from support.tree import CHECKOUT

DOCS = CHECKOUT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


class Site(yaml.SafeLoader):
    """Reads ``mkdocs.yml``, whose tags name functions of Python."""


Site.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)
CONFIGURATION = yaml.load((CHECKOUT / "mkdocs.yml").read_text(encoding="utf-8"), Site)


def pages_of(part: object) -> Iterator[str]:
    """The files that a part of the navigation names."""
    if isinstance(part, str):
        yield part
    elif isinstance(part, dict):
        for below in part.values():
            yield from pages_of(below)
    elif isinstance(part, list):
        for below in part:
            yield from pages_of(below)


@cache
def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as code hosts and the site make them."""
    found: list[str] = []
    for heading in re.findall(
        r"^#+ (.+)$", re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL), re.MULTILINE
    ):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", text.lower()).strip().replace(" ", "-")
        found.append(slug if slug not in found else f"{slug}_{found.count(slug)}")
    return set(found)


def links(page: Path) -> Iterator[tuple[str, str]]:
    """The relative links of a page: file and anchor, either of which may be empty."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\((?!https?://)([^)\s]+)\)", text):
        file, _, anchor = target.partition("#")
        yield file, anchor


def test_every_page_has_one_place_in_the_navigation() -> None:
    named = list(pages_of(CONFIGURATION["nav"]))
    assert sorted(named) == [page.relative_to(DOCS).as_posix() for page in PAGES]


@pytest.mark.parametrize(
    "page", [CHECKOUT / "README.md", *PAGES], ids=lambda page: page.relative_to(CHECKOUT).as_posix()
)
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    for file, anchor in links(page):
        target = page.parent / file if file else page
        assert target.exists(), f"{file} is not there"
        assert not anchor or anchor in anchors(target), f"{file} has no heading #{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_pages_of_the_site_link_to_pages_of_the_site(page: Path) -> None:
    outside = [file for file, _ in links(page) if file and not (page.parent / file).resolve().is_relative_to(DOCS)]
    assert outside == [], "what lies beside docs/ is not on the site"


def test_the_readme_is_on_one_screen_with_one_picture_and_one_table() -> None:
    text = (CHECKOUT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert len(re.findall(r"!\[", text)) == 1
    assert len(re.findall(r"^\| --- ", text, re.MULTILINE)) == 1


class _Requests(HTMLParser):
    """What a page loads by itself: everything but links to follow."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        wanted = [given.get("src", ""), given.get("srcset", "")] + ([given.get("href", "")] if tag == "link" else [])
        self.loaded += [
            value for value in wanted if re.match(r"(https?:)?//", value) and given.get("rel") != "canonical"
        ]


def test_built_pages_ask_no_other_host(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=CHECKOUT, env=quiet, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = list((tmp_path / "site").rglob("*.html"))
    assert len(pages) >= len(PAGES)
    for page in pages:
        reader = _Requests()
        reader.feed(page.read_text(encoding="utf-8"))
        assert reader.loaded == [], page.name
    styles = "".join(path.read_text(encoding="utf-8") for path in (tmp_path / "site").rglob("*.css"))
    assert re.findall(r"url\([\"']?(?:https?:)?//[^)]*", styles) == []
