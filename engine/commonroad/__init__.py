"""Reads CommonRoad files as untrusted input, writes them with untouched parts unchanged, and names benchmarks.

``parse_benchmark_id``: Return the country and place of a benchmark id; reject ids that do not follow COUNTRY_Place.
``follows_naming``: Return whether a benchmark id has a readable country and place in CommonRoad's naming.
``derived_benchmark_id``: Return the base's id with a prediction number from the recipe's digest (hexadecimal).
``friction_of``: Return the friction coefficient of a document's roads as text, or None.
``set_friction``: Set the friction coefficient of a document's roads.
``prescribed_ids``: Return the ids of a file's road users that move as an edit prescribes.
``script_texts``: Return a file's scripts of motions that depend on the ego.
``without_scripts``: Remove a document's scripts of motions that depend on the ego.
``ScenarioDocument``: The XML tree of a scenario file; edits replace parts of it.
``schema_errors``: Return a file's violations of CommonRoad's XML schema (2020a) and of its naming of benchmarks.
``schema_faults``: Return the violations of CommonRoad's schema (2020a) by a file's tree, with their locations.
``EditedMotions``: What edits in memory prescribe: ids of road users, and scripts.
``MadeOnce``: What is derived from a scenario and made once, by key.
``PlainStates``: The states of a trajectory after the initial one, as arrays.
``LoadedScenario``: A CommonRoad scenario in memory, with its planning problems and its source file.
``RecordedScenario``: A scenario with its recording as tracks.
``XmlLimits``: Limits for an XML file before any library parses it.
``kept_recording``: Read a CommonRoad file like ``read_recorded``, once for the same content.
``read_recorded``: Read a CommonRoad file (2018b or 2020a) with its recording as arrays instead of objects.
``read_scenario``: Scan and read a CommonRoad file (2018b or 2020a).
``scan_xml``: Reject an XML file that is too large, too deep or broken, or has a document type; return its root element.
``LaneletElement``: A lanelet as written in the file.
``RoadDocument``: The network of one file, in file order and including defects.
``read_road_document``: Scan a CommonRoad file and read its network as written.
``road_document``: Return the network below the root element of a CommonRoad document.
``Track``: A recorded obstacle: centre in m, heading in rad and speed in m/s at every step.
``center_of``: Return the centre (2,) in m of a point or region, without its height.
``last_recorded_step``: Return the last time step at which any obstacle is recorded.
``middle_of``: Return a value, or the middle of an interval.
``recorded_tracks``: Return tracks of all dynamic obstacles with a trajectory, by id in ascending order.
``static_tracks``: Return static obstacles as tracks without motion, by id in ascending order.
``size_of``: Return length and width in m of a CommonRoad shape.
``SPEED_LIMITS``: Numbers of the signs for a speed limit or the beginning of a speed zone, of all countries.
``ego_class_instruction``: Return the processing instruction that states the ego's class in a planning problem.
``has_light``: Return whether one of these lanelets refers to a traffic light of the file.
``is_known_number``: Return whether CommonRoad's reader knows a sign's number in a country.
``limits_kmh``: Return posted speed limits in km/h, ascending, rounded to 0.1.
``limits_mps``: Return the speed limits in m/s that a sign posts; empty for all other signs.
``sign_keys``: Return the keys of all signs in the vocabulary, sorted, each once.
``signs_of``: Return the signs that the given lanelets refer to.
``speed_limit_number``: Return the sign number for a speed limit in a country, or None if CommonRoad has none.
``SHORTEST_M``: Minimum length and width in m of a drawn shape.
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
    from .made_once import MadeOnce
    from .plain_states import PlainStates
    from .reader import (
        EditedMotions,
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
    from .value_limits import SHORTEST_M

__getattr__, __dir__ = lazy_face(__name__, __file__)
