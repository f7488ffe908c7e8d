"""The clients' environments: one for each, created once with pinned versions, outside the checkout.

Python clients get a virtual environment, Node clients a folder filled by npm; Node itself comes from PyPI. Each name
ends with the digest of the requirements, so other versions create another environment. If an installation fails,
:class:`LeftOut` carries the installer's reason.
"""

import hashlib
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_cache_path

from ...harness import installed_environment
from ..node import PACKAGE, Node, node_in
from .roster import Host

FOLDER_VARIABLE = "PLANNERFORGE_HOSTS"
_KEPT = ("PATH", "LANG", "LC_ALL", "TZ", "TMPDIR")
"""The machine's variables that a client sees, without keys or settings of its user."""


def default_folder() -> Path:
    """Return the environments' folder: ``PLANNERFORGE_HOSTS``, or a folder in the user's cache."""
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named) if named else user_cache_path("plannerforge") / "hosts"


def quiet_variables(home: Path) -> dict[str, str]:
    """Return the variables of a client's process: a home of its own, nothing of the user, no report to its makers."""
    home.mkdir(parents=True, exist_ok=True)
    kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
    return {**kept, "HOME": str(home), "DO_NOT_TRACK": "1", "TERM": "xterm-256color"}


@dataclass(frozen=True)
class Installed:
    """A client that is there.

    Args:
        folder: of its environment.
        program: the command that runs its driver.
        version: of the client's package.
        path: folders that come before all others on its ``PATH``.
    """

    folder: Path
    program: tuple[str, ...]
    version: str
    path: tuple[str, ...] = ()


@dataclass(frozen=True)
class Environments:
    """Creates and finds the clients' environments.

    Args:
        folder: their folder.
        node: a Node program to use; empty to fetch one.
    """

    folder: Path
    node: str = ""

    def installed(self, host: Host) -> Installed:
        """Return the environment of a client, creating it if necessary.

        Raises:
            LeftOut: it cannot be created here; the message is the installer's reason.
        """
        if host.installer == "pip":
            folder = self._pip(host.name, host.packages)
            package, _, version = host.packages[0].partition("==")
            return Installed(folder, (str(folder / "bin" / "python"),), _pip_version(folder, package) or version)
        node = self._node()
        folder = self._npm(host.name, host.packages, node)
        package = host.packages[0].rpartition("@")[0]
        version = json.loads((folder / "node_modules" / package / "package.json").read_text(encoding="utf-8"))[
            "version"
        ]
        program = (str(node.program), "--no-warnings") if host.driver.endswith(".mjs") else (sys.executable, "-P")
        return Installed(
            folder, program, str(version), (str(folder / "node_modules" / ".bin"), str(node.program.parent))
        )

    def _pip(self, name: str, packages: Sequence[str]) -> Path:
        digest = _digest(packages)
        return installed_environment(self.folder / f"{name}-{digest}", name, digest, packages)

    def _node(self) -> Node:
        return node_in(self.folder / f"node-{_digest([PACKAGE])}", self.node)

    def _npm(self, name: str, packages: Sequence[str], node: Node) -> Path:
        digest = _digest(packages)
        folder = self.folder / f"{name}-{digest}"
        whole = folder / f"{digest}.whole"
        if whole.exists():
            return folder
        sys.stderr.write(f"installing {name} in {folder} …\n")
        node.install(folder, packages, name)
        whole.touch()
        return folder


def _digest(packages: Sequence[str]) -> str:
    return hashlib.sha256(" ".join(packages).encode()).hexdigest()[:12]


def _pip_version(folder: Path, package: str) -> str:
    """Return the version of a package in an environment, empty if it is not there."""
    wanted = package.partition("[")[0].replace("-", "_").lower()
    found = [path.name for path in folder.glob("lib/python*/site-packages/*.dist-info")]
    named = (name.removesuffix(".dist-info").rpartition("-") for name in found)
    return next((version for name, _, version in named if name.replace("-", "_").lower() == wanted), "")
