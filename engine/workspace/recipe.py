"""The recipe of an artifact, sufficient to recreate it bit for bit on the same type of machine."""

import hashlib
import json
from pathlib import Path
from typing import Any

from pydantic import Field

from ...schemas.base import Model


class Recipe(Model):
    """The tool, its resolved arguments, the parent artifacts, the seed, and the relevant versions.

    Dates and counters are deliberately left out, so that the same request gives the same digest.
    """

    tool: str
    arguments: dict[str, Any] = Field(default_factory=dict)
    parents: tuple[str, ...] = ()
    seed: int = 0
    versions: dict[str, str] = Field(default_factory=dict)

    @property
    def digest(self) -> str:
        """The twelve hexadecimal characters that identify this recipe."""
        content = json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
        return hashlib.sha256(content.encode()).hexdigest()[:12]


def content_digest(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal, for recipes that start from a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def versions_of(*packages: str) -> dict[str, str]:
    """Return the installed versions of packages, and our own, by name, for a recipe."""
    from importlib.metadata import version

    return {package: version(package) for package in sorted({"plannerforge-mcp", *packages})}
