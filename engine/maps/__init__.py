"""Maps: reads OpenStreetMap extracts, SUMO and lanelet networks, finds their sites, and cuts a site out of them.

``cut_map``: Write the roads within a circle of an extract as an .osm file; return the ways written.
``cut_net``: Write the roads of a SUMO network within a circle as a network; return netconvert's warnings.
``index_extract``: An operation: read an extract of a country into tiles, or resume that work.
``cut_extract``: An operation: write the part of an extract that a request refers to as a map.
``Pavements``: The sides of roads with pavements, from the map or by a guess, and the crossings that the map marks.
``find_pavements``: Find the pavements of roads within a circle around a point.
``read_map``: An operation: return the facts of a map file, including its place and country.
``MapEntry``: An available map: its facts and its file.
``Closeness``: How closely a text must match the names on a map.
``file_stem``: Return a file's name without the endings of maps.
``names_elsewhere``: Return the keys of a place and of its names in other languages.
``settlements_called``: Return the settlements of the world with a name, the largest first.
``MapMatch``: A map that shows the requested place, with the streets that a site there must be on.
``SeenFile``: The result of reading a file in a map folder: the id of a map, or the reason for its refusal.
``SeenFiles``: The files of map folders that were read, stored in the database.
``built_in_maps``: Return the maps that come with the package, by id.
``place_parts``: Split the text of a place at commas and at the words for a crossing.
``NOT_SHOWN``: The refusal's reason if no map shows the place, the country or the box.
``find_maps``: Find the maps that fit a place, a country, a box and a type of site, the best first.
``LaneletMap``: The lanelet network of a CommonRoad file as a map.
``convert_roads``: An operation: write an OpenDRIVE, Lanelet2 or CommonRoad file as a map that can be read.
``foreign_format``: Return the format of a map that needs conversion before it can be read, or None.
``RoadFile``: The content that a scenario takes over from a stored map: elements of its roads, location, tags.
``cut_lanelets``: Write the lanelets of a large network within a circle, with their signs and lights.
``read_lanelet_map``: Read the network of a CommonRoad file as a map.
``NetMap``: A SUMO network as a map.
``read_map_file``: Scan and read the map in a file of any supported format.
``site_finder``: Return the finder of sites on a map; for the last map read, reuse its finder.
``ground_distance_m``: Return the distance in m between two positions in degrees.
``OsmMap``: An OpenStreetMap extract as nodes, ways and relations.
``fetch_maps``: An operation: fetch the roads of a place or box from Overpass.
``locate_place``: An operation: resolve the name of a place through Nominatim.
``match_fetched``: Return a fetched map as one that shows the requested place.
``NOT_SHOWN``: The refusal's reason if no map shows the place, the country or the box.
``write_as_xml``: An operation: write a binary extract (.osm.pbf) as XML into a folder.
``Gathering``: Positions, no two of them closer together than a given distance.
``country_code``: Return the ISO 3166-1 alpha-3 code for a code or a name in several languages, or None.
``countries_spelt_like``: Return the codes of countries with a similarly spelt name in any language.
``country_name``: Return the English name of a country by its ISO 3166-1 alpha-3 code.
``fold``: Reduce a text to lower-case letters and digits without accents.
``place_keys``: Return all keys of a place's name; two spellings mean the same place if they share one.
``ALL_ROADS``: OSM's road classes that vehicles use, including links.
``EXPRESSWAY_KMH``: Minimum speed limit of a one-way trunk road that counts as an expressway, in km/h.
``FAST_ROADS``: OSM's road classes of motorways and similar roads.
``LINKS``: OSM's road classes of slip roads.
``RAMP_LINKS``: OSM's road classes of the links of fast roads.
``ROADS``: OSM's road classes that vehicles use, without links.
``resolve_road_classes``: Return the road classes that groups (roads, link, all) and classes stand for, each once.
``RURAL_CLASSES``: OSM's road classes of main roads outside towns.
``jurisdiction_of``: Return the country and states at a position, with the names in the table of legal limits.
``RoadReader``: Writes the tags of a site's roads as netconvert reads them, and reports what it left out.
``Site``: A place on a map: type, centre in degrees, streets, and the node or way that marks it.
``SitePart``: One of the places that a site was merged from.
``SiteFinder``: Finds the sites of one map by their type.
``MAP_ENDINGS``: File-name endings of maps.
``is_binary``: Return whether a file's name is that of a binary extract.
``is_large``: Return whether a file is a binary extract that must be read into tiles.
``is_map``: Return whether a file's name is that of a map.
``is_net``: Return whether a file's name is that of an uncompressed SUMO network.
``named_by_content``: Return a map under a name with the ending of its format.
``root_element``: Return the root element of a file, as far as map formats have it.
``stored_name``: Return the name under which a map is stored, uncompressed.
``unpacked``: Return a map as a plain file, unpacked into a folder if it is compressed.
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
