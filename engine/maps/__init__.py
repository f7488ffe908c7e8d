"""Maps: OpenStreetMap extracts and SUMO networks, what they show, and cutting a site out of them.

``cut_map``: Write the roads within a circle of an extract as an .osm file; returns the ways written.
``cut_net``: Write the roads of a SUMO network that come within a circle as a network; netconvert's warnings.
``index_extract``: An operation: read an extract of a country into tiles, or go on where that broke off.
``cut_extract``: An operation: the part of an extract that a request means, as a map.
``Pavements``: On which sides roads have pavements, by the map or by a guess, and the crossings that the map marks.
``find_pavements``: The pavements of roads within a circle around a point.
``read_map``: An operation: the facts of a map file, its place and country among them.
``MapEntry``: A map at hand: its facts and its file.
``Closeness``: How near words must come to what a map shows.
``file_stem``: A file's name without the endings of maps.
``names_elsewhere``: The keys of a place, and of what it is called in other languages.
``settlements_called``: The settlements of the world that have a name, the largest first.
``MapMatch``: A map that shows an asked place, with the streets that a site there must carry.
``SeenFile``: What became of a file in a map folder: the id of a map, or why it was refused.
``SeenFiles``: The files of map folders that were looked at, kept in the database.
``built_in_maps``: The maps that come with the package, by id.
``place_parts``: What of the words for a place stands between commas, and around the words for a crossing.
``NOT_SHOWN``: Reason of a refusal because no map shows the place, the country or the box.
``find_maps``: The maps that fit a place, a country, a box and a type of site, the best first.
``LaneletMap``: The lanelet network of a CommonRoad file as a map.
``convert_roads``: An operation: write an OpenDRIVE, Lanelet2 or CommonRoad file as a map that is read.
``foreign_format``: The format of a map that has to be converted before it is read; None for the others.
``RoadFile``: What a scenario takes over from a kept map: elements of its roads, location, tags.
``cut_lanelets``: Write the lanelets of a large network that come within a circle, with what stands at them.
``read_lanelet_map``: Read the network of a CommonRoad file as a map.
``NetMap``: A SUMO network as a map.
``read_map_file``: The map in a file of either kind, scanned and read.
``site_finder``: The finder of sites on a map; of the map that was read last, the one that has searched it.
``ground_distance_m``: The distance in m between two positions in degrees.
``OsmMap``: An OpenStreetMap extract as nodes, ways and relations.
``fetch_maps``: An operation: fetch the roads of a place or box from Overpass.
``locate_place``: An operation: find out through Nominatim what place some words mean.
``match_fetched``: A fetched map as one that shows what was asked for.
``NOT_SHOWN``: Reason of a refusal because no map shows the place, the country or the box.
``write_as_xml``: An operation: write a binary extract (.osm.pbf) as XML into a folder.
``Gathering``: Positions of which no two lie closer together than a reach.
``country_code``: ISO 3166-1 alpha-3 of a code or a name in several languages; None for anything else.
``countries_spelt_like``: Codes of the countries with a name, in any language, that is spelt nearly so.
``country_name``: The English name of a country by its ISO 3166-1 alpha-3 code.
``fold``: A text in lower case, without accents, and only letters and digits.
``place_keys``: All keys of a spelling of a place; two spellings mean the same place where they share one.
``ALL_ROADS``: OSM's road classes that vehicles use, links included.
``EXPRESSWAY_KMH``: The least limit of a one-way trunk road that counts as an expressway.
``FAST_ROADS``: OSM's road classes of motorways and what drives like one.
``LINKS``: OSM's road classes of slip roads.
``RAMP_LINKS``: OSM's road classes of the links of fast roads.
``ROADS``: OSM's road classes that vehicles use, links left out.
``resolve_road_classes``: The road classes that groups (roads, link, all) and classes name together, each once.
``RURAL_CLASSES``: OSM's road classes of main roads outside towns.
``jurisdiction_of``: The country and the states in which a position lies, as the table of legal limits names them.
``RoadReader``: Writes the tags of a site's roads as netconvert reads them, and tells what it left out.
``Site``: A spot of a map: type, middle in degrees, streets, and the node or way that marks it.
``SitePart``: One of the spots that a site was merged of.
``SiteFinder``: Finds the sites of one map by their type.
``MAP_ENDINGS``: Endings of the names of map files.
``is_binary``: Whether a file is a binary extract by its name.
``is_large``: Whether a file is a binary extract that is read into tiles without trying to read it at once.
``is_map``: Whether a file is a map by its name.
``is_net``: Whether a file, not packed, is a SUMO network by its name.
``named_by_content``: A map under a name with the ending of its format.
``root_element``: The root element of a file as far as formats of maps have it.
``stored_name``: The name under which a map is kept, not packed.
``unpacked``: A map as a plain file, unpacked into a folder where it is compressed.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .extracts.cutting import cut_extract
    from .extracts.indexing import index_extract
    from .facts import read_map
    from .foreign.conversion import convert_roads
    from .foreign.lanelet_map import LaneletMap, RoadFile, cut_lanelets, read_lanelet_map
    from .foreign.net_map import NetMap
    from .index import (
        NOT_SHOWN,
        Closeness,
        MapEntry,
        MapMatch,
        SeenFile,
        SeenFiles,
        built_in_maps,
        file_stem,
        find_maps,
        match_fetched,
        place_parts,
    )
    from .map_file import read_map_file, site_finder
    from .naming.gazetteer import names_elsewhere, settlements_called
    from .naming.places import countries_spelt_like, country_code, country_name, fold, place_keys
    from .online.fetch import fetch_maps
    from .online.places import locate_place
    from .osm import OsmMap, ground_distance_m, write_as_xml
    from .road_classes import ALL_ROADS, FAST_ROADS, LINKS, RAMP_LINKS, ROADS, RURAL_CLASSES, resolve_road_classes
    from .site_roads.cut import cut_map, cut_net
    from .site_roads.jurisdictions import jurisdiction_of
    from .site_roads.pavements import Pavements, find_pavements
    from .site_roads.road_reader import RoadReader
    from .site_search.finder import EXPRESSWAY_KMH, Site, SiteFinder, SitePart
    from .site_search.nearness import Gathering
    from .unpacking import (
        MAP_ENDINGS,
        foreign_format,
        is_binary,
        is_large,
        is_map,
        is_net,
        named_by_content,
        root_element,
        stored_name,
        unpacked,
    )

__getattr__, __dir__ = lazy_face(__name__, __file__)
