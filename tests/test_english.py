"""The check of the English finds what docs/style.md rules out, and nothing in code, links and recorded answers."""

from types import ModuleType

import pytest
from support.tree import CHECKOUT, loaded_script


@pytest.fixture(scope="module")
def english() -> ModuleType:
    """The script of ``make english``."""
    return loaded_script("check_english")


def rules_broken(english: ModuleType, page: str, **rules: object) -> list[str]:
    return [fault.rule for fault in english.faults_of(english.texts_of_page("p.md", page), english.Rules(**rules))]


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        ("It lies beside the file.", "beside"),
        ("Nobody is ahead.", "nobody"),
        ("The client to whom it belongs.", "whom"),
        ("A run whose ego stops.", "whose"),
        ("Two runs, one of which fails.", "of which"),
        ("There is none ahead.", "none"),
        ("The speed is to be checked.", "is to be"),
    ],
)
def test_a_banned_construction_is_found(english: ModuleType, words: str, rule: str) -> None:
    assert rules_broken(english, words) == [rule]


@pytest.mark.parametrize(
    "words",
    [
        "A report says who hit whom.",
        "Who hit whom in a run",
        "The speed, or None if there is none.",
        "If the map has none, the server guesses.",
        "Edits apply all or none.",
        "default-src 'none'; base-uri 'none'",
        "none: any map",
        "the seed; default: none",
    ],
)
def test_a_fixed_phrase_or_a_value_is_ordinary_english(english: ModuleType, words: str) -> None:
    assert rules_broken(english, words) == []


def test_an_ordinary_use_does_not_hide_another_one(english: ModuleType) -> None:
    assert rules_broken(english, "Who hit whom, and to whom it belongs.") == ["whom"]
    assert rules_broken(english, "If there is none, it has none ahead.") == ["none"]


def test_an_allowed_number_of_a_construction_passes_and_one_more_shows_all(english: ModuleType) -> None:
    allowed = {"whose": 2}
    assert rules_broken(english, "A run whose ego stops.\n\n" * 2, allowed=allowed) == []
    assert rules_broken(english, "A run whose ego stops.\n\n" * 3, allowed=allowed) == ["whose"] * 3


def test_code_links_and_recorded_text_are_not_prose(english: ModuleType) -> None:
    page = "`beside`, [a page](page.md#of-whom)\n\n```\nnobody\n```\n\n<!-- from here on written by x -->\n\nbeside\n"
    texts = english.texts_of_page("p.md", page, english.Rules().recorded_after)
    assert english.faults_of(texts, english.Rules()) == []


def test_a_sentence_is_counted_within_its_cell_item_or_paragraph(english: ModuleType) -> None:
    five = "One two three four five"
    assert (
        rules_broken(english, f"{five}. {five}.\n\n| {five} | {five} |\n\n- {five}\n- {five}", longest_sentence=5) == []
    )
    assert rules_broken(english, f"{five}\nsix.", longest_sentence=5) == ["6 words"]
    assert rules_broken(english, f"| {five}; {five} |", longest_sentence=5) == []
    assert rules_broken(english, f"{five}; {five}", longest_sentence=5) == ["10 words"]
    assert rules_broken(english, "See e.g. Two three four five.", longest_sentence=5) == ["6 words"]


def test_a_fault_names_its_line(english: ModuleType) -> None:
    page = "# Title\n\n```\ncode\n```\n\nFine.\n\n- fine\n- whose\n"
    (fault,) = english.faults_of(english.texts_of_page("p.md", page), english.Rules())
    assert (fault.file, fault.line) == ("p.md", 10)


def test_docstrings_strings_and_comments_of_code_are_read(english: ModuleType) -> None:
    source = (
        '"""Some module."""\n'
        "class A:\n"
        "    @property\n"
        "    def b(self) -> bool:\n"
        '        """Whether it stops."""\n'
        "    def c(self) -> bool:\n"
        '        """Whether it stops."""\n'
        "        raise ValueError('there is nobody here')  # beside the road\n"
    )
    faults = english.faults_of(english.texts_of_code("a.py", source), english.Rules())
    assert [(fault.line, fault.rule) for fault in faults] == [(7, "Whether"), (8, "nobody"), (8, "beside")]


def test_a_tree_and_a_list_in_a_docstring_are_counted_by_entry(english: ModuleType) -> None:
    entries = ["├── A   one two three", "│   └── B   one two three", "└── C   one two three"]
    tree = '"""Some tree.\n\n    Root\n    ' + "\n    ".join(entries) + '\n\n* one two three four\n* five six\n"""\n'
    texts = list(english.texts_of_code("a.py", tree))
    assert english.faults_of(texts, english.Rules(longest_sentence=4)) == []
    assert [fault.rule for fault in english.faults_of(texts, english.Rules(longest_sentence=3))] == ["4 words"] * 4


def test_the_settings_name_files_that_exist_and_rules_that_the_script_has(english: ModuleType) -> None:
    rules = english.read_rules()
    for pattern in (*rules.pages, *rules.code, *rules.without):
        assert list(CHECKOUT.glob(pattern)), pattern
    assert set(rules.allowed) <= {*english.CONSTRUCTIONS, *english.OPENINGS}
    assert max(rules.allowed.values()) <= 9
