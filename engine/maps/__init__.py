"""Maps: OpenStreetMap extracts and SUMO networks, what they show, and cutting a site out of them.

``cut_map``: Write the roads of the given classes within a circle around (latitude, longitude) as an .osm file.
``cut_net``: Write the roads of the given classes that come within a circle around (latitude, longitude) as a network.
``read_map``: Read an OpenStreetMap extract or a SUMO network and say what is in it.
``Box``: TODO.
``MapEntry``: A map at hand.
``MapMatch``: A map that shows the wished place.
``SeenFile``: A file of a map folder.
``SeenFiles``: The files seen so far by path.
``built_in_maps``: The maps that come with the package, by id.
``find_maps``: All maps that fit.
``NetMap``: A network as a map.
``read_map_file``: Scan and read a map of either kind.
``OsmMap``: An extract.
``ground_distance_m``: Distance in m of two (latitude, longitude) pairs in degrees (equirectangular).
``write_as_xml``: Write a binary extract as XML into a folder.
``country_code``: ISO 3166-1 alpha-3 of a code or a name.
``fold``: Lower case, without accents, and only letters and digits.
``place_keys``: All keys that a place may be known by.
``LINKS``: TODO.
``ROADS``: TODO.
``resolve_road_classes``: The ``highway`` values that groups (roads, link, all) and values name together, each once.
``RURAL_CLASSES``: TODO.
``Site``: A place in a map.
``SiteFinder``: Finds the sites of one map.
``MAP_ENDINGS``: TODO.
``is_binary``: Whether a file is an extract in OpenStreetMap's binary format by its name.
``is_map``: Whether a file is a map by its name.
``is_net``: Whether a file, not packed, is a SUMO network by its name.
``stored_name``: The name under which a map is kept, not packed.
``unpacked``: The map as a plain file.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .cut import cut_map as cut_map
    from .cut import cut_net as cut_net
    from .facts import read_map as read_map
    from .index import Box as Box
    from .index import MapEntry as MapEntry
    from .index import MapMatch as MapMatch
    from .index import SeenFile as SeenFile
    from .index import SeenFiles as SeenFiles
    from .index import built_in_maps as built_in_maps
    from .index import find_maps as find_maps
    from .map_file import NetMap as NetMap
    from .map_file import read_map_file as read_map_file
    from .osm import OsmMap as OsmMap
    from .osm import ground_distance_m as ground_distance_m
    from .osm import write_as_xml as write_as_xml
    from .places import country_code as country_code
    from .places import fold as fold
    from .places import place_keys as place_keys
    from .road_classes import LINKS as LINKS
    from .road_classes import ROADS as ROADS
    from .road_classes import resolve_road_classes as resolve_road_classes
    from .sites import RURAL_CLASSES as RURAL_CLASSES
    from .sites import Site as Site
    from .sites import SiteFinder as SiteFinder
    from .unpacking import MAP_ENDINGS as MAP_ENDINGS
    from .unpacking import is_binary as is_binary
    from .unpacking import is_map as is_map
    from .unpacking import is_net as is_net
    from .unpacking import stored_name as stored_name
    from .unpacking import unpacked as unpacked

__getattr__, __dir__ = lazy_face(__name__, __file__)
