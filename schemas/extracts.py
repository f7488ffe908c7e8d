"""Extracts of whole countries: what their index is asked, and what it answers."""

from .base import Model
from .generation import MapFacts, ScenarioType
from .maps import Box

INDEX_NAME = "extract.sqlite"
"""The index of an extract in its folder."""


class IndexExtractRequest(Model):
    """An extract in OpenStreetMap's binary format that is to be read into tiles.

    ``folder`` keeps what was done when the work breaks off: the same request goes on there.
    """

    path: str
    folder: str
    map_id: str
    place: str | None = None
    country: str | None = None


class IndexedExtract(Model):
    """The index of an extract as a file, and what it holds."""

    index: str
    facts: MapFacts


class CutExtractRequest(Model):
    """A part of an extract that is to become a map: the words for it, or a box, or any with such a site.

    ``seed`` chooses among several that fit; ``facts``: those of the extract, by whose names it may be called.
    """

    index: str
    folder: str
    facts: MapFacts
    place: str | None = None
    bbox: Box | None = None
    scenario_type: ScenarioType = "any"
    seed: int = 0


class CutOfExtract(Model):
    """A part of an extract as a map file, and what it shows; empty and None where the extract shows nothing such.

    ``core``: where its roads are whole and sites are to be looked for; ``label``: what it is about, in words;
    ``words``: of the request, what names something on the map itself (empty: all of it named the extract).
    """

    path: str = ""
    facts: MapFacts | None = None
    core: Box = (0.0, 0.0, 0.0, 0.0)
    label: str = ""
    words: str = ""
