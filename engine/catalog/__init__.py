"""The catalogue: strict filters in SQLite, ranking by text, the starter scenarios.

``download``: The file behind the address, from the folder where it was fetched before.
``unpack``: A temporary folder with the XML files of the archive, whatever folders they lay in.
``scenario_facets``: Number of scenarios, and the facets ``places``, ``tags``, ``features``, ``road_net``,
    ``obstacles``.
``rank``: The candidates ordered by likeness of their descriptions to the text.
``Ranking``: Scenario ids by likeness of their text, best first, with their scores.
``Search``: A search against the catalogue's tables.
``entries_of``: These entries in the alphabetical order of their ids.
``FileFailure``: Why a file was not taken in: an error of ours or of the operating system.
``ReadFile``: A file with its SHA-256 and, where its content is new, its facts.
``ScenarioIntake``: Decides on the files of an import and stores them: new, known, or new versions of a scenario.
``put_scenario``: The stored artifact of a scenario whose facts are known.
``ARCHIVE``: TODO.
``open_catalogue``: Make the catalogue ready.
``MOST_ENTRIES``: Planning problems of one file that are entered, and the step of the numbers between two artifacts.
``add_facts``: Enter one entry.
``describe``: A few plain sentences.
``descriptions``: The readable description of every scenario, by id in alphabetical order.
``facts_of``: The facts of these scenarios.
``is_ready``: Whether the tables exist in this version.
``prepare``: Make the tables.
``summary``: One line.
``family``: All versions that hang together with this stored one, in the order in which they were added.
``list_again``: List an earlier version in place of the later ones.
``listed_version``: The version of this scenario that the catalogue lists.
``refresh``: Enter the scenarios that are stored but not yet in the tables.
``COMPLETE``: TODO.
``EmbeddingModel``: A model by its name in the setting.
``Vectors``: TODO.
``ensure_generation``: The complete generation for these texts, built if it is not there.
``query``: The nearest scenarios with their cosine likeness in [−1, 1], best first.
``build_index``: An operation: loads the embedding model and builds the text index.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .archives import download as download
    from .archives import unpack as unpack
    from .facets import scenario_facets as scenario_facets
    from .intake import FileFailure as FileFailure
    from .intake import ReadFile as ReadFile
    from .intake import ScenarioIntake as ScenarioIntake
    from .intake import put_scenario as put_scenario
    from .ranking import build_index as build_index
    from .ranking import rank as rank
    from .search import Ranking as Ranking
    from .search import Search as Search
    from .search import entries_of as entries_of
    from .starter import ARCHIVE as ARCHIVE
    from .starter import open_catalogue as open_catalogue
    from .tables import MOST_ENTRIES as MOST_ENTRIES
    from .tables import add_facts as add_facts
    from .tables import describe as describe
    from .tables import descriptions as descriptions
    from .tables import facts_of as facts_of
    from .tables import is_ready as is_ready
    from .tables import prepare as prepare
    from .tables import summary as summary
    from .updates import family as family
    from .updates import list_again as list_again
    from .updates import listed_version as listed_version
    from .updates import refresh as refresh
    from .vector_index import COMPLETE as COMPLETE
    from .vector_index import EmbeddingModel as EmbeddingModel
    from .vector_index import Vectors as Vectors
    from .vector_index import ensure_generation as ensure_generation
    from .vector_index import query as query

__getattr__, __dir__ = lazy_face(__name__, __file__)
