"""Compares names that differ in script or transliteration, are abbreviated, or are only half typed."""

import re
import unicodedata
from collections.abc import Sequence
from functools import cache, lru_cache
from itertools import groupby

from .places import VOWELLESS, latin
from .spellings import (
    MOST_KEPT,
    agrees_in_numbers,
    always_says_kind,
    distinctive,
    is_direction,
    is_only_a_kind,
    is_title,
    kinds_of_road,
    road_readings,
    without_particles,
    words_of_name,
)

_TRANSLITERATIONS = """
eu=oi ei=ai schtsch=s shch=s tsch=c tch=c sch=s sh=s cz=c ch=c kh=h gh=g dzh=z zh=z dj=z ph=f th=t ts=c tz=c
ks=x ck=k qu=k ou=u oo=u ee=i iy=i yj=i ij=i yy=i yo=o jo=o io=o ya=a ja=a ia=a yu=u ju=u iu=u ye=e je=e ie=e
"""
"""Letters that systems of transliteration write for one sound: ISO 9, BGN/PCGN, ALA-LC, German, French and Polish usage
of Cyrillic, ELOT 743 of Greek, Hepburn of Japanese; and German diphthongs, which other scripts write by sound.
"""
_LETTERS = str.maketrans("ywjqz", "iviks")
_ALPHABETS = frozenset(
    re.findall(
        r"\S+",
        "LATIN CYRILLIC GREEK GEORGIAN ARMENIAN HEBREW ARABIC ETHIOPIC THAI LAO DEVANAGARI BENGALI GURMUKHI GUJARATI "
        "ORIYA TAMIL TELUGU KANNADA MALAYALAM SINHALA HANGUL HIRAGANA KATAKANA KATAKANA-HIRAGANA",
    )
)
"""Scripts that write sounds: in all others, the sound of a name does not follow from its single letters."""
_SYLLABLES = re.compile(r"[\u3040-\u30ff\uac00-\ud7a3]")
"""Kana and Hangul. They put a vowel (u, eu) between and after consonants of foreign names, and use one letter for two
consonants of other languages (g and k; l and r): the rules of the National Institute of Korean Language and of Hepburn.
"""
_VOICELESS = str.maketrans("gdblvj", "ktprpc")
_LEAST_LIKENESS = 84
"""Minimum similarity (of 100) of the sounds of two spellings of one name in different scripts (measured on the tuning
half of ``make bench-places``).
"""
_FEWEST_CONSONANTS = 4
"""Minimum consonants of a name without its vowels: shorter ones fit many names (chosen)."""
_LONGEST_SHORT = 5
"""Maximum length of a shortened word: of libpostal's abbreviations of kinds of roads, directions and titles, 92 of 100
are no longer; 98 consist of letters of their words in the same order.
"""
_FEWEST_INITIALS, _MOST_INITIALS = 2, 5
"""Minimum and maximum number of words that are written by their initials (chosen)."""
_ROMAN = re.compile("x{0,3}(?:ix|iv|v?i{0,3})")
_LONGEST_ENDING = 4
"""Maximum number of letters in which the forms of a word differ at its end.

Of the forms of adjectives in ``-ский`` and ``-ska``, from which most names of streets in Slavic languages are made, no
ending has more letters in Latin letters.
"""
_WORD_AND_STOP = re.compile(r"(\w+)(\.?)")
SHORTEST_BEGUN = 3
"""Minimum number of letters for the beginning of a name (chosen)."""


def is_transliterated(typed: str, name: str) -> bool:
    """Return whether two texts are the same name in different scripts, judging by sound."""
    scripts = _scripts(typed), _scripts(name)
    if not all(scripts) or scripts[0] == scripts[1] or not (scripts[0] | scripts[1]) <= _ALPHABETS:
        return False
    kinds = kinds_of_road(typed), kinds_of_road(name)
    if (all(kinds) and kinds[0].isdisjoint(kinds[1])) or not agrees_in_numbers(typed, name):
        return False
    return any(_sound_alike(one, other, typed + name) for one in _tellings(typed) for other in _tellings(name))


def is_abbreviated(typed: str, name: str) -> bool:
    """Return whether the typed text has a name's words, some shortened (``V. del Corso``: ``Via del Corso``).

    A shortened word has the first letter of the whole one and some later letters, in order. It ends in a full stop, or
    another word identifies the name. The text may lack a word for the kind of road (``A. Volta``: ``Via Alessandro
    Volta``).
    """
    words, held = _significant_words(typed), _significant_words(name)
    if len(words) < len(held) and not any(map(_is_kind, words)):
        held = tuple(word for word in held if not _is_kind(word)) or held
    if len(words) != len(held) or words == held or not agrees_in_numbers(typed, name):
        return False
    kept = [word for word, whole in zip(words, held, strict=True) if word == whole and len(word) >= SHORTEST_BEGUN]
    short = [(word, whole) for word, whole in zip(words, held, strict=True) if word != whole]
    is_told = any(not kinds_of_road(word) for word in kept) or (bool(kept) and typed.count(".") >= len(short))
    return is_told and all(_shortens(word, whole) for word, whole in short)


def has_initials(typed: str, name: str) -> bool:
    """Return whether the typed text has initials of a name's words (``MG Road``: ``Mahatma Gandhi Road``).

    Its other words are in the name, and the name has no more words than a kind of road, a direction and titles (``MLK
    Blvd``: ``Dr. Martin Luther King Jr. Boulevard``). Two letters need a kind of road, because alone they mean much
    else. The initials of one name fit others, so this identifies a name only if no other name fits.
    """
    words, kinds = _words_with_initials(typed), kinds_of_road(typed)
    if not words or (kinds and kinds.isdisjoint(kinds_of_road(name))):
        return False
    return _spells(words, words_of_name(name), spelt=False, has_kind=bool(kinds))


@lru_cache(maxsize=MOST_KEPT)
def _words_with_initials(typed: str) -> tuple[str, ...]:
    """Return the words, single letters in a row as one (``M. G. Road``); empty if none of them can be initials."""
    words: list[str] = []
    for is_letter, run in groupby(words_of_name(typed), key=lambda word: len(word) == 1 and word.isalpha()):
        several = list(run)
        words += ["".join(several)] if is_letter else several
    fewest = _FEWEST_INITIALS if kinds_of_road(typed) else _FEWEST_INITIALS + 1
    initials = (word for word in words if not kinds_of_road(word) and not is_direction(word))
    return tuple(words) if any(fewest <= len(word) <= _MOST_INITIALS for word in initials) else ()


def _spells(typed: Sequence[str], name: Sequence[str], *, spelt: bool, has_kind: bool) -> bool:
    """Return whether the typed words are words of a name or initials of several.

    ``spelt``: initials were found before. ``has_kind``: the kind of road is typed, so the initials are not its own.
    """
    if not name:
        return spelt and not typed
    if _is_dropped(name[0]) and _spells(typed, name[1:], spelt=spelt, has_kind=has_kind):
        return True
    if not typed:
        return False
    first, rest = typed[0], typed[1:]
    if not road_readings(first).isdisjoint(road_readings(name[0])) and _spells(
        rest, name[1:], spelt=spelt, has_kind=has_kind
    ):
        return True
    many = len(first)
    initials = [word[0] for word in name[:many]]
    is_spelt = first.isalpha() and _FEWEST_INITIALS <= many <= _MOST_INITIALS and initials == list(first)
    is_free = has_kind or not any(map(kinds_of_road, name[:many]))
    return is_spelt and is_free and _spells(rest, name[many:], spelt=True, has_kind=has_kind)


def _is_dropped(word: str) -> bool:
    return bool(kinds_of_road(word)) or is_direction(word) or is_title(word)


def is_with_kind(typed: str, name: str) -> bool:
    """Return whether the typed text is a name plus a kind of road that the name lacks (``Pasteur Street``)."""
    if always_says_kind(name) or not kinds_of_road(typed):
        return False
    whole = {distinctive(reading) for reading in road_readings(name)} - {frozenset()}
    return any(distinctive(reading) in whole for reading in road_readings(typed))


def is_inflected(typed: str, name: str) -> bool:
    """Return whether the typed text has a name's words in other grammatical forms (``Marszałkowskiej``: ``...ska``).

    The words differ at most in their last letters. The text may lack a word for the kind of road. Ordinary words have
    these forms, too, so this alone does not identify a name.
    """
    words, held = words_of_name(typed), list(words_of_name(name))
    for word in sorted(words, key=len, reverse=True):
        other = next((one for one in held if _is_other_form(word, one)), None)
        if other is None:
            return False
        held.remove(other)
    return not held or is_only_a_kind(" ".join(held))


def beginning(word: str) -> str:
    """Return the first letters of a word, which all of its grammatical forms share."""
    return word[:SHORTEST_BEGUN]


def _is_other_form(one: str, other: str) -> bool:
    """Return whether two words are equal, or differ only in at most ``_LONGEST_ENDING`` last letters.

    The two words must share more letters than they differ in, or share the whole of a short word (``út``: ``úton``).
    """
    if one.isdecimal() or other.isdecimal():  # ``100`` is another number than ``10``
        return one == other
    common = next((index for index, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), None)
    common = min(len(one), len(other)) if common is None else common
    ending = max(len(one), len(other)) - common
    return ending <= _LONGEST_ENDING and (common >= max(ending + 1, SHORTEST_BEGUN) or common == len(other) > 1)


def _shortens(short: str, word: str) -> bool:
    """Return whether letters are an initial or a contraction of a word, and short enough for an abbreviation."""
    letters = iter(word)
    is_short = len(short) <= _LONGEST_SHORT and not _ROMAN.fullmatch(word)
    return is_short and short[0] == word[0] and all(letter in letters for letter in short)


@lru_cache(maxsize=MOST_KEPT)
def _significant_words(name: str) -> tuple[str, ...]:
    """Return the words of a name in order, without particles; single letters count only as shortened words.

    A word with a full stop is a shortened word and no particle (``Ελ. Βενιζέλου``, although ``el`` is an article).
    """
    words = words_of_name(name)
    told = without_particles([word for word in words if len(word) > 1])
    shortened = {word for text, stop in _WORD_AND_STOP.findall(name) if stop for word in words_of_name(text)}
    return tuple(word for word in words if len(word) == 1 or word in told or word in shortened)


def is_long_enough(typed: str) -> bool:
    """Return whether a typed text is long enough to identify a name by its beginning, in its own script or in Latin.

    One Chinese character is several Latin letters. Arabic and Hebrew write no vowels, so hardly any letters remain.
    """
    return max(sum(map(str.isalnum, typed)), sum(map(len, words_of_name(typed)))) >= SHORTEST_BEGUN


def is_half_of(typed: str, name: str) -> bool:
    """Return whether a name contains all words of the typed text, although the last one may be incomplete.

    The text may have a word for the kind of road that the name lacks (``ul. Reymonta``: ``Władysława Reymonta``).
    """
    words, held = words_of_name(typed), words_of_name(name)
    if not any(map(_is_kind, held)):
        words = tuple(word for word in words if not _is_kind(word))
    if not words or not is_long_enough(typed):
        return False
    return all(word in held for word in words[:-1]) and any(is_begun_with(words[-1], one) for one in held)


def is_some_words_of(typed: str, name: str) -> bool:
    """Return whether a text is half of a name as in :func:`is_half_of`, and its last word is complete too."""
    return is_half_of(typed, name) and words_of_name(typed)[-1] in words_of_name(name)


def is_begun_with(typed: str, name: str) -> bool:
    """Return whether a name begins with the typed letters; a number is never incomplete (``Calle 4``: ``Calle 40``)."""
    return name.startswith(typed) and not (typed[-1].isdecimal() and name[len(typed) : len(typed) + 1].isdecimal())


@lru_cache(maxsize=MOST_KEPT)
def _is_kind(word: str) -> bool:
    return bool(kinds_of_road(word))


@lru_cache(maxsize=MOST_KEPT)
def _scripts(text: str) -> frozenset[str]:
    """Return the scripts of a text's letters, as in their Unicode names (``LATIN``, ``CYRILLIC``, ``CJK``)."""
    return frozenset(unicodedata.name(letter, "").partition(" ")[0] for letter in text if letter.isalpha())


@lru_cache(maxsize=MOST_KEPT)
def _tellings(name: str) -> frozenset[str]:
    """Return the texts that distinguish a name: for each reading, its words without kind and direction, joined."""
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

    if _SYLLABLES.search(written):
        spoken = [_sound(re.sub("eu|u|o$", "", text).translate(_VOICELESS)) for text in (one, other)]
        if min(map(len, spoken)) < _FEWEST_CONSONANTS:
            return len({_sound(text.translate(_VOICELESS)) for text in (one, other)}) == 1 and min(map(len, spoken)) > 1
        least = _LEAST_LIKENESS if min(map(len, spoken)) > _FEWEST_CONSONANTS else 100
        return fuzz.ratio(*spoken) >= least
    heard = _sound(one), _sound(other)
    if VOWELLESS.search(written):
        heard = re.sub("[aeiou]", "", heard[0]), re.sub("[aeiou]", "", heard[1])
        return heard[0] == heard[1] and len(heard[0]) >= _FEWEST_CONSONANTS
    return min(map(len, heard)) > 1 and fuzz.ratio(*heard) >= _LEAST_LIKENESS
