"""States and provinces that people name beside a city (``Seattle, WA``), each with the box it lies in.

The boxes are rounded outwards to a tenth of a degree: what lies outside is not there, what lies inside may be.
"""

from functools import cache

from .places import fold

_REGIONS = """
USA al alabama 30.1 -88.6 35.1 -84.8
USA ak alaska 51.0 -180 71.6 -129.9
USA az arizona 31.3 -114.9 37.1 -109.0
USA ar arkansas 33.0 -94.7 36.6 -89.6
USA ca california kalifornien 32.5 -124.6 42.1 -114.1
USA co colorado 36.9 -109.1 41.1 -102.0
USA ct connecticut 40.9 -73.8 42.1 -71.7
USA de delaware 38.4 -75.8 39.9 -75.0
USA dc districtofcolumbia 38.7 -77.2 39.0 -76.9
USA fl florida 24.3 -87.7 31.1 -79.9
USA ga georgia 30.3 -85.7 35.1 -80.7
USA hi hawaii 18.8 -160.6 22.3 -154.7
USA id idaho 41.9 -117.3 49.1 -111.0
USA il illinois 36.9 -91.6 42.6 -87.0
USA in indiana 37.7 -88.2 41.8 -84.7
USA ia iowa 40.3 -96.7 43.6 -90.1
USA ks kansas 36.9 -102.1 40.1 -94.5
USA ky kentucky 36.4 -89.6 39.2 -81.9
USA la louisiana 28.8 -94.1 33.1 -88.7
USA me maine 42.9 -71.1 47.5 -66.9
USA md maryland 37.8 -79.5 39.8 -75.0
USA ma massachusetts 41.1 -73.6 42.9 -69.8
USA mi michigan 41.6 -90.5 48.4 -82.1
USA mn minnesota 43.4 -97.3 49.5 -89.4
USA ms mississippi 30.0 -91.7 35.1 -88.0
USA mo missouri 35.9 -95.8 40.7 -89.0
USA mt montana 44.3 -116.1 49.1 -104.0
USA ne nebraska 39.9 -104.1 43.1 -95.3
USA nv nevada 34.9 -120.1 42.1 -114.0
USA nh newhampshire 42.6 -72.6 45.4 -70.5
USA nj newjersey 38.8 -75.6 41.4 -73.8
USA nm newmexico 31.3 -109.1 37.1 -102.9
USA ny newyork newyorkstate 40.4 -79.8 45.1 -71.8
USA nc northcarolina 33.7 -84.4 36.6 -75.4
USA nd northdakota 45.9 -104.1 49.1 -96.5
USA oh ohio 38.3 -84.9 42.4 -80.5
USA ok oklahoma 33.6 -103.1 37.1 -94.4
USA or oregon 41.9 -124.7 46.3 -116.4
USA pa pennsylvania 39.7 -80.6 42.6 -74.6
USA ri rhodeisland 41.1 -71.9 42.1 -71.1
USA sc southcarolina 32.0 -83.4 35.3 -78.4
USA sd southdakota 42.4 -104.1 46.0 -96.4
USA tn tennessee 34.9 -90.4 36.7 -81.6
USA tx texas 25.8 -106.7 36.6 -93.5
USA ut utah 36.9 -114.1 42.1 -109.0
USA vt vermont 42.7 -73.5 45.1 -71.4
USA va virginia 36.5 -83.7 39.5 -75.2
USA wa washington washingtonstate 45.5 -124.9 49.1 -116.9
USA wv westvirginia 37.2 -82.7 40.7 -77.7
USA wi wisconsin 42.4 -92.9 47.4 -86.2
USA wy wyoming 40.9 -111.1 45.1 -104.0
AUS wa westernaustralia westaustralien -35.2 112.9 -13.6 129.1
AUS sa southaustralia -38.1 128.9 -25.9 141.1
AUS nt northernterritory -26.1 128.9 -10.9 138.1
AUS qld queensland -29.2 137.9 -9.9 153.7
AUS nsw newsouthwales -37.6 140.9 -28.1 153.7
AUS vic victoria -39.3 140.9 -33.9 150.1
AUS tas tasmania tasmanien -43.8 143.7 -39.4 148.6
GBR england 49.8 -6.5 55.9 1.9
GBR scotland schottland 54.5 -9.3 61.0 -0.6
GBR wales cymru 51.3 -5.5 53.5 -2.6
GBR northernireland 53.9 -8.3 55.4 -5.3
DEU bw badenwuerttemberg 47.5 7.4 49.9 10.6
DEU by bayern bavaria baviera baviere бавария 47.2 8.9 50.6 13.9
DEU berlin 52.3 13.0 52.7 13.8
DEU bb brandenburg 51.3 11.2 53.6 14.8
DEU bremen 53.0 8.4 53.7 9.0
DEU hamburg 53.3 8.4 54.0 10.4
DEU he hessen hesse 49.3 7.7 51.7 10.3
DEU mv mecklenburgvorpommern 53.1 10.5 54.8 14.5
DEU ni niedersachsen lowersaxony 51.2 6.6 54.0 11.6
DEU nrw nordrheinwestfalen northrhinewestphalia 50.3 5.8 52.6 9.5
DEU rp rheinlandpfalz rhinelandpalatinate 48.9 6.1 51.0 8.6
DEU sl saarland 49.1 6.3 49.7 7.5
DEU sn sachsen saxony 50.1 11.8 51.7 15.1
DEU st sachsenanhalt saxonyanhalt 50.9 10.5 53.1 13.2
DEU sh schleswigholstein 53.3 7.8 55.1 11.4
DEU th thueringen thuringia 50.2 9.8 51.7 12.7
"""
"""Country, names, and south, west, north, east in degrees."""


@cache
def _boxes() -> dict[str, tuple[tuple[str, tuple[float, ...]], ...]]:
    found: dict[str, tuple[tuple[str, tuple[float, ...]], ...]] = {}
    for line in _REGIONS.strip().splitlines():
        country, *words = line.split()
        for name in words[:-4]:
            found[fold(name)] = (*found.get(fold(name), ()), (country, tuple(map(float, words[-4:]))))
    return found


def region_of(text: str, country: str | None, latitude: float, longitude: float) -> bool:
    """Whether a text names a state or province of the country in whose box the position lies."""
    plain = text.casefold().replace("ü", "ue")
    return any(
        code == country and south <= latitude <= north and west <= longitude <= east
        for code, (south, west, north, east) in (*_boxes().get(fold(text), ()), *_boxes().get(fold(plain), ()))
    )


def regions_at(country: str, latitude: float, longitude: float) -> tuple[str, ...]:
    """The first names (``az``) of the states or provinces of a country in whose boxes a position lies."""
    lines = (line.split() for line in _REGIONS.strip().splitlines())
    return tuple(
        words[1]
        for words in lines
        if words[0] == country
        and float(words[-4]) <= latitude <= float(words[-2])
        and float(words[-3]) <= longitude <= float(words[-1])
    )
