"""The catalogue: strict filters in SQLite, ranking by text, the starter scenarios.

``download``: Fetch the file at an address, checked by its SHA-256; returns its path.
``unpack``: A context with a temporary folder of the XML files in an archive.
``scenario_facets``: The number of scenarios, and counts of places, tags, features, signs and obstacles.
``ID_TAKEN``: Reason of the refusal of a scenario whose id another one has.
``ReadFile``: A file with its SHA-256 and, where its content is new, its facts.
``ScenarioIntake``: Decides on the files of an import and stores them: new, known, or new versions of a scenario.
``net_beside``: The SUMO network that lies beside a scenario file; None where there is none.
``put_scenario``: The stored artifact of a scenario whose facts are known.
``build_index``: An operation: load the embedding model and build the text index.
``rank``: An operation: scenario ids by likeness of their descriptions to a text, with scores.
``is_place``: Whether a scenario's place is one of the world.
``known_places``: The countries and the places of the catalogue's scenarios, each with its country.
``Postings``: The entries that conditions hold for, kept in memory while the catalogue stays as it is.
``Ranking``: Scenario ids by likeness of their text, best first, with their scores.
``manoeuvres_in``: The manoeuvres that a text speaks of, such as ``cut_in:truck``.
``Search``: A search against the tables of the catalogue, with its answer.
``entries_of``: The entries of these numbers by their ids.
``ARCHIVE``: The name of the archive with the starter scenarios.
``starter_files``: A context with some of the starter scenarios as files.
``open_catalogue``: Make the catalogue of a workspace ready, starter scenarios included.
``MOST_ENTRIES``: Planning problems of one file that are entered, and the step of the numbers between two artifacts.
``is_ready``: Whether the tables exist in this version.
``EmbeddingModel``: A model that turns texts into vectors, by its name in the setting.
``damaged_parts``: The files and generations of a text index that cannot be read.
``remove_damaged``: Remove these, so that they are made anew; returns them.
``description_of``: A scenario in a few plain sentences, from its facts.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .archives import download, unpack
    from .constraints import is_place, known_places
    from .entry_sets import Postings
    from .facets import scenario_facets
    from .intake import ID_TAKEN, ReadFile, ScenarioIntake, net_beside, put_scenario
    from .ranking import build_index, rank
    from .said import manoeuvres_in
    from .search import Ranking, Search, entries_of
    from .starter import ARCHIVE, open_catalogue, starter_files
    from .tables import MOST_ENTRIES, is_ready
    from .vector_index import EmbeddingModel, damaged_parts, remove_damaged
    from .words import description_of

__getattr__, __dir__ = lazy_face(__name__, __file__)
