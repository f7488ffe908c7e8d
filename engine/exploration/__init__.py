"""Explores parameter spaces of scenarios: searches for failures and reduces them to what is needed.

``FailureSearch``: a search for failures in a stratified space.
``Stratum``: a part of such a space.
``Point``: a proposal of the search.
``Score``: the score of a proposal.
``Archive``: the failures of a search by cell.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .archive import Archive
    from .search import FailureSearch, Point, Score, Stratum

__getattr__, __dir__ = lazy_face(__name__, __file__)
