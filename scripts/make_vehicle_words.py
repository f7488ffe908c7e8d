"""Write ``engine/vehicles/vehicle_words.json.gz``, the words for road users' classes in many languages.

    python scripts/make_vehicle_words.py CLDR_ANNOTATIONS WORDNET DICTIONARIES

``CLDR_ANNOTATIONS`` is the folder ``annotations`` of the package ``cldr-annotations-full`` of Unicode's Common Locale
Data Repository (CLDR, Unicode License) with names and keywords of vehicle pictures in about 150 languages. ``WORDNET``
is the folder ``dict`` of WordNet 3 (WordNet License) with the hierarchy of English nouns. ``DICTIONARIES`` is the
folder of dictd with Debian's packages ``dict-freedict-*-*``; ``wikdict.py`` reads WikDict's dictionaries (CC BY-SA
3.0). A word's class comes from the first source that has one:

1. WordNet, if the word has one class there: as the class's synonym, or because its first meaning is a kind of it;
2. the dictionaries of most languages, by its first two meanings or the words that it translates;
3. the pictures that it names in most languages;
4. the pictures that it is a keyword of in most languages, if all pictures of one kind have it and no others;
5. trucks, if it is a keyword of both trucks and otherwise at most of a pickup and a fire engine, which are trucks too;
6. cars, if it is a keyword of a car and a word in those of an oncoming car, and no picture of another class has it.

Words also match English texts. An English word without a class is therefore left out (a bill is a car in Icelandic), as
are words without a letter. Words are in lower case, without accents, with letters and digits only.
"""

import gzip
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from wikdict import Dictionaries, most, two_letters, words_of_dictionaries

from plannerforge.engine.vehicles.words import plain_word

TARGET = Path(__file__).parent.parent / "engine" / "vehicles" / "vehicle_words.json.gz"
PICTURES = {
    "car": ["🚗🚘", "🚙"],
    "bus": ["🚌🚍", "🚐", "🚎"],
    "taxi": ["🚕🚖"],
    "emergency": ["🚓🚔", "🚑", "🚒"],
    "motorcycle": ["🏍"],
    "moped": ["🛵"],
    "bicycle": ["🚲🚴", "🚵", "🚳"],
    "pedestrian": ["🚶🚷", "🚷🚸"],
}
"""The pictures of each class, those of one kind together; a sequence that begins or ends with one (a woman on a
bicycle) is of its class too."""
POLICE = "👮🚨"
"""Pictures of police, which share the word with police cars."""
DELIVERY_TRUCK, ARTICULATED_LORRY, PICKUP = "🚚🚛🛻"
"""A word for both of the first two is a truck, and so is one for a pickup; one for the first alone is a delivery van.
The name of the second is a trailer if the language has a word for both, and otherwise its word for trucks."""
CAR, ONCOMING_CAR = "🚗🚘"
TRUCKS = f"{DELIVERY_TRUCK}{ARTICULATED_LORRY}{PICKUP}🚒"
_KINDS = [kind for kinds in PICTURES.values() for kind in kinds if len(kind) > 1] + [DELIVERY_TRUCK + ARTICULATED_LORRY]
SYNSETS = {
    "car": ["car automobile"],
    "truck": ["truck motortruck", "lorry camion"],
    "trailer": ["trailer_truck tractor_trailer semi"],
    "delivery": ["van", "delivery_truck delivery_van"],
    "bus": ["bus motorbus omnibus"],
    "taxi": ["cab taxi"],
    "emergency": ["ambulance", "fire_engine fire_truck", "cruiser police_car"],
    "motorcycle": ["motorcycle"],
    "moped": ["moped", "motor_scooter scooter"],
    "bicycle": ["bicycle bike", "cyclist bicyclist"],
    "pedestrian": ["pedestrian footer"],
}
"""The synonyms of WordNet that stand for each class, by words that they hold, which have the class whatever else they
mean. What is under several of them has the class of the nearest."""
COACH = "coach"
"""A class that is no synonym of WordNet's and no picture; only its English name stands for it."""
_NOUN_OF_ARTEFACT, _NOUN_OF_PERSON = 6, 18
"""WordNet's files of nouns (lexnames(5WN)): only their words can be road users."""


def words_of_wordnet(folder: Path) -> dict[str, str]:
    """Return the class of each English word with a single class."""
    synsets: dict[str, tuple[list[str], list[str]]] = {}
    for line in (folder / "data.noun").read_text(encoding="utf-8").splitlines():
        fields = line.partition("|")[0].split()
        if line.startswith(" ") or int(fields[1]) not in (_NOUN_OF_ARTEFACT, _NOUN_OF_PERSON):
            continue
        count = int(fields[3], 16)
        pointers = fields[5 + 2 * count :]
        narrower = [pointers[i + 1] for i, mark in enumerate(pointers) if mark in ("~", "~i")]
        synsets[fields[0]] = [word.lower() for word in fields[4 : 4 + 2 * count : 2]], narrower
    first = dict(_first_senses(folder))
    classes: dict[str, set[str]] = defaultdict(set)
    heads = {_head(words.split(), synsets): name for name, several in SYNSETS.items() for words in several}
    chosen = {word: name for name, several in SYNSETS.items() for words in several for word in words.split()}
    for head, name in heads.items():
        waiting = [head]
        while waiting:
            lemmas, narrower = synsets[(synonyms := waiting.pop())]
            for lemma in lemmas:
                if first.get(lemma) == synonyms and lemma not in chosen:
                    classes[lemma].add(name)
            waiting += [offset for offset in narrower if offset in synsets and offset not in heads]
    found = chosen | {word: next(iter(names)) for word, names in classes.items() if len(names) == 1}
    return {plain_word(word): name for word, name in found.items()}


def _first_senses(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield each noun with the synonyms of its first and most frequent meaning (wndb(5WN))."""
    for line in (folder / "index.noun").read_text(encoding="utf-8").splitlines():
        if not line.startswith(" "):
            fields = line.split()
            yield fields[0], fields[6 + int(fields[3])]


def english_words(folder: Path) -> Iterator[str]:
    """Yield every word of WordNet."""
    for part in ("noun", "verb", "adj", "adv"):
        for line in (folder / f"index.{part}").read_text(encoding="utf-8").splitlines():
            if not line.startswith(" "):
                yield plain_word(line.partition(" ")[0])


def _head(words: Sequence[str], synsets: Mapping[str, tuple[list[str], list[str]]]) -> str:
    """Return the synonyms that contain the words; if there are several, as for van, those with the most hyponyms."""
    found = [offset for offset, (lemmas, _) in synsets.items() if set(words) <= set(lemmas)]
    return max(found, key=lambda offset: len(synsets[offset][1]))


def words_of_cldr(folder: Path, languages: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return the classes of picture names, and of keywords, in the languages that match a pattern of codes."""
    names: dict[str, Counter[str]] = defaultdict(Counter)
    keywords: dict[str, Counter[str]] = defaultdict(Counter)
    tables = [dict(_pictures(path)) for path in sorted(folder.glob(f"{languages}/annotations.json"))]
    trucks = {word for pictures in tables for word in _for_both_trucks(pictures)}
    for pictures in tables:
        used: dict[str, dict[str, str]] = defaultdict(dict)
        has_both = bool(_for_both_trucks(pictures))
        for picture, (named, described) in pictures.items():
            for word in described:
                used[word][picture] = _class_of(picture, word in trucks, has_both and word in named)
                if word in named and used[word][picture]:
                    names[word][used[word][picture]] += 1
        for word, classes in used.items():
            if len(set(classes.values())) == 1 and any(set(kind) <= set(classes) for kind in _KINDS):
                keywords[word].update(set(classes.values()))
    return _majority(names), _majority(keywords)


def words_for_trucks(folder: Path) -> dict[str, str]:
    """Return the keywords of both trucks in any language that no picture has but those of other trucks."""
    found: set[str] = set()
    for path in sorted(folder.glob("*/annotations.json")):
        pictures = dict(_pictures(path))
        others = (described for picture, (_, described) in pictures.items() if picture not in TRUCKS)
        found |= _for_both_trucks(pictures).difference(*others)
    return dict.fromkeys(found, "truck")


def words_for_cars(folder: Path) -> dict[str, str]:
    """Return the keywords of a car that are words in those of an oncoming car in a language, unless others have them.

    Some languages have the word for a car alone only at one picture, as Korean, or also at carriages of trains, as
    Hindi.
    """
    others = {picture for kinds in PICTURES.values() for kind in kinds for picture in kind} - set(CAR + ONCOMING_CAR)
    others = (others | set(POLICE + TRUCKS)) - set("".join(PICTURES["car"]))
    found: set[str] = set()
    for path in sorted(folder.glob("*/annotations.json")):
        pictures = dict(_pictures(path))
        parts = {plain_word(part) for text in _texts(path, ONCOMING_CAR) for part in text.replace(",", " ").split()}
        elsewhere = (words for picture, (_, words) in pictures.items() if {picture[0], picture[-1]} & others)
        found |= (pictures.get(CAR, (set(), set()))[1] & parts).difference({""}, *elsewhere)
    return dict.fromkeys(found, "car")


def _texts(path: Path, picture: str) -> list[str]:
    """Return the names and keywords of a picture as a language writes them."""
    annotations: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["annotations"].get("annotations", {})
    words = annotations.get(picture, {})
    return [*words.get("tts", ()), *words.get("default", ())]


def _for_both_trucks(pictures: Mapping[str, tuple[set[str], set[str]]]) -> set[str]:
    """Return the words that a language uses for both a delivery truck and an articulated lorry."""
    delivery, articulated = (pictures.get(one, (set(), set()))[1] for one in (DELIVERY_TRUCK, ARTICULATED_LORRY))
    return delivery & articulated


def _pictures(path: Path) -> Iterator[tuple[str, tuple[set[str], set[str]]]]:
    annotations: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["annotations"].get("annotations", {})
    for picture, words in annotations.items():
        named, described = (_plain(words.get(key, ())) for key in ("tts", "default"))
        yield picture.removesuffix("\ufe0f"), (named, named | described)


def _plain(words: Iterable[str]) -> set[str]:
    return {plain_word(word) for word in words} - {""}


def _class_of(picture: str, truck: bool, articulated: bool) -> str:
    if picture in (DELIVERY_TRUCK, ARTICULATED_LORRY, PICKUP):
        if picture == DELIVERY_TRUCK and not truck:
            return "delivery"
        return "trailer" if picture == ARTICULATED_LORRY and articulated and not truck else "truck"
    parts = {picture[0], picture[-1]}
    if parts & set(POLICE):
        return "emergency"
    return next((class_ for class_, kinds in PICTURES.items() if parts & set("".join(kinds))), "")


def words_of_wikdict(folder: Path, annotations: Path, english: Mapping[str, str]) -> dict[str, str]:
    """Return the class of each word in the dictionaries, starting from the CLDR's words for pictures."""
    dictionaries = Dictionaries.read(folder)
    languages = {
        language: two_letters(language) for language, _ in dictionaries.meanings.keys() | dictionaries.translated
    }
    found = {
        language: words_of_cldr(annotations, code)
        for language, code in languages.items()
        if code not in ("", "en") and (annotations / code).is_dir()
    }
    cldr = {language: keywords | named for language, (named, keywords) in found.items()}
    names = {language: named for language, (named, _) in found.items()}
    synonyms = {
        plain_word(word): name for name, several in SYNSETS.items() for words in several for word in words.split()
    }
    votes: dict[str, Counter[str]] = defaultdict(Counter)
    for words in words_of_dictionaries(
        dictionaries, {**english, COACH: COACH}, {**synonyms, COACH: COACH}, cldr, names
    ).values():
        for word, name in words.items():
            votes[word][name] += 1
    return _majority(votes)


def _majority(votes: Mapping[str, Counter[str]]) -> dict[str, str]:
    return {word: winner for word, classes in votes.items() if (winner := most(classes)) is not None}


def main() -> None:
    """Write the table."""
    annotations, wordnet, dictionaries = map(Path, sys.argv[1:4])
    named, keywords = words_of_cldr(annotations, "*")
    english = set().union(*words_of_cldr(annotations, "en"), named_classes := words_of_wordnet(wordnet))
    others = set(english_words(wordnet)) - english
    translated = words_of_wikdict(dictionaries, annotations, named_classes)
    found = words_for_cars(annotations) | words_for_trucks(annotations)
    found |= keywords | named | translated | named_classes
    named_classes = {word: class_ for word, class_ in found.items() if word not in others}
    named_classes = {word: class_ for word, class_ in named_classes.items() if not word.isnumeric()}
    words: dict[str, list[str]] = defaultdict(list)
    for word, class_ in sorted(named_classes.items()):
        words[class_].append(word)
    version = json.loads((annotations.parent / "package.json").read_text(encoding="utf-8"))["version"]
    table = {"source": f"CLDR {version} (annotations), WordNet 3, WikDict", "words": dict(sorted(words.items()))}
    text = json.dumps(table, ensure_ascii=False, separators=(",", ":"))
    TARGET.write_bytes(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    main()
