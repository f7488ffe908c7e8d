"""Maps: reads OpenStreetMap extracts, SUMO and lanelet networks, finds their sites, and cuts a site out of them.

``cut_map``: Writes the roads of an extract within a circle as an .osm file; returns the ways written.
``cut_net``: Writes the roads of a SUMO network within a circle as a network; returns netconvert's warnings.
``index_extract``: An operation that reads an extract of a country into tiles, or resumes that work.
``cut_extract``: An operation that writes the part of an extract that a request refers to as a map.
``Pavements``: The sides of roads with pavements, mapped or guessed, and the crossings that the map marks.
``find_pavements``: Finds the pavements of roads within a circle around a point.
``read_map``: An operation that returns the facts of a map file, including its place and country.
``country_at``: Returns the country at a position of a map.
``MapEntry``: An available map: its facts and its file.
``Closeness``: How closely a text must match the names on a map.
``file_stem``: Returns a file's name without the extensions of map files.
``names_elsewhere``: Returns the keys of a place and of its names in other languages.
``settlements_called``: Returns the settlements of the world that have a name, largest first.
``MapMatch``: A map that contains the requested place, with the streets that the site must be on.
``SeenFile``: The result of reading a file in a map folder: the map's id, or the reason why the file was refused.
``SeenFiles``: The results for all files read in map folders, stored in the database.
``built_in_maps``: Returns the maps that come with the package, by id.
``place_parts``: Splits the text of a place at commas and at the words for an intersection.
``NOT_SHOWN``: The refusal's reason if no map shows the place, the country or the box.
``find_maps``: Finds the maps that fit a place, a country, a box and a type of site, best first.
``LaneletMap``: The lanelet network of a CommonRoad file as a map.
``convert_roads``: An operation that writes an OpenDRIVE, Lanelet2 or CommonRoad file as a readable map.
``foreign_format``: Returns the format of a map that needs conversion before it can be read; None for any other map.
``RoadFile``: The content that a scenario takes over from a stored map: elements of its roads, location, tags.
``cut_lanelets``: Writes the lanelets of a large network within a circle, with their signs and lights.
``read_lanelet_map``: Reads the network of a CommonRoad file as a map.
``NetMap``: A SUMO network as a map.
``read_map_file``: Scans and reads the map in a file of any supported format.
``site_finder``: Returns the finder of sites on a map; the finder of the last map read is reused.
``ground_distance_m``: Returns the distance in m between two positions in degrees.
``OsmMap``: An OpenStreetMap extract as nodes, ways and relations.
``OsmWay``: A way of an extract: its tags and the ids of its nodes.
``fetch_maps``: An operation that fetches the roads of a place or box from Overpass.
``locate_place``: An operation that resolves the name of a place through Nominatim.
``match_fetched``: Returns a match of a fetched map with the requested place.
``NOT_SHOWN``: The refusal's reason if no map shows the place, the country or the box.
``write_as_xml``: An operation that writes a binary extract (.osm.pbf) as XML into a folder.
``Gathering``: Positions, no two of them closer together than a given distance.
``country_code``: Returns the ISO 3166-1 alpha-3 code for a code or a name in any of several languages, or None.
``countries_spelt_like``: Returns the codes of countries with a similarly spelt name in any language.
``country_name``: Returns the English name of a country by its ISO 3166-1 alpha-3 code.
``fold``: Reduces a text to lower-case letters and digits without accents.
``place_keys``: Returns all keys of a place's name; two spellings mean the same place if they share a key.
``ALL_ROADS``: OSM's road classes that vehicles use, including links.
``ARMS_OF_A_CROSSING``: Minimum number of arms of a junction at which one-way roads cross.
``EXPRESSWAY_KMH``: Minimum speed limit of a one-way trunk road that counts as an expressway, in km/h.
``FAST_ROADS``: OSM's road classes of motorways and similar roads.
``LINKS``: OSM's road classes of slip roads.
``MARKED_BY_NODES``: The kinds of sites that a node marks; ways mark the others.
``RAMP_LINKS``: OSM's road classes of the links of fast roads.
``ROADS``: OSM's road classes that vehicles use, without links.
``resolve_road_classes``: Returns the road classes that groups (roads, link, all) and class names refer to, each once.
``RURAL_CLASSES``: OSM's road classes of main roads outside towns.
``jurisdiction_of``: Returns the country and states at a position, by their names in the table of legal limits.
``RoadReader``: Writes the tags of a site's roads in the form that netconvert reads, and reports omissions.
``Site``: A place on a map: type, centre in degrees, streets, and the node or way that marks it.
``SitePart``: One of the positions that were merged into a site.
``LONGEST_RING_M``: Maximum length around a roundabout in m.
``SiteFinder``: Finds the sites of one map by type.
``MAP_ENDINGS``: File-name extensions of maps.
``is_binary``: Returns whether a file's name is that of a binary extract.
``is_large``: Returns whether a file is a binary extract that must be read into tiles.
``is_map``: Returns whether a file's name is that of a map.
``is_net``: Returns whether a file's name is that of an uncompressed SUMO network.
``named_by_content``: Returns a map under a name with the extension of its format.
``root_element``: Returns the root element of a file if it is that of a map format.
``stored_name``: Returns the name under which a map is stored, uncompressed.
``unpacked``: Returns a map as a plain file, unpacked into a folder if it is compressed.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .extracts.cutting import cut_extract
    from .extracts.indexing import index_extract
    from .facts import country_at, read_map
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
    from .osm import OsmMap, OsmWay, ground_distance_m, write_as_xml
    from .road_classes import ALL_ROADS, FAST_ROADS, LINKS, RAMP_LINKS, ROADS, RURAL_CLASSES, resolve_road_classes
    from .site_roads.cut import cut_map, cut_net
    from .site_roads.jurisdictions import jurisdiction_of
    from .site_roads.pavements import Pavements, find_pavements
    from .site_roads.road_reader import RoadReader
    from .site_search.finder import ARMS_OF_A_CROSSING, EXPRESSWAY_KMH, MARKED_BY_NODES, Site, SiteFinder, SitePart
    from .site_search.nearness import Gathering
    from .site_search.rings import LONGEST_RING_M
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
