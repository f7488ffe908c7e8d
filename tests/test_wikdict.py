"""How words for road users spread through dictionaries between languages (``scripts/wikdict.py``)."""

import gzip
import importlib.util
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parent.parent / "scripts" / "wikdict.py"
DIGITS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"


@pytest.fixture(scope="module")
def wikdict() -> Iterator[ModuleType]:
    spec = importlib.util.spec_from_file_location("wikdict", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def write_dictionary(folder: Path, pair: str, entries: Mapping[str, str], maker: str = "WikDict") -> None:
    text, index = f"made by {maker}\n", ""
    for head, body in entries.items():
        entry = f"{head} /x/ <n, fem>\n{body}\n"
        index += f"{head}\t{digits(len(text))}\t{digits(len(entry))}\n"
        text += entry
    (folder / f"freedict-{pair}.dict.dz").write_bytes(gzip.compress(text.encode()))
    (folder / f"freedict-{pair}.index").write_text(index, encoding="utf-8")


def digits(number: int) -> str:
    return (digits(number // 64) if number >= 64 else "") + DIGITS[number % 64]


def words(wikdict: ModuleType, folder: Path) -> dict[str, dict[str, str]]:
    cldr = {"deu": {"lastwagen": "truck"}, "fra": {"camion": "truck"}, "nld": {"auto": "car"}}
    found = wikdict.words_of_dictionaries(wikdict.Dictionaries.read(folder), {"truck": "truck"}, {}, cldr, cldr)
    return dict(found)


def test_a_word_has_the_meaning_that_two_dictionaries_give(wikdict: ModuleType, tmp_path: Path) -> None:
    write_dictionary(tmp_path, "deu-fra", {"Laster": "camion 2.\nein Fahrzeug\n 3.\nein anderes", "Kahn": "camion"})
    write_dictionary(tmp_path, "deu-eng", {"Laster": "1. vice\nSünde\n2. truck\nKraftfahrzeug"})
    write_dictionary(tmp_path, "nld-deu", {"vrachtwagen": "Laster, Lastwagen"})
    write_dictionary(tmp_path, "nld-fra", {"vrachtwagen": "camion"})
    assert words(wikdict, tmp_path) == {
        "deu": {"laster": "truck", "lastwagen": "truck"},
        "fra": {"camion": "truck"},
        "nld": {"vrachtwagen": "truck"},
    }


def test_later_meanings_and_other_makers_do_not_count(wikdict: ModuleType, tmp_path: Path) -> None:
    third = {"Zug": "1. train\nBahn\n2. pull\nKraft\n3. truck\nGespann"}
    write_dictionary(tmp_path, "deu-eng", third)
    write_dictionary(tmp_path, "deu-fra", {"Zug": "camion"}, maker="another")
    write_dictionary(tmp_path, "nld-deu", {"trein": "Zug"})
    assert words(wikdict, tmp_path) == {"deu": {}, "fra": {}, "nld": {}}


def test_a_word_with_two_classes_has_no_meaning(wikdict: ModuleType, tmp_path: Path) -> None:
    write_dictionary(tmp_path, "deu-fra", {"Ding": "camion"})
    write_dictionary(tmp_path, "deu-eng", {"Ding": "truck"})
    write_dictionary(tmp_path, "deu-nld", {"Ding": "auto"})
    write_dictionary(tmp_path, "nld-deu", {"auto": "Ding"})
    assert "ding" not in words(wikdict, tmp_path)["deu"]
