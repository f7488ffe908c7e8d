"""Spellings of places and countries: case, accents, umlauts and the names in other languages fold into one key.

Countries are a table here and not pycountry's, which has English names only, translations in 8 MB of gettext files that
have to be searched one by one, and not the short forms that users write (``uk``, ``holland``, CommonRoad's ``ZAM``).
"""

import unicodedata
from functools import cache, lru_cache

_CITY_NAMES = (
    "aachen aixlachapelle aken",
    "amsterdam амстердам 阿姆斯特丹 アムステルダム",
    "antwerp antwerpen anvers amberes",
    "athens athina athen athenes αθηνα афины 雅典",
    "barcelona barcelone барселона 巴塞罗那",
    "basel basle bale базель",
    "beijing peking pekin pechino 北京 пекин",
    "berlin berlino берлин 柏林 ベルリン βερολινο برلين ברלין 베를린 berlim",
    "bristol бристоль 布里斯托尔 布里斯托 ブリストル",
    "brussels bruxelles brussel bruessel bruselas брюссель 布鲁塞尔",
    "cologne koeln koln colonia кельн кёльн 科隆",
    "florence firenze florenz",
    "fremantle фримантл 弗里曼特尔",
    "geneva genf geneve женева 日内瓦",
    "hamburg гамбург 汉堡 ハンブルク",
    "hanover hannover ганновер",
    "korce korca korche korça korçë korcë korcha корча 科尔察 κορυτσα korytsa",
    "leeds лидс 利兹 リーズ",
    "lisbon lisboa lissabon lisbonne лиссабон",
    "london londres londra londen лондон 伦敦 倫敦 ロンドン λονδινο لندن לונדון 런던 londyn",
    "madrid мадрид 马德里",
    "memphis мемфис 孟菲斯 メンフィス",
    "milan milano mailand милан",
    "monaco монако 摩纳哥 モナコ μονακο موناكو",
    "moscow moskva moskau moscou москва 莫斯科 モスクワ",
    "munich muenchen munchen muc monaco-di-baviera monacodibaviera мюнхен 慕尼黑 ミュンヘン μοναχο ميونخ מינכן 뮌헨",
    "naples napoli neapel неаполь",
    "newcastle newcastleupontyne ньюкасл 纽卡斯尔",
    "newyork nyc нью-йорк ньюйорк 纽约 ニューヨーク",
    "nuremberg nuernberg nurnberg norimberga нюрнберг 纽伦堡 ニュルンベルク νυρεμβεργη",
    "oakland окленд 奥克兰 オークランド",
    "paris парис париж 巴黎 パリ parigi",
    "perama περαμα",
    "perth перт 珀斯",
    "prague praha prag прага",
    "qingdao tsingtao tsingtau 青岛 青島",
    "rome roma rom рим 罗马",
    "santabarbara санта-барбара",
    "seattle сиэтл 西雅图 西雅圖 シアトル σιατλ سياتل 시애틀 סיאטל",
    "seville sevilla севилья",
    "shanghai 上海 шанхай",
    "stpetersburg saintpetersburg санктпетербург petersburg",
    "tempe темпе",
    "scottsdale скотсдейл",
    "tokyo tokio 東京 东京 токио",
    "turin torino турин",
    "vaduz вадуц 瓦杜兹 ファドゥーツ βαντουζ",
    "vienna wien vienne вена 维也纳 ウィーン",
    "warsaw warszawa warschau варшава",
    "zaragoza saragossa",
    "zurich zuerich цюрих 苏黎世",
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
LIE li fl liechtenstein
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
_MORE_COUNTRY_NAMES = """
ALB albanien albanie albania shqiperia shqiperi shqipëria албания αλβανια 阿尔巴尼亚 アルバニア
ARE vae emirates unitedarabemirates vereinigtearabischeemirate
ARG аргентина 阿根廷 アルゼンチン
AUS австралия 澳大利亚 澳洲 オーストラリア αυστραλια
AUT autriche austria австрия 奥地利 オーストリア αυστρια
BEL бельгия 比利时 ベルギー
BGR bulgarien bulgarie bulgaria българия болгария
BIH bosnia bosnien bosnie
BRA brésil бразилия 巴西 ブラジル
CAN канада 加拿大 カナダ
CHE швейцария 瑞士 スイス svizra ελβετια
CHL chili чили 智利
CHN zhongguo китай 中国 中國 kina chine cina κινα الصين
CZE ceskarepublika tschechischerepublik чехия 捷克
DEU bundesrepublikdeutschland brd германия 德国 德國 ドイツ tyskland
DEU almanya γερμανια 독일 ألمانيا германия гермaния tedesca deutsch
DNK дания 丹麦 デンマーク
EGY aegypten egypte egypt egipto
ESP испания 西班牙 スペイン ισπανια
EST estland estonia eesti
FIN suomi finlande финляндия 芬兰
FRA франция 法国 フランス francia frankrike frankrijk fransa γαλλια 프랑스
GBR grossbritannien grandebretagne royaumeuni reinounido regnounito vereinigteskoenigreich
GBR великобритания англия 英国 英國 イギリス britain
GBR scotland wales northernireland schottland ingiltere
GRC grece grecia греция 希腊 ギリシャ hellas
HND honduras гондурас 洪都拉斯 ホンジュラス
HRV hrvatska croatie croacia хорватия
HUN magyarorszag hongrie венгрия
IND inde индия 印度 インド bharat
IRL eire irlande ирландия 爱尔兰
ISL island iceland islande
ISR israel израиль
ITA италия 意大利 イタリア ιταλια
JPN japon japan япония 日本 giappone nippon nihon 일본 ιαπωνια
KOR suedkorea coreedusud корея 韩国 韓国 대한민국 한국
LIE liechtenstein лихтенштейн 列支敦士登 リヒテンシュタイン
LTU litauen lithuania lietuva
LUX люксембург
LVA lettland latvia latvija
MCO monaco монако 摩纳哥 モナコ principautedemonaco μονακο
MEX mexique мексика 墨西哥 メキシコ
MKD northmacedonia nordmazedonien macedonia
NLD niederlande paesibassi нидерланды голландия 荷兰 オランダ
NOR норвегия 挪威
NZL neuseeland nouvellezelande
POL pologne polonia польша 波兰 ポーランド
PRT portogallo португалия 葡萄牙
ROU roumanie rumania румыния 罗马尼亚
RUS rossiya россия 俄罗斯 ロシア russie rusia
SRB serbia serbien srbija
SVN slovenija slowenien
SWE suede suecia швеция 瑞典
THA thailand
TUR turquie turchia турция 土耳其 トルコ
UKR украина україна
USA usa etatsunis estadosunidos statiuniti сша соединенныештаты
USA 美国 美國 アメリカ theunitedstates unitedstatesamerica ηπα 미국
VIR usvirginislands virginislands jungferninseln amerikanischejungferninseln
VNM vietnam
XKX kosovo
"""
"""Names of countries in further languages; a line adds to what is known."""
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
    for line in (_COUNTRY_NAMES + _MORE_COUNTRY_NAMES).split("\n"):
        code, *names = line.split() or [""]
        for key in (code.casefold(), *(fold(name) for name in names)):
            codes.setdefault(key, code)
    from iso3166 import countries

    for country in countries:
        for text in (country.alpha3, country.alpha2, country.name, country.apolitical_name, country.name.split(",")[0]):
            codes.setdefault(fold(text.partition("(")[0]), country.alpha3)
    return codes


@lru_cache(maxsize=50_000)
def latin(text: str) -> str:
    """A text as its sound is written in Latin letters and digits, without accents and digraphs for umlauts."""
    folded = fold(text)
    if not folded.isascii():
        from anyascii import anyascii

        folded = fold(anyascii(unicodedata.normalize("NFC", text).casefold()))
    return _without_digraphs(folded).replace("aa", "a")


@lru_cache(maxsize=50_000)
def place_keys(text: str) -> frozenset[str]:
    """All keys that a place may be known by; two spellings mean the same place where they share one.

    ``Mölln``, ``Moelln`` and ``Molln`` share a key, as do ``München`` and ``Munich``.
    """
    lowered = unicodedata.normalize("NFC", text).casefold()
    spellings = {fold(lowered), fold(lowered.translate(_UMLAUTS))}
    spellings |= {_without_digraphs(spelling) for spelling in spellings} | {latin(text)}
    for keys in _city_keys():
        if not spellings.isdisjoint(keys):
            spellings |= keys
    return frozenset(spelling for spelling in spellings if spelling)


def country_code(text: str) -> str | None:
    """ISO 3166-1 alpha-3 of a code or a name in several languages; None for anything else."""
    wanted = {fold(text), fold(text.casefold().translate(_UMLAUTS))}
    known = sorted(code for key in wanted - {""} if (code := _codes().get(key)) is not None)
    return known[0] if known else None


def country_name(code: str) -> str:
    """The English name of a country by its ISO 3166-1 alpha-3 code; the code itself where there is none."""
    from iso3166 import countries_by_alpha3

    country = countries_by_alpha3.get(code)
    return code if country is None else country.apolitical_name


def _without_digraphs(spelling: str) -> str:
    return spelling.replace("ae", "a").replace("oe", "o").replace("ue", "u")
