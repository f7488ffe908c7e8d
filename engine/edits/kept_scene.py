"""Scenes that a worker keeps, because one scenario is edited again and again: reading it takes longer than an edit."""

import hashlib
from functools import lru_cache
from pathlib import Path

from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.scenarios.reader import read_scenario

KEPT = 4


def scene_of(path: Path) -> Scene:
    """The scene of a file with its lanes and SUMO network; made once for the same content, and never changed.

    Raises:
        UnsafeInput: the file is not readable.
    """
    try:
        content = path.read_bytes()
    except OSError:
        content = b""  # the reader says what is wrong with the file
    return _scene(path, hashlib.sha256(content).hexdigest())


@lru_cache(maxsize=KEPT)
def _scene(path: Path, digest: str) -> Scene:
    del digest
    return Scene.of(read_scenario(path))
