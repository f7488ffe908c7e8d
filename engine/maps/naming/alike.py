"""Names that are alike: written in another script or transliterated otherwise, or only half typed."""

import re
import unicodedata
from functools import cache, lru_cache

from .places import latin
from .spellings import MOST_KEPT, distinctive, kinds_of_road, road_readings, words_of_name

_TRANSLITERATIONS = """
eu=oi ei=ai schtsch=s shch=s tsch=c tch=c sch=s sh=s cz=c ch=c kh=h gh=g dzh=z zh=z dj=z ph=f th=t ts=c tz=c
ks=x ck=k qu=k ou=u oo=u ee=i iy=i yj=i ij=i yy=i yo=o jo=o io=o ya=a ja=a ia=a yu=u ju=u iu=u ye=e je=e ie=e
"""
"""Letters that systems of transliteration write for one sound: ISO 9, BGN/PCGN, ALA-LC, German, French and Polish
usage of Cyrillic, ELOT 743 of Greek, Hepburn of Japanese; and German
diphthongs, which other scripts write as they are spoken."""
_LETTERS = str.maketrans("ywjqz", "iviks")
_VOWELLESS = re.compile(r"[\u0590-\u05ff\u0600-\u06ff]")
"""Hebrew and Arabic, which write hardly any vowel."""
_LEAST_LIKENESS = 84
"""Of 100: of the sounds of two spellings of one name in different scripts (measured on the tuning half of
``make bench-places``)."""
_FEWEST_CONSONANTS = 4
"""Of a name without its vowels: fewer are those of many names (chosen)."""
_SHORTEST = 3
"""Letters that are taken for the beginning of a name (chosen)."""


def is_transliterated(typed: str, name: str) -> bool:
    """Whether one is the other in another script, by how both sound."""
    if _scripts(typed) == _scripts(name):
        return False
    kinds = kinds_of_road(typed), kinds_of_road(name)
    if all(kinds) and kinds[0].isdisjoint(kinds[1]):
        return False
    return any(_sound_alike(one, other, typed + name) for one in _tellings(typed) for other in _tellings(name))


def is_half_of(typed: str, name: str) -> bool:
    """Whether a name holds all words that were typed, the last of which may be only begun."""
    words, held = words_of_name(typed), words_of_name(name)
    if sum(map(len, words)) < _SHORTEST:
        return False
    return all(word in held for word in words[:-1]) and any(one.startswith(words[-1]) for one in held)


@lru_cache(maxsize=MOST_KEPT)
def _scripts(text: str) -> frozenset[str]:
    """The scripts of a text's letters, by the first words of their Unicode names (``LATIN``, ``CYRILLIC``, ``CJK``)."""
    return frozenset(unicodedata.name(letter, "").partition(" ")[0] for letter in text if letter.isalpha())


@lru_cache(maxsize=MOST_KEPT)
def _tellings(name: str) -> frozenset[str]:
    """What tells a name from others, joined: its words without its kind and its direction, in each of its readings."""
    readings = {distinctive(reading) or reading for reading in road_readings(name)}
    ordered = words_of_name(name)
    joined = {"".join(word for word in ordered if word in reading) for reading in readings}
    return frozenset(text for text in (*joined, "".join(ordered), latin(name)) if text)


@lru_cache(maxsize=MOST_KEPT)
def _sound(text: str) -> str:
    for letters, sound in _pairs():
        text = text.replace(letters, sound)
    return re.sub(r"(.)\1+", r"\1", text.translate(_LETTERS))


@cache
def _pairs() -> tuple[tuple[str, str], ...]:
    found = (pair.partition("=") for pair in _TRANSLITERATIONS.split())
    return tuple((letters, sound) for letters, _, sound in found)


def _sound_alike(one: str, other: str, written: str) -> bool:
    from rapidfuzz import fuzz

    heard = _sound(one), _sound(other)
    if _VOWELLESS.search(written):
        heard = re.sub("[aeiou]", "", heard[0]), re.sub("[aeiou]", "", heard[1])
        return heard[0] == heard[1] and len(heard[0]) >= _FEWEST_CONSONANTS
    return min(map(len, heard)) > 1 and fuzz.ratio(*heard) >= _LEAST_LIKENESS
