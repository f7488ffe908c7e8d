"""Finds words for road users' classes in WikDict's dictionaries, which come from Wiktionary.

The dictionaries are dictd files (``freedict-deu-fra.dict.dz`` with its ``.index``), each with the translations of one
language's nouns into another, by meaning. The search starts with English words and the CLDR's words for pictures, and
follows translations from language to language until it finds no more.
"""

import gzip
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from babel.core import get_global

from plannerforge.engine.vehicles.words import plain_word

ENGLISH = "eng"
LEAST_DICTIONARIES = 2
"""How many sources, the CLDR included, must agree on a class."""
SHARE_TO_EXCEED = 1 / 3
"""Of the dictionaries that have a word, more than a third has to say what it means (chosen: with a quarter, wheels are
bicycles and insurances are police)."""
MEANINGS = 2
"""Only the first two meanings of a word count; later ones are rarer."""
LEAST_KNOWN = 0.2
"""Of the words that a word translates in one dictionary, at least a fifth has to be known (chosen, as above)."""
_DIGITS = {
    digit: value for value, digit in enumerate("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/")
}
"""The digits of positions in a dictd index."""
_HEAD = re.compile(r"(?P<word>[^/<]+?)(?: /.*/)? <n\b[^>]*>")
"""The first line of a noun's entry: the word, its pronunciation and part of speech."""

Word = tuple[str, str]
"""A language code (ISO 639-3) and a plain word."""
Classes = Mapping[str, Mapping[str, str]]
"""The class of each word by language."""


@dataclass(frozen=True)
class Dictionaries:
    """All dictionaries: meanings of each word by target language, and words it translates by source language."""

    meanings: dict[Word, dict[str, list[list[str]]]] = field(default_factory=lambda: defaultdict(dict))
    translated: dict[Word, dict[str, list[tuple[str, int]]]] = field(
        default_factory=lambda: defaultdict(lambda: defaultdict(list))
    )
    """With the number of the meaning that is translated, from 0."""

    @classmethod
    def read(cls, folder: Path) -> "Dictionaries":
        """Return WikDict's dictionaries in a dictd folder, without those of other authors."""
        found = cls()
        for path in sorted(folder.glob("freedict-???-???.dict.dz")):
            text = gzip.decompress(path.read_bytes())
            if b"WikDict" in text[:2000]:
                source, target = path.name.removesuffix(".dict.dz").split("-")[1:]
                for entry in _entries(text, path.with_name(path.name.replace(".dict.dz", ".index"))):
                    found._add(source, target, entry)
        return found

    def _add(self, source: str, target: str, entry: list[str]) -> None:
        head = _HEAD.fullmatch(entry[0]) if entry else None
        if head is None:
            return
        word = plain_word(head["word"])
        known = self.meanings[source, word].setdefault(target, [])
        for number, meaning in enumerate(_meanings(entry[1:])):
            known.append(meaning)
            for other in meaning:
                self.translated[target, other][source].append((word, number))

    def neighbours(self, known: Classes) -> Iterator[Word]:
        """Yield the translations of known words, and the words they translate."""
        for word in ((language, word) for language, words in known.items() for word in words):
            for target, meanings in self.meanings.get(word, {}).items():
                yield from ((target, other) for meaning in meanings for other in meaning)
            for source, heads in self.translated.get(word, {}).items():
                yield from ((source, other) for other, _ in heads)

    def says(self, word: Word, known: Classes) -> tuple[Counter[str], int]:
        """Return how many dictionaries give a word each class, and how many have the word."""
        votes: Counter[str] = Counter()
        meanings, translated = self.meanings.get(word, {}), self.translated.get(word, {})
        for target, several in meanings.items():
            classes = ({known[target][one] for one in each if one in known[target]} for each in several[:MEANINGS])
            votes.update(next(([*one] for one in classes if len(one) == 1), []))
        for source, heads in translated.items():
            counts = Counter(
                known[source][head] for head, number in heads if number < MEANINGS and head in known[source]
            )
            first = most(counts)
            if first is not None and counts[first] >= LEAST_KNOWN * len(heads):
                votes[first] += 1
        return votes, len(meanings) + len(translated)


def words_of_dictionaries(
    dictionaries: Dictionaries,
    english: Mapping[str, str],
    international: Mapping[str, str],
    cldr: Classes,
    names: Classes,
) -> dict[str, dict[str, str]]:
    """Return the class of each word that dictionaries agree on, by language.

    ``english`` has the class of each English word, and ``international`` of those that other languages use too. By
    language, ``cldr`` has the class of each word for pictures, and ``names`` of those that name one. Each of these
    words counts as one more dictionary. Names are always trusted, other words only at first.
    """
    first = {
        language: {word: name for word, name in international.items() if _has(dictionaries, language, word)}
        | dict(words)
        for language, words in cldr.items()
    }
    known: dict[str, Mapping[str, str]] = defaultdict(dict, first | {ENGLISH: dict(english)})
    found: dict[str, dict[str, str]] = {language: {} for language in first}
    while True:
        translations: dict[str, dict[str, str]] = {language: {} for language in first}
        requested = {(language, word) for language, words in first.items() for word in words}
        for language, word in sorted(requested.union(dictionaries.neighbours(known))):
            if language in first:
                votes, having = dictionaries.says((language, word), known)
                votes.update([first[language][word]] if word in first[language] else [])
                winner = most(votes)
                if (
                    winner is not None
                    and votes[winner] >= LEAST_DICTIONARIES
                    and votes[winner] > SHARE_TO_EXCEED * having
                ):
                    translations[language][word] = winner
        if sum(map(len, translations.values())) <= sum(map(len, found.values())):
            return found
        found = translations
        known |= {language: {**names[language], **words} for language, words in found.items()}


def most(votes: Counter[str]) -> str | None:
    """Return the key with the most votes, or None if two are equal."""
    (first, count), (_, other) = [*votes.most_common(2), ("", 0), ("", 0)][:2]
    return first if count > other else None


def two_letters(language: str) -> str:
    """Return the CLDR's code of an ISO 639-3 language, or an empty string if it has no code."""
    return str(get_global("language_aliases").get(language, ""))


def _has(dictionaries: Dictionaries, language: str, word: str) -> bool:
    return (language, word) in dictionaries.meanings or (language, word) in dictionaries.translated


def _entries(text: bytes, index: Path) -> Iterator[list[str]]:
    """Yield the lines of each entry once, even if several words lead to it."""
    places = {tuple(line.split("\t")[1:3]) for line in index.read_text(encoding="utf-8").splitlines()}
    for start, length in sorted((_number(start), _number(length)) for start, length in places):
        yield [line for line in text[start : start + length].decode().splitlines() if line.strip()]


def _number(digits: str) -> int:
    value = 0
    for digit in digits:
        value = 64 * value + _DIGITS[digit]
    return value


def _meanings(lines: list[str]) -> Iterator[list[str]]:
    """Yield the translations of each meaning, without the explanations below them."""
    if lines and not lines[0].startswith("1. "):
        yield _translations(lines[0])
        return
    number = 1
    for line in lines:
        if line.startswith(f"{number}. "):
            yield _translations(line.removeprefix(f"{number}. "))
            number += 1


def _translations(line: str) -> list[str]:
    """Return the plain words of a line; a number at its end belongs to the next explanation."""
    return [word for part in re.sub(r" \d+\.$", "", line).split(",") if (word := plain_word(part))]
