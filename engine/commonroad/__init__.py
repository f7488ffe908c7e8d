"""CommonRoad files: read without trust, written with what is untouched as it was; names of benchmarks.

``parse_benchmark_id``: country and place of a benchmark id; refuses what does not follow COUNTRY_Place.
``follows_naming``: whether country and place can be read from a benchmark id by CommonRoad's naming.
``derived_benchmark_id``: The base's id with a prediction number made of the recipe's digest (hexadecimal).
``friction_of``: The coefficient of friction of a document's roads as it is written; None if it states none.
``set_friction``: State the coefficient of friction of a document's roads.
``prescribed_ids``: Ids of the road users of a file whose motion an edit prescribes.
``script_texts``: What a file says of the motion of road users that depends on the ego.
``without_scripts``: Take out what a document says of motions that depend on the ego.
``ScenarioDocument``: The XML tree of a scenario file, with what edits replace in it.
``schema_errors``: What CommonRoad's own XML schema (2020a) and the naming of benchmarks find wrong with a file.
``schema_faults``: What CommonRoad's schema (2020a) finds wrong with a file's tree, with the places in the file.
``LoadedScenario``: A CommonRoad scenario in memory, with its planning problems and the file it came from.
``RecordedScenario``: A scenario with its recording as tracks.
``XmlLimits``: What an XML file may hold at most before any parser of a library sees it.
``kept_recording``: A CommonRoad file as ``read_recorded`` reads it, once for the same content.
``read_recorded``: Read a CommonRoad file (2018b or 2020a) with its recording as arrays in place of objects.
``read_scenario``: Scan and read a CommonRoad file (2018b or 2020a).
``scan_xml``: Refuse an XML file that is too large, too deep, broken or declares a document type; its root element.
``LaneletElement``: A lanelet as written.
``RoadDocument``: The network of one file in the file's order, defects included.
``read_road_document``: Scan a CommonRoad file and read its network as written.
``road_document``: The network below the root element of a CommonRoad document.
``Track``: A recorded obstacle: centre in m, heading in rad and speed in m/s at every step.
``center_of``: A point's or region's centre (2,) in m, without its height.
``last_recorded_step``: The last time step at which any obstacle is recorded.
``middle_of``: A value as it is, or the middle of an interval.
``recorded_tracks``: Tracks of all dynamic obstacles that carry a trajectory, by id in ascending order.
``static_tracks``: Static obstacles as tracks that stand still, by id in ascending order.
``size_of``: Length and width in metres of a CommonRoad shape.
``SPEED_LIMITS``: Numbers of the signs for a speed limit or the beginning of a zone with one, of all countries.
``ego_class_instruction``: The processing instruction that says, in a planning problem, what the ego is.
``has_light``: Whether one of these lanelets refers to a traffic light of the file.
``is_known_number``: Whether CommonRoad's reader knows a sign's number in a country.
``limits_kmh``: Posted speed limits in km/h, ascending, rounded to 0.1.
``limits_mps``: The speed limits in m/s that a sign posts; empty for all other signs.
``sign_keys``: The keys of all signs in the vocabulary, sorted, each once.
``signs_of``: The signs that these lanelets refer to.
``speed_limit_number``: The number to write for a speed limit in a country; None where CommonRoad has none.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .benchmark_id import derived_benchmark_id, follows_naming, parse_benchmark_id
    from .document import (
        ScenarioDocument,
        ego_class_instruction,
        friction_of,
        prescribed_ids,
        schema_errors,
        schema_faults,
        script_texts,
        set_friction,
        without_scripts,
    )
    from .reader import (
        LoadedScenario,
        RecordedScenario,
        XmlLimits,
        kept_recording,
        read_recorded,
        read_scenario,
        scan_xml,
    )
    from .road_elements import LaneletElement, RoadDocument, read_road_document, road_document
    from .tracks import Track, center_of, last_recorded_step, middle_of, recorded_tracks, size_of, static_tracks
    from .traffic_signs import (
        SPEED_LIMITS,
        has_light,
        is_known_number,
        limits_kmh,
        limits_mps,
        sign_keys,
        signs_of,
        speed_limit_number,
    )

__getattr__, __dir__ = lazy_face(__name__, __file__)
