"""Validates answers of map services before use or storage: OpenStreetMap data and places in their documented forms.

Undocumented parts are left out. If an element has a different form, the whole answer is rejected, and the next service
gets the request.

Sources: Overpass API, output format JSON; OpenStreetMap API 0.6 (lengths of tags, ranges of coordinates); Nominatim,
output format jsonv2.
"""

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, Literal, NotRequired, TypeVar

from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError
from typing_extensions import TypedDict

from ....schemas.text import one_line


def _not_boolean(value: object) -> object:
    """Return a value that is not a boolean, which pydantic would read as 0 or 1.

    Raises:
        PydanticCustomError: the value is a boolean.
    """
    if isinstance(value, bool):
        raise PydanticCustomError("boolean", "a boolean is not a number")
    return value


_Latitude = Annotated[float, Field(ge=-90.0, le=90.0, allow_inf_nan=False), BeforeValidator(_not_boolean)]
_Longitude = Annotated[float, Field(ge=-180.0, le=180.0, allow_inf_nan=False), BeforeValidator(_not_boolean)]
_Id = Annotated[int, Field(gt=0, lt=2**63), BeforeValidator(_not_boolean)]
"""Ids are positive 64-bit integers; negative ones belong to an editor that has not uploaded them."""
_LONGEST_TAG = 255
"""Characters of a key or a value of a tag (OpenStreetMap API 0.6)."""
_Tag = Annotated[str, Field(max_length=_LONGEST_TAG)]
_Text = Annotated[str, Field(max_length=4000)]
"""Longer than any label of a place, which lists everything around it (chosen)."""
_SHOWN = 120


class _Centre(TypedDict):
    """The centre of a way or relation, in degrees."""

    lat: _Latitude
    lon: _Longitude


class _Member(TypedDict):
    """A member of a relation."""

    type: Literal["node", "way", "relation"]
    ref: _Id
    role: NotRequired[_Tag]


class _Element(TypedDict):
    """The common part of all elements; ``center`` is present if only the middle of a way or relation was requested."""

    id: _Id
    tags: NotRequired[dict[_Tag, _Tag]]
    center: NotRequired[_Centre]


class _Node(_Element):
    """A node, at a position in degrees."""

    type: Literal["node"]
    lat: _Latitude
    lon: _Longitude


class _Way(_Element):
    """A way: its nodes in order."""

    type: Literal["way"]
    nodes: NotRequired[list[_Id]]


class _Relation(_Element):
    """A relation: its members in order."""

    type: Literal["relation"]
    members: NotRequired[list[_Member]]


class _Origin(TypedDict):
    """The origin of the data."""

    timestamp_osm_base: NotRequired[_Tag]


class MapData(TypedDict):
    """An answer of Overpass."""

    elements: list[Annotated[_Node | _Way | _Relation, Field(discriminator="type")]]
    osm3s: NotRequired[_Origin]


class _Shape(TypedDict):
    """A GeoJSON geometry."""

    type: _Tag
    coordinates: NotRequired[list[Any]]


class Finding(TypedDict):
    """A place that Nominatim found. Its address maps enclosing areas to names; its box is south, north, west, east."""

    lat: _Latitude
    lon: _Longitude
    boundingbox: tuple[_Latitude, _Latitude, _Longitude, _Longitude]
    display_name: _Text
    name: NotRequired[_Text | None]
    category: NotRequired[_Tag]
    type: NotRequired[_Tag]
    addresstype: NotRequired[_Tag | None]
    osm_type: NotRequired[_Tag]
    osm_id: NotRequired[_Id]
    importance: NotRequired[Annotated[float, Field(allow_inf_nan=False), BeforeValidator(_not_boolean)] | None]
    address: NotRequired[dict[_Tag, _Text]]
    namedetails: NotRequired[dict[_Tag, _Text] | None]
    geojson: NotRequired[_Shape]


class NotReadable(ValueError):
    """Raised for an answer in a different form; the message states what is wrong, and where."""


_Read = TypeVar("_Read")


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def read_map_data(answer: object) -> MapData:
    """Return an answer of Overpass without undocumented parts.

    Raises:
        NotReadable: the answer has a different form.
    """
    data: MapData = _read(_adapter(MapData).validate_python, answer)
    return data


def read_findings(answer: object) -> list[Finding]:
    """Return the places in an answer of Nominatim without undocumented parts.

    Raises:
        NotReadable: the answer has a different form.
    """
    findings: list[Finding] = _read(_adapter(list[Finding]).validate_python, answer)
    return findings


def _read(validate: Callable[[object], _Read], answer: object) -> _Read:
    try:
        return validate(answer)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "the answer"
        raise NotReadable(one_line(f"{where}: {first['msg']}", _SHOWN)) from error
