"""Compares spellings of road names in any script: abbreviations, transliteration, word order, numbered sections.

A name becomes words in a plain form (Latin letters, no accents, no digraphs for umlauts). Words for a kind of road or
for one end of it become one English word in all languages. Two names are alike if they leave the same words, in any
order.
"""

import gzip
import json
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import cache, lru_cache
from itertools import islice, product
from pathlib import Path
from typing import Any

from .places import VOWELLESS, fold, latin

_ABBREVIATIONS = Path(__file__).parent / "road_words.json.gz"
"""libpostal's abbreviations, its words for numbers and directions, its kinds of roads as word endings, and its words
for crossings; and the CLDR's spelt-out numbers (``scripts/make_road_words.py``).
"""
_SAME_WORDS = """
street: street st str strasse straat strada stradal rue ulitsa
street: ulica ul vulitsya vulytsya calle via rruga rr gata gatan
street: gade utca odos sokak sok cadde caddesi cad jalan shari sharia rua r c dori
road: road rd lu chaussee shosse drum drumul carretera ctra doroga daeroro
boulevard: boulevard boul bd bld blvd bvd bulevardi bul bulevard bulevardul bulevar bulvar bulvari leoforos buliwar
avenue: avenue ave av avenida avda avd prospekt pr prosp prospect dadao viale aleja al aleea
drive: drive dr
doctor: doctor dr doktor
saint: saint st sankt sainte ste sankt san santa sant
square: square sq platz pl plaza plaza piazza plac pl ploshchad ploscha plosca piata plein guangchang sheshi place
place: place pl
court: court ct
lane: lane ln
terrace: terrace ter terr
crescent: crescent cres
highway: highway hwy hiway
freeway: freeway fwy
parkway: parkway pkwy
expressway: expressway expwy expy
causeway: causeway cswy
roundabout: roundabout rotonda rotatory kreisel kreisverkehr rondpoint
bridge: bridge br brucke pont most ponte
way: way wy
alley: alley aly
gardens: gardens gdns
close: close cl
mount: mount mt
fort: fort ft
street: רחוב شارع نهج خیابان ქუჩა փողոց
boulevard: שדרות שדרה بلوار
road: דרך طريق
avenue: جادة გამზირი պողոտա
square: כיכר ככר ميدان ساحة میدان
alley: סמטה סמטת زقاق زنقة کوچه
and: and und et y
north: north n bei severnaya severnyy
south: south s sur nan yuzhnaya yuzhnyy
east: east e dong vostochnaya vostochnyy
west: west w ouest oeste xi zapadnaya zapadnyy
northeast: northeast ne
northwest: northwest nw
southeast: southeast se
southwest: southwest sw
middle: middle mid zhong
i: i interstate
us: us usroute ushighway ushwy
general: general gen gral
great: great gt
little: little ltl
upper: upper upr
lower: lower lwr
professor: professor prof
president: president pres
princess: princess princesse
prince: prince
"""
"""Words of road names with the same meaning, and their spellings; a spelling may stand for several words.

libpostal lacks this: it knows the words of each language, but not which of them mean the same in another one. For
directions, it has no adjectives, no single letters, and nothing in Chinese.
"""
_KINDS = frozenset(
    [
        "street",
        "road",
        "boulevard",
        "avenue",
        "drive",
        "square",
        "place",
        "court",
        "lane",
        "terrace",
        "crescent",
        "highway",
        "freeway",
        "parkway",
        "expressway",
        "causeway",
        "way",
        "alley",
        "close",
        "bridge",
    ]
)
_OPEN_PLACES = frozenset(["square", "place"])
_DIRECTIONS = frozenset(
    ["north", "south", "east", "west", "northeast", "northwest", "southeast", "southwest", "middle"]
)
# Articles and words for "of", all among libpostal's stopwords and elisions; its other stopwords distinguish roads (``Am
# Markt``, ``Unter den Linden``). ``section`` is Taiwan's word before the number of a stretch.
_PARTICLES = frozenset(
    [
        "the",
        "de",
        "du",
        "des",
        "la",
        "le",
        "les",
        "l",
        "d",
        "der",
        "die",
        "das",
        "den",
        "dem",
        "of",
        "do",
        "da",
        "di",
        "del",
        "della",
        "dell",
        "van",
        "het",
        "el",
        "al",
        "section",
        "sec",
    ]
)
# Of libpostal's Chinese kinds of roads and directions, those that end a name, with the traditional character.
_CHINESE_KINDS = {"大道": "avenue", "大街": "street", "路": "road", "街": "street", "道": "road", "巷": "alley"}
_CHINESE_DIRECTIONS = {"北": "north", "南": "south", "东": "east", "東": "east", "西": "west", "中": "middle"}
_NUMERALS = "一二三四五六七八九十"
_CHINESE_ROAD = re.compile(
    rf"(?P<stem>[\u4e00-\u9fff]{{1,}}?)(?P<direction>[北南东東西中]?)(?P<section>[{_NUMERALS}]?)"
    rf"(?P<kind>{'|'.join(_CHINESE_KINDS)})(?P<part>(?:[{_NUMERALS}]|\d{{1,2}})段)?"
)
_CHINESE_SECTION = re.compile(rf"(?:[{_NUMERALS}]|\d{{1,2}})段")
_SECTION_WORDS = frozenset(["section", "sec"])
_NUMBERED_KINDS = frozenset(
    ["road", "highway", "freeway", "expressway", "route", "interstate", "motorway", "autoroute", "autobahn", "loop"]
)
"""The kinds of roads with numbers as names, in our words and libpostal's.

Streets and avenues have numbers in grids, but there the number is not a reference.
"""
_LETTERED = {
    "interstate": "i",
    "usroute": "us",
    "ushighway": "us",
    "ushwy": "us",
    "bundesstrasse": "b",
    "bundesstr": "b",
    "autobahn": "a",
    "autoroute": "a",
    "motorway": "m",
    "staatsstrasse": "st",
    "staatsstr": "st",
    "landesstrasse": "l",
    "landesstr": "l",
    "kreisstrasse": "k",
    "kreisstr": "k",
}
"""OSM's ``ref`` letters for a class of roads, by the words that people use for them."""
HYPHENS = "-\u2010\u2011\u2013\u05be"
"""Signs between the parts of a name: hyphens, the en dash, and the Hebrew maqaf."""
_JOINED_NUMBER = re.compile(r"^([^\W\d_]{2,3})(\d+)$")
_ELIDED = re.compile(r"\b(?:d|l|s|dell|dall|all|nell|sull)['’](?=\w)", re.IGNORECASE)
"""Articles and prepositions before a vowel, in Catalan, French and Italian: ``Port d'Envalira``. They are libpostal's
elisions without those of pronouns and without ``sant'``, plus the Italian prepositions that it lacks.
"""
_CONTRACTED = re.compile(r"\b(\w{1,2}(?=\.)|[^\W\d_](?=-))[.-](\w{2,3})\b(?!\.)")
"""Contractions with a point or a hyphen inside: ``P.za``, ``C.so``, ``V.le``, ``B-dul``, ``пр-т``."""
_ORDINAL = re.compile(r"(?P<number>\d{1,4})(?P<end>[a-z]{1,3})")
_ROMAN_ORDINAL = re.compile(r"(?P<number>[ivx]+)(?:er|ere|re|e|eme)")
"""French ordinals with a Roman number (``Ier``)."""
_ORDINAL_MARK = re.compile(r"(?<=\d)(?:\s*\.?[ºª°]|-[\u0400-\u04ff]{1,3}\b)")
"""What stands behind the digits of an ordinal in Romance languages and, with a hyphen, in Cyrillic (``1-я``)."""
_PROCLITICS = re.compile(r"[\u05d5\u05d4\u05d1\u05db\u05dc\u05de\u05e9]|\u0627\u0644|[\u0648\u0641\u0628\u0643\u0644]")
"""Words of one or two letters that Hebrew and Arabic write as part of the next word, all of them: *and*, *the*, *in*,
*as*, *to*, *from*, *that* (ו ה ב כ ל מ ש); *the*, *and*, *then*, *in*, *as*, *to* (ال و ف ب ك ل).
"""
_ENCLITICS = frozenset("와과")
"""Korean's “and”, in its two forms after a vowel and a consonant, which is written as part of the word before it."""
_MOST_PROCLITICS, _SHORTEST_AFTER = 2, 2
"""Maximum number of such words before one word, and minimum letters of the rest (chosen): a letter alone is no name."""
_SHORTEST_VOWELLESS = 4
"""Minimum letters of a word without vowels that has a meaning: ``عبد`` (bd) is no boulevard (chosen)."""
_SHORTEST_NUMBER = 3
"""Minimum letters of a number's word: shorter ones are initials and syllables in other languages (chosen)."""
_ROMAN_NUMBER = re.compile("[ivx]+")
_MOST_READINGS = 32
"""Maximum number of compared readings of one name: ``St`` has two, and a name has few such words (chosen)."""
MOST_KEPT = 50_000
"""Maximum number of names with cached spellings, because every call compares all of them (chosen)."""


@cache
def _table() -> dict[str, Any]:
    table: dict[str, Any] = json.loads(gzip.decompress(_ABBREVIATIONS.read_bytes()))
    return table


def words_for_crossings() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the words, in all languages, that join two road names (``and``), and those that precede both."""
    return tuple(_table()["joining"]), tuple(_table()["corners"])


@cache
def _endings() -> dict[str, str]:
    """Return the kind of road that each word ending means (``Hauptstr``, ``Storgatan``), longest ending first."""
    meant: dict[str, str] = {}
    for kind, spellings in _table()["suffixes"].items():
        kinds = [word for word in _meanings().get(kind, ()) if word in _KINDS]
        meant |= {spelling: kinds[0] for spelling in spellings if len(kinds) == 1}
    return dict(sorted(meant.items(), key=lambda pair: (-len(pair[0]), pair[0])))


@cache
def _own_words() -> frozenset[str]:
    """Return the spellings in our own list, in their own scripts."""
    return frozenset(word for line in _SAME_WORDS.strip().splitlines() for word in line.partition(": ")[2].split())


@cache
def _meanings() -> dict[str, tuple[str, ...]]:
    """Return the words that each spelling may represent.

    The sources are our own words, one for all languages, and libpostal's abbreviations. An abbreviation represents one
    of our words if the two are spelt alike, otherwise the word that it shortens. A number's word represents itself and
    the number.
    """
    found: dict[str, tuple[str, ...]] = {}
    for line in _SAME_WORDS.strip().splitlines():
        meaning, same = line.split(": ")
        for spelling in same.split():
            plain = latin(spelling)
            itself = (plain,) if len(plain) == 1 and meaning in _KINDS else ()  # ``C Street`` is not ``Calle``
            found[plain] = tuple(dict.fromkeys((*found.get(plain, ()), *itself, meaning)))
    table = _table()
    for direction, spellings in table["directions"].items():
        for spelling in spellings:
            if spelling not in _PARTICLES:
                found[spelling] = tuple(dict.fromkeys((*found.get(spelling, ()), direction)))
    own = dict(found)
    for word, written in (*table["kinds"].items(), *table["others"].items()):
        abbreviated = [word, *(each for each in written if len(each) > 1)]
        told = [own[each] for each in abbreviated if len(each) > 2 and len(own.get(each, ())) == 1]
        meanings = own.get(word) or (told[0] if told else (word,))
        for spelling in abbreviated:
            itself = () if spelling in own else (spelling,)
            found[spelling] = tuple(dict.fromkeys((*found.get(spelling, itself), *meanings)))
    for word, values in table["numbers"].items():
        if word not in _PARTICLES and (len(word) >= _SHORTEST_NUMBER or _ROMAN_NUMBER.fullmatch(word)):
            found[word] = (*found.get(word, (word,)), *map(str, values))
    for words, spelt in _spelt_numbers().items():
        if " " not in words and words not in found:
            found[words] = (words, *spelt)
    return found


@cache
def _spelt_numbers() -> dict[str, tuple[str, ...]]:
    """Return the values of each spelt-out number, cardinal or ordinal, by its words."""
    found: dict[str, tuple[str, ...]] = {}
    for value, spellings in _table()["spelt_numbers"].items():
        for words in spellings:
            found[words] = (*found.get(words, ()), value)
    return found


@cache
def _most_number_words() -> int:
    return max(words.count(" ") + 1 for words in _spelt_numbers())


def _as_numbers(words: Sequence[str]) -> list[tuple[str, tuple[str, ...]]]:
    """Return the words with the values of those that are a number; several words of one number become one."""
    found = []
    index = 0
    while index < len(words):
        for end in range(min(len(words), index + _most_number_words()), index + 1, -1):
            joined = " ".join(words[index:end])
            if (values := _spelt_numbers().get(joined)) is not None:
                found.append((joined, values))
                index = end
                break
        else:
            found.append((words[index], ()))
            index += 1
    return found


@lru_cache(maxsize=MOST_KEPT)
def is_one_number(before: str, between: str, after: str) -> bool:
    """Return whether texts in a row end and begin with words of one number (``Rua Vinte``, ``e``, ``Cinco``)."""
    first, middle, last = (list(words_of_name(text)) for text in (before, between, after))
    most = _most_number_words() - len(middle)
    return any(
        " ".join((*first[-ahead:], *middle, *last[:behind])) in _spelt_numbers()
        for ahead in range(1, min(len(first), most) + 1)
        for behind in range(1, min(len(last), most - ahead) + 1)
    )


@lru_cache(maxsize=MOST_KEPT)
def road_readings(name: str) -> frozenset[frozenset[str]]:
    """Return the possible readings of a road name, as sets of words; empty for a name without letters and digits."""
    readings = [_chinese(name)] if _chinese(name) else []
    written = {latin(word): word for word in _split(name)}
    choices = [
        [(value,) for value in values]
        if values
        else [(word,)]
        if len(word) < _SHORTEST_VOWELLESS and VOWELLESS.search(written[word]) and written[word] not in _own_words()
        else list(_word_readings(word))
        for word, values in _as_numbers([word for word in map(latin, _split(name)) if word])
    ]
    readings += islice(product(*choices), _MOST_READINGS)
    meant = [[word for words in reading for word in words] for reading in readings]
    return frozenset(frozenset(words) for words in _without_repeated_kinds(meant) if words)


def _without_repeated_kinds(readings: list[list[str]]) -> list[list[str]]:
    """Return the readings that do not repeat a kind of road; all readings if every one of them does.

    ``C Street`` is a street called C, and not ``Calle Street``.
    """
    kinds = [[word for word in words if word in _KINDS] for words in readings]
    once = [words for words, said in zip(readings, kinds, strict=True) if len(said) == len(set(said))]
    return once or readings


@lru_cache(maxsize=MOST_KEPT)
def road_keys(name: str) -> frozenset[str]:
    """Return the keys of a road name; two names are spellings of one road if they share a key."""
    keys = {" ".join(sorted(_without_particles(reading))) for reading in road_readings(name)}
    joined = {fold(name), latin(name), *("".join(key.split()) for key in keys)}
    return frozenset(key for key in keys | joined | _number_keys(name) if key)


def _without_particles(reading: frozenset[str]) -> frozenset[str]:
    """Return the words without particles; a letter is a name if only a kind of road is left (``Rua D``)."""
    rest = reading - _PARTICLES
    letters = frozenset(word for word in reading if len(word) == 1)
    return (rest | letters if rest <= _KINDS else rest) or reading


def has_same_numbers(one: str, other: str) -> bool:
    """Return True if two names differ at most in how they write numbers (``Primeiro de Maio``, ``1º de Maio``)."""
    numbered = [_as_numbers(words_of_name(_ORDINAL_MARK.sub("", name))) for name in (one, other)]
    words = [Counter(word for word, _ in each) for each in numbered]
    left = list((words[0] - words[1]).elements()), list((words[1] - words[0]).elements())
    numbers = [[_numbers_meant(word) for word in each] for each in left]
    return len(left[0]) == len(left[1]) <= 1 and all(
        not first.isdisjoint(second) for first, second in zip(*numbers, strict=True)
    )


def _numbers_meant(word: str) -> frozenset[str]:
    """Return the numbers that a word, or several of them, may be."""
    if " " in word:
        return frozenset(_spelt_numbers()[word])
    return frozenset(one for reading in _word_readings(word) for one in reading if one.isdecimal())


@lru_cache(maxsize=MOST_KEPT)
def whole_road_keys(name: str) -> frozenset[str]:
    """Return the keys of a numbered section's whole road (``中山北一路``: ``中山北路``); empty for other names."""
    found = _CHINESE_ROAD.fullmatch(name.strip())
    if found is not None and (found["section"] or found["part"]):
        return road_keys(found["stem"] + found["direction"] + found["kind"])
    return frozenset(
        " ".join(sorted(reading - numbers))
        for reading in road_readings(name)
        if reading & _KINDS
        and reading & _DIRECTIONS
        and len(numbers := {word for word in reading if word.isdecimal()}) == 1
        and len(reading - numbers - _KINDS - _DIRECTIONS) > 0
    )


def distinctive(words: Iterable[str]) -> frozenset[str]:
    """Return the words that distinguish a road, without its kind and without directions."""
    return frozenset(words) - _KINDS - _DIRECTIONS - _PARTICLES - {"and", "saint"}


def without_kinds(words: frozenset[str]) -> frozenset[str]:
    """Return the words without particles and without words for the kind of road."""
    return words - _KINDS - _PARTICLES


def has_words_of(held: frozenset[str], words: frozenset[str]) -> bool:
    """Return whether a reading has all words of another one; a reading without any kind of road may lack the kind."""
    return words <= held or (held.isdisjoint(_KINDS) and words - _KINDS <= held)


def is_only_a_kind(name: str) -> bool:
    """Return True for words that only say what kind of road it is (``Avenue``, ``rue de la``)."""
    readings = road_readings(name)
    return bool(readings) and not any(map(without_kinds, readings))


def kinds_of_road(name: str) -> frozenset[str]:
    """Return the kinds of road in any reading of a name (``street``, ``boulevard``)."""
    return frozenset(word for reading in road_readings(name) for word in reading & _KINDS)


def is_direction(word: str) -> bool:
    """Return True if a word may be a direction in a road's name."""
    return any(reading & _DIRECTIONS for reading in road_readings(word))


@lru_cache(maxsize=MOST_KEPT)
def is_title(word: str) -> bool:
    """Return True for a title before or after a person's name (``doctor``, ``jr``)."""
    return word in _titles()


@cache
def _titles() -> frozenset[str]:
    return frozenset(_table()["titles"])


def always_says_kind(name: str) -> bool:
    """Return whether every reading of a name has a kind of road: ``C`` in ``M.C. Briones`` need not be ``Calle``."""
    return all(reading & _KINDS for reading in road_readings(name))


def names_a_street(name: str) -> bool:
    """Return True if a name means a road in every reading; squares and places may be parts of a town."""
    if _CHINESE_ROAD.fullmatch(name.strip()):
        return True
    readings = road_readings(name)
    return bool(readings) and all(reading & (_KINDS - _OPEN_PLACES) for reading in readings)


@lru_cache(maxsize=MOST_KEPT)
def proclitics_of(word: str) -> tuple[tuple[str, str], ...]:
    """Return the ways to read a word as short words that are written together with a longer one (``ואלנבי``: ``ו``,
    ``אלנבי``), perhaps with a hyphen between them; the word itself may begin with these letters.
    """
    found: list[tuple[str, str]] = []
    rest = word
    for _ in range(_MOST_PROCLITICS):
        short = _PROCLITICS.match(rest)
        rest = "" if short is None else rest[short.end() :].lstrip(HYPHENS)
        if sum(map(str.isalnum, rest)) < _SHORTEST_AFTER:
            break
        found.append((word[: len(word) - len(rest)].rstrip(HYPHENS), rest))
    return tuple(found)


def enclitics_of(word: str) -> tuple[tuple[str, str], ...]:
    """Return the ways to read a word as a name with a Korean “and” written together with it (``뚝섬로와``)."""
    name, short = word[:-1], word[-1:]
    return ((name, short),) if short in _ENCLITICS and sum(map(str.isalnum, name)) >= _SHORTEST_AFTER else ()


def words_of_name(name: str) -> tuple[str, ...]:
    """Return the words of a name in order, in Latin letters without accents."""
    return tuple(word for word in map(latin, _split(_ELIDED.sub("", name))) if word)


def without_particles(words: Sequence[str]) -> tuple[str, ...]:
    """Return the words without articles and prepositions; all words if there are no others."""
    return tuple(word for word in words if word not in _PARTICLES) or tuple(words)


def is_joined_by_particle(head: str, tail: str) -> bool:
    """Return whether an article or a word for "of" stands between two parts of a text (``Praia da``, ``Barra``)."""
    before, after = words_of_name(head), words_of_name(tail)
    return (len(before) > 1 and before[-1] in _PARTICLES) or (len(after) > 1 and after[0] in _PARTICLES)


def _split(name: str) -> list[str]:
    name = _ORDINAL_MARK.sub(" ", name)
    plain = re.sub(r"['’ʼ`´]", "", _CONTRACTED.sub(r"\1\2", name.casefold())).replace("&", " and ")
    return "".join(letter if _is_in_word(letter) else " " for letter in plain).split()


@lru_cache(maxsize=MOST_KEPT)
def _is_in_word(letter: str) -> bool:
    """Return whether a character is part of a word: vowel signs, as in Devanagari, are marks and not letters."""
    return letter.isalnum() or unicodedata.category(letter).startswith("M")


def _word_readings(word: str) -> tuple[tuple[str, ...], ...]:
    """Return the readings of a word in plain Latin letters; one that ends in a kind of road becomes two words."""
    ordinal = _ORDINAL.fullmatch(word)
    if ordinal and _is_ordinal(ordinal["number"], ordinal["end"]):
        return ((ordinal["number"],),)
    known = _meanings().get(word)
    if known is not None:
        return tuple((meaning,) for meaning in known)
    roman = _ROMAN_ORDINAL.fullmatch(word)
    if roman and (values := _table()["numbers"].get(roman["number"])):
        return ((word,), *((str(value),) for value in values))
    for end, kind in _endings().items():
        if word.endswith(end) and len(word) > len(end) + 2:
            return ((word.removesuffix(end), kind),)
    return ((word,),)


def _is_ordinal(number: str, end: str) -> bool:
    """Return True if the letters after a number make it an ordinal.

    The letters must be an ending that libpostal lists (``1st``, ``2nd``), or the end of the ordinal's own word, as in
    many languages (``4ta``: cuarta; ``7mo``: séptimo).
    """
    if end in _table()["ordinals"]:
        return True
    values = {int(number), int(number[-1])}
    words = (word for word, meant in _table()["numbers"].items() if not values.isdisjoint(meant))
    return len(end) > 1 and any(word.endswith(end) for word in words)


def _chinese(name: str) -> tuple[tuple[str, ...], ...]:
    """Return the words of a Chinese road name as one reading; return nothing for any other name."""
    found = _CHINESE_ROAD.fullmatch(name.strip())
    if found is None:
        return ()
    words = [latin(found["stem"]), _CHINESE_DIRECTIONS.get(found["direction"], "")]
    numerals = [_value_of(text.removesuffix("段")) for text in (found["section"], found["part"]) if text]
    return (tuple(word for word in (*words, *map(str, numerals), _CHINESE_KINDS[found["kind"]]) if word),)


def _value_of(numeral: str) -> int:
    return int(numeral) if numeral.isdecimal() else _NUMERALS.find(numeral) + 1


def is_section(text: str) -> bool:
    """Return True for the number of a road's section without the road (``Sec. 4``, ``四段``)."""
    words = words_of_name(text)
    others = [word for word in words if word not in _SECTION_WORDS]
    is_numbered = len(words) == 2 and len(others) == 1 and bool(_numbers_meant(others[0]))
    return is_numbered or _CHINESE_SECTION.fullmatch(text.strip()) is not None


def ends_in_section(name: str) -> bool:
    """Return True if the last word announces the number of a section (``Taiwan Boulevard Section``)."""
    return not _SECTION_WORDS.isdisjoint(words_of_name(name)[-1:])


@lru_cache(maxsize=MOST_KEPT)
def _numbers_in(name: str) -> frozenset[frozenset[str]]:
    """Return the numbers in each reading of a name."""
    return frozenset(frozenset(filter(str.isdecimal, reading)) for reading in road_readings(name))


def agrees_in_numbers(one: str, other: str) -> bool:
    """Return whether two names may have the same numbers, in figures, in words or as Roman numerals."""
    return not _numbers_in(one).isdisjoint(_numbers_in(other))


def adds_number(typed: str, name: str) -> bool:
    """Return whether a name has a number that the typed text lacks, in every reading."""
    return not any(held <= asked for asked in _numbers_in(typed) for held in _numbers_in(name))


def _number_keys(name: str) -> set[str]:
    """Return the keys of a road number that is written with words: ``Interstate 5``, ``Bundesstraße 96``."""
    words = [latin(word) for word in _split(name)]
    if len(words) < 2 or not words[-1].isdecimal():
        return set()
    before = "".join(words[:-1])
    letters = {latin(said): letters for said, letters in _LETTERED.items()}.get(before)
    return {letters + words[-1]} if letters else set()


def route_number(name: str) -> str | None:
    """Return the number of a road that has no other name (``Route 99``, ``SR 99``, ``RN7``); None for other names."""
    *kind, number = [latin(word) for word in _split(_JOINED_NUMBER.sub(r"\1 \2", name.strip()))] or [""]
    return number if kind and number.isdecimal() and " ".join(kind) in _numbered_kinds() else None


def is_class_of_roads(network: str) -> bool:
    """Return True for the letters before the numbers of one class of roads (``US``, ``I``), not of a state's roads."""
    return latin(network) in _LETTERED.values()


@lru_cache(maxsize=MOST_KEPT)
def initials_of_network(name: str) -> frozenset[str]:
    """Return the initials of the kind of road before a number, except of its first word's (``RN7``: ``N``)."""
    kind = " ".join(map(latin, _split(_JOINED_NUMBER.sub(r"\1 \2", name.strip()))[:-1]))
    long = _table()["long_kinds"].items()
    return frozenset(word[0] for whole, short in long if kind in (whole, *short) for word in whole.split()[1:])


@cache
def _numbered_kinds() -> frozenset[str]:
    """Return all spellings of the kinds of roads with numbers as names."""
    short = {spelling for spelling, meant in _meanings().items() if not _NUMBERED_KINDS.isdisjoint(meant)}
    long = _table()["long_kinds"].items()
    numbered = ((kind, *spellings) for kind, spellings in long if not short.isdisjoint(kind.split()))
    return frozenset(short.union(_NUMBERED_KINDS, *numbered))
