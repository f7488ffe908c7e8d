"""Corpora from what a workspace holds: requests in several styles, with ground truth by code.

``make_corpora``: requests for every task about the scenarios and maps at hand.
``read_materials``: the scenarios and maps of a workspace.
``write_corpora``: write requests as corpus files, whole or split by scenario.
"""

from typing import TYPE_CHECKING

from ....engine import lazy_face

if TYPE_CHECKING:
    from .corpus import make_corpora, write_corpora
    from .materials import read_materials

__getattr__, __dir__ = lazy_face(__name__, __file__)
