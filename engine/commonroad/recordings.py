"""Caches checked scenarios on disk by content: reading one again takes a twentieth of the time.

A recording is a file with a name from the digest of the XML and from the versions of everything that it depends on. It
begins with the digest of the rest: a file that is damaged, foreign or from another version is ignored and created
again. The rest is a pickle that may refer to plain data only (``_ALLOWED``), so that reading it runs no code. NumPy's
own form is not read, because a forged data type can read memory: an array is stored as its number type, shape and bytes
(``_array``). The folder may be deleted at any time; the least recently used recordings are removed if it is too full.
"""

import hashlib
import io
import logging
import os
import pickle
import re
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from .plain_states import PlainStates

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblemSet
    from commonroad.scenario.scenario import Scenario
    from numpy.typing import NDArray

logger = logging.getLogger(__name__)
FOLDER_VARIABLE = "PLANNERFORGE_RECORDINGS"
"""The environment variable of a worker with the folder; without it, nothing is cached on disk."""
_READERS = ("document", "lanelet_networks", "plain_states", "reader", "recordings", "tracks", "value_limits")
"""Modules that define what is read and rejected: recordings made by other versions of them are ignored."""
_LIBRARIES = ("commonroad-io", "numpy", "shapely")
_LOOKED_AT = 50
"""The folder's size is checked when the first recording is written, and then after this many (chosen)."""
_DIGEST_BYTES = 32
_FINISHED, _UNFINISHED = ".recording", ".part"
_DATA_MODULES: Final = (
    "commonroad.common.common_lanelet",
    "commonroad.common.util",
    "commonroad.geometry.shape",
    "commonroad.planning.goal",
    "commonroad.planning.planning_problem",
    "commonroad.prediction.prediction",
    "commonroad.scenario.area",
    "commonroad.scenario.intersection",
    "commonroad.scenario.lanelet",
    "commonroad.scenario.obstacle",
    "commonroad.scenario.scenario",
    "commonroad.scenario.state",
    "commonroad.scenario.traffic_light",
    "commonroad.scenario.traffic_sign",
    "commonroad.scenario.trajectory",
)
"""Modules with classes of plain data; creating their objects neither reads nor writes anything."""
_ALLOWED: Final[Mapping[str, tuple[str, ...]]] = {
    "builtins": ("complex", "dict", "frozenset", "list", "set", "slice", "tuple"),
    "collections": ("OrderedDict", "defaultdict"),
    __name__: ("_array", "_number"),
    "shapely.io": ("from_wkb",),
    PlainStates.__module__: (PlainStates.__name__,),
}


_NUMBERS: Final = re.compile(r"[<>|=][biuf][1248]")
"""Kinds of numbers in NumPy's array protocol: booleans, integers and floating-point numbers of up to 8 bytes."""


@dataclass(frozen=True)
class Recording:
    """The result of reading a file: commonroad-io's objects without plain states, and these as arrays."""

    scenario: "Scenario"
    planning_problems: "PlanningProblemSet"
    declared_id: str
    plain_states: Mapping[int, PlainStates]
    ego_classes: Mapping[int, str] = field(default_factory=dict)
    friction: float | None = None


class RecordingStore:
    """The recordings in a folder, which is created with the first recording.

    ``most_bytes``: the folder's maximum size, enough for a few thousand scenarios (our choice).
    """

    def __init__(self, folder: Path, most_bytes: int = 512 * 2**20) -> None:
        self.folder, self._most_bytes = folder, most_bytes
        self._written = 0

    def find(self, content: str) -> Recording | None:
        """Return the recording of a file by its content's digest, or None if there is no valid recording."""
        path = self._path(content)
        try:
            stored = path.read_bytes()
        except OSError:
            return None
        with suppress(OSError):  # a read-only folder can still be read
            os.utime(path)
        digest, payload = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
        try:
            if digest != hashlib.sha256(payload).digest():
                raise pickle.UnpicklingError("its digest differs")
            return Recording(*_PlainData(io.BytesIO(payload)).load())
        except Exception as error:  # noqa: BLE001 - whatever error a foreign file causes in a library, the XML is the reference
            logger.warning("the recording %s is invalid and will be made again: %s", path, error)
            with suppress(OSError):
                path.unlink()
            return None

    def put(self, content: str, recording: Recording) -> None:
        """Store a recording. A failure is only logged, since the XML can be read at any time."""
        parts = (
            recording.scenario,
            recording.planning_problems,
            recording.declared_id,
            dict(recording.plain_states),
            dict(recording.ego_classes),
            recording.friction,
        )
        packed = io.BytesIO()
        _PlainPickler(packed, protocol=5).dump(parts)
        payload = packed.getvalue()
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self.folder, suffix=_UNFINISHED)
            try:
                with os.fdopen(handle, "wb") as stream:
                    stream.write(hashlib.sha256(payload).digest() + payload)
                Path(name).replace(self._path(content))
            except OSError:
                Path(name).unlink(missing_ok=True)
                raise
        except OSError as error:
            logger.warning("no recording is stored in %s: %s", self.folder, error)
            return
        if self._written % _LOOKED_AT == 0:
            self._make_room()
        self._written += 1

    def _path(self, content: str) -> Path:
        return self.folder / f"{content}-{_versions()}{_FINISHED}"

    def _make_room(self) -> None:
        """Delete the least recently used recordings until the folder is within its limit.

        Other workers may do the same at any time; their unfinished files are left alone.
        """
        files, total = [], 0
        for path in self.folder.glob(f"*{_FINISHED}"):
            with suppress(OSError):
                files.append((path.stat(), path))
        files.sort(key=lambda file: (-file[0].st_mtime, file[1].name))
        for status, path in files:
            total += status.st_size
            if total > self._most_bytes:
                with suppress(OSError):
                    path.unlink()


@cache
def _versions() -> str:
    """Return a short name for everything that a recording depends on: the libraries, and the readers' sources."""
    versions = [f"Python {sys.version_info.major}.{sys.version_info.minor}"]
    versions += [f"{name} {version(name)}" for name in _LIBRARIES]
    sources = (files(__package__).joinpath(f"{name}.py").read_bytes() for name in _READERS)
    versions += [hashlib.sha256(source).hexdigest() for source in sources]
    return hashlib.sha256("; ".join(versions).encode()).hexdigest()[:12]


def _array(kind: str, shape: tuple[int, ...], data: bytearray) -> "NDArray[Any]":
    """Return an array of a number type, such as ``<f8``, that uses the given bytes.

    Raises:
        pickle.UnpicklingError: it is not a number type.
        ValueError: the bytes do not fit the type and the shape.
    """
    import numpy as np

    if not _NUMBERS.fullmatch(kind):
        raise pickle.UnpicklingError(f"an array of {kind!r} does not contain numbers")
    return np.frombuffer(data, dtype=kind).reshape(shape)


def _number(kind: str, data: bytearray) -> Any:
    """Return a NumPy number of a type; see :func:`_array`."""
    return _array(kind, (), data)[()]


class _PlainPickler(pickle.Pickler):
    """A pickler that writes NumPy's arrays and numbers as their type, shape and bytes."""

    def reducer_override(self, written: Any) -> Any:
        """Return the reduced form of NumPy's objects; all other objects are reduced as usual."""
        import numpy as np

        if isinstance(written, np.ndarray):
            return _array, (written.dtype.str, written.shape, bytearray(np.ascontiguousarray(written).tobytes()))
        if isinstance(written, np.generic):
            return _number, (written.dtype.str, bytearray(written.tobytes()))
        return NotImplemented


class _PlainData(pickle.Unpickler):
    """An unpickler that accepts only classes of plain data."""

    def find_class(self, module_name: str, global_name: str) -> Any:
        """Return the class if it is allowed.

        Raises:
            pickle.UnpicklingError: the class is not allowed.
        """
        if global_name in _ALLOWED.get(module_name, ()):
            return super().find_class(module_name, global_name)
        if module_name in _DATA_MODULES and "." not in global_name:
            found = super().find_class(module_name, global_name)
            if isinstance(found, type) and found.__module__ == module_name:
                return found
        raise pickle.UnpicklingError(f"it refers to {module_name}.{global_name}, which is not plain data")
