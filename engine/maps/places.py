"""Spellings of places and countries: case, accents, umlauts and the names in other languages fold into one key.

Countries are a table here and not pycountry's, which has English names only, translations in 8 MB of gettext files that
have to be searched one by one, and not the short forms that users write (``uk``, ``holland``, CommonRoad's ``ZAM``).
"""

import unicodedata
from functools import cache

_CITY_NAMES = (
    "aachen aixlachapelle aken",
    "antwerp antwerpen anvers amberes",
    "athens athina athen",
    "barcelona barcelone",
    "basel basle bale",
    "beijing peking pekin pechino 北京 пекин",
    "brussels bruxelles brussel bruessel bruselas",
    "cologne koeln koln colonia",
    "florence firenze florenz",
    "geneva genf geneve",
    "hanover hannover",
    "lisbon lisboa lissabon",
    "milan milano mailand",
    "munich muenchen munchen muc monaco-di-baviera",
    "naples napoli neapel",
    "nuremberg nuernberg nurnberg norimberga",
    "perama περαμα",
    "prague praha prag",
    "qingdao tsingtao tsingtau 青岛 青島",
    "rome roma rom",
    "seville sevilla",
    "shanghai 上海",
    "tokyo tokio 東京",
    "turin torino",
    "vienna wien",
    "warsaw warszawa warschau",
    "zaragoza saragossa",
    "zurich zuerich",
)
_COUNTRY_NAMES = """
ARG ar argentina argentinien argentine
AUS au australia australien
AUT at austria oesterreich autriche
BEL be belgium belgien belgique belgie
BRA br brazil brasilien brasil
CAN ca canada kanada
CHE ch switzerland schweiz suisse svizzera
CHL cl chile
CHN cn china chine
CZE cz czechia czechrepublic tschechien cesko
DEU de ger germany deutschland allemagne duitsland alemania germania niemcy
DNK dk denmark daenemark danmark
ESP es spain spanien espana espagne spagna
FIN fi finland finnland
FRA fr france frankreich francia
GBR gb uk unitedkingdom greatbritain england
GRC gr greece griechenland ellada ελλαδα
HRV hr croatia kroatien
HUN hu hungary ungarn
IND in india indien
IRL ie ireland irland
ITA it italy italien italia italie
JPN jp japan
KOR kr southkorea korea
LIE li liechtenstein
LUX lu luxembourg luxemburg
MCO mc monaco
MEX mx mexico mexiko
NLD nl netherlands holland niederlande nederland paysbas
NOR no norway norwegen norge
NZL nz newzealand neuseeland
POL pl poland polen polska
PRI pr puertorico
PRT pt portugal
ROU ro romania rumaenien
RUS ru russia russland
SGP sg singapore singapur
SVK sk slovakia slowakei
SVN si slovenia slowenien
SWE se sweden schweden sverige
TUR tr turkey tuerkei turkiye
TWN tw taiwan
UKR ua ukraine
USA us unitedstates unitedstatesofamerica america vereinigtestaaten
ZAF za southafrica suedafrika
ZAM artificial invented zamunda
"""
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ø": "oe", "å": "aa", "æ": "ae"})


def fold(text: str) -> str:
    """Lower case, without accents, and only letters and digits."""
    plain = unicodedata.normalize("NFKD", text.casefold().replace("ß", "ss").replace("ø", "o").replace("æ", "ae"))
    return "".join(letter for letter in plain if letter.isalnum())


@cache
def _city_keys() -> tuple[frozenset[str], ...]:
    """The keys of every city that has several names."""
    return tuple(frozenset(fold(name) for name in names.split()) for names in _CITY_NAMES)


@cache
def _codes() -> dict[str, str]:
    """ISO 3166-1 alpha-3 by the key of a code or name."""
    codes: dict[str, str] = {}
    for line in _COUNTRY_NAMES.split("\n"):
        code, *names = line.split() or [""]
        for key in (code.casefold(), *(fold(name) for name in names)):
            codes.setdefault(key, code)
    return codes


def place_keys(text: str) -> frozenset[str]:
    """All keys that a place may be known by; two spellings mean the same place where they share one.

    ``Mölln``, ``Moelln`` and ``Molln`` share a key, as do ``München`` and ``Munich``.
    """
    lowered = unicodedata.normalize("NFC", text).casefold()
    spellings = {fold(lowered), fold(lowered.translate(_UMLAUTS))}
    spellings |= {_without_digraphs(spelling) for spelling in spellings}
    for keys in _city_keys():
        if not spellings.isdisjoint(keys):
            spellings |= keys
    return frozenset(spelling for spelling in spellings if spelling)


def country_code(text: str) -> str | None:
    """ISO 3166-1 alpha-3 of a code or a name; a word of three letters is taken as a code; None for anything else."""
    wanted = {fold(text), fold(text.casefold().translate(_UMLAUTS))}
    known = sorted(code for key in wanted - {""} if (code := _codes().get(key)) is not None)
    if known:
        return known[0]
    stripped = text.strip()
    return stripped.upper() if len(stripped) == 3 and stripped.isascii() and stripped.isalpha() else None


def _without_digraphs(spelling: str) -> str:
    return spelling.replace("ae", "a").replace("oe", "o").replace("ue", "u")
