"""The catalogue of scenarios: strict filters in SQLite, ranking by text, and the starter scenarios.

``download``: returns the path of the file at an address, checked by its SHA-256.
``unpack``: a context with a temporary folder of the XML files in an archive.
``scenario_facets``: returns the number of scenarios, and counts of places, tags, features, signs and obstacles.
``ID_TAKEN``: the reason for refusing a scenario with an id that is already taken.
``ReadFile``: a file with its SHA-256 and, if its content is new, its facts.
``ScenarioIntake``: decides on the files of an import and stores them: new, known, or new versions of a scenario.
``exported_net``: returns the SUMO network next to a scenario file, or None.
``put_scenario``: stores a scenario with known facts, and returns its artifact.
``judge_odd``: the operation that returns what scenarios and runs cover of an operational design domain.
``odd_values``: returns what an operational design domain can restrict of a scenario, by name.
``build_index``: the operation that loads the embedding model and builds the text index.
``rank``: the operation that returns scenario ids by similarity of their descriptions to a text, with scores.
``is_place``: returns whether a scenario's place is real.
``known_places``: returns the catalogue's countries, and its places with the country of each.
``Postings``: the entries that satisfy conditions, kept in memory while the catalogue is unchanged.
``Ranking``: scenario ids by similarity of their text, best first, with their scores.
``manoeuvres_in``: returns the manoeuvres that a text mentions, such as ``cut_in:truck``.
``Search``: a search against the tables of the catalogue, with its answer.
``entries_of``: returns the entries with these numbers.
``ARCHIVE``: the name of the archive with the starter scenarios.
``starter_files``: a context with some of the starter scenarios as files.
``open_catalogue``: prepares the catalogue of a workspace, including the starter scenarios.
``MOST_ENTRIES``: the maximum number of planning problems entered per file, and the difference between the numbers of
two consecutive artifacts.
``is_ready``: returns whether the tables exist in the current version.
``listed_facts``: yields the facts of the listed scenarios.
``EmbeddingModel``: a model that turns texts into vectors, identified by its name in the setting.
``damaged_parts``: returns the files and generations of a text index that cannot be read.
``remove_damaged``: removes and returns the damaged parts, so that they are rebuilt.
``description_of``: describes a scenario in a few plain sentences, based on its facts.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .archives import download, unpack
    from .constraints import is_place, known_places
    from .entry_sets import Postings
    from .facets import scenario_facets
    from .intake import ID_TAKEN, ReadFile, ScenarioIntake, exported_net, put_scenario
    from .odd import judge_odd, odd_values
    from .ranking import build_index, rank
    from .search import Ranking, Search, entries_of
    from .starter import ARCHIVE, open_catalogue, starter_files
    from .tables import MOST_ENTRIES, is_ready, listed_facts
    from .text_conditions import manoeuvres_in
    from .vector_index import EmbeddingModel, damaged_parts, remove_damaged
    from .words import description_of

__getattr__, __dir__ = lazy_face(__name__, __file__)
