"""Local map services, with drawn towns of the package placed anywhere on earth."""

from pathlib import Path

from benchmarks.maps.extracts import Extract
from benchmarks.maps.loopback import MapServers, Mirror, Place, places_in, settlement
from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.schemas.maps import MapServices

HERE = (48.0, 11.0)


def drawn_town(file: str, middle: tuple[float, float] = HERE, first_id: int = 0) -> Extract:
    """Return a drawn map of the package, moved and with raised ids, because two drawn maps share theirs."""
    town = Extract.read(LIBRARY / file, middle=middle, nameless=True)
    town.nodes = {first_id + key: node for key, node in town.nodes.items()}
    town.ways = {
        first_id + key: (tuple(first_id + node for node in nodes), tags) for key, (nodes, tags) in town.ways.items()
    }
    return town


def town_places(name: str, extract: Extract, country: str = "DEU") -> list[Place]:
    """Return Nominatim's entries for it."""
    return [settlement([name], country, extract.box), *places_in(extract, name, country)]


def town_servers(
    name: str = "Ringstadt", file: str = "kreiselheim.osm", mirrors: tuple[Mirror, ...] = (Mirror("one"), Mirror("two"))
) -> MapServers:
    """Run services that know one town."""
    extract = drawn_town(file)
    return MapServers([extract], town_places(name, extract), mirrors)


def services_of(servers: MapServers, cache: Path, **more: object) -> MapServices:
    """Return the services as settings give them, without pauses."""
    given: dict[str, object] = {
        "mode": "online",
        "nominatim_url": servers.nominatim,
        "overpass_urls": servers.mirrors,
        "user_agent": "PlannerForge tests",
        "cache": str(cache),
        "delay_s": 0.0,
        "timeout_s": 5.0,
        **more,
    }
    return MapServices.model_validate(given)
