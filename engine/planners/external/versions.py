"""Names the version of a planner: the declared version, git's description of its source, or a digest.

The digest of the source is appended in each case, since it changes with edits that are not yet declared or committed.
Git is queried only for names and object ids: no hook, filter, monitor or remote of a repository is run or contacted.
"""

import hashlib
import os
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from ....schemas.text import one_line
from .found import Found

SHORT_DIGEST = 7
"""Shown characters of a digest; git abbreviates object ids to the same length."""
GIT_LIMIT_S = 5.0
"""Time limit for one answer of git (chosen: milliseconds on a local disk)."""
_LONGEST = 40
"""Shown characters of a version (chosen: tags and version numbers are shorter)."""
_QUIET = {"LC_ALL": "C", "GIT_OPTIONAL_LOCKS": "0", "GIT_TERMINAL_PROMPT": "0", "GIT_NO_LAZY_FETCH": "1"}
"""Makes git take no lock, prompt for nothing and fetch nothing."""
_SETTINGS = ("-c", "core.hooksPath=/dev/null", "-c", "core.fsmonitor=false")


def version_in_words(found: Found) -> str:
    """Return text such as ``v1.2 (a1b2c3d)``: the version that is declared, from git or the package, and the digest.

    This imports the planner's class for its declaration, so only workers may call it.
    """
    digest = found.version[:SHORT_DIGEST]
    named = _declared(found) or described_by_git(found.sources) or found.package_version
    return f"{one_line(named, _LONGEST)} ({digest})" if named else digest


def _declared(found: Found) -> str:
    declaration = found.command if found.command is not None else found.own().declaration
    return declaration.version


def described_by_git(sources: Sequence[Path]) -> str:
    """Return ``git describe`` of the commit that has the first source file, with ``-dirty`` if a file differs.

    The result is empty if that file is not in a commit, git is not installed, or git takes too long.
    """
    files = [path.resolve() for path in sources if path.is_file()]
    return _described(tuple(files), tuple(_stamps(files))) if files else ""


def _stamps(files: Sequence[Path]) -> list[int]:
    """Return the modification times of the files and of git's records on them, as a cache key."""
    repository = next((folder / ".git" for folder in files[0].parents if (folder / ".git").exists()), None)
    names = ("HEAD", "logs/HEAD", "packed-refs", "refs/tags")
    of_git = [] if repository is None else [repository / name for name in names]
    return [path.stat().st_mtime_ns for path in (*files, *of_git) if path.exists()]


@cache
def _described(files: tuple[Path, ...], stamps: tuple[int, ...]) -> str:
    del stamps  # only part of the cache's key
    folder = files[0].parent
    try:
        committed = _committed(folder)
        if files[0] not in committed:
            return ""
        words = _git(folder, "describe", "--tags", "--always").strip()
    except (OSError, subprocess.SubprocessError, ValueError):
        return ""
    is_edited = any(committed.get(path) != _blob_id(path, committed[files[0]]) for path in files)
    return f"{words}-dirty" if is_edited else words


def _committed(folder: Path) -> dict[Path, str]:
    """Return the files in and below a folder in the current commit, each with its object id."""
    top = Path(_git(folder, "rev-parse", "--show-toplevel").strip())
    listed = _git(folder, "ls-tree", "-r", "-z", "--full-name", "HEAD", "--", ".")
    entries = (line.partition("\t") for line in listed.split("\0") if line)
    return {(top / name).resolve(): about.split()[2] for about, _, name in entries}


def _blob_id(path: Path, like: str) -> str:
    """Return git's object id for the content of a file, computed with the algorithm of a given id."""
    content = path.read_bytes()
    algorithm = "sha256" if len(like) == hashlib.sha256().digest_size * 2 else "sha1"
    return hashlib.new(algorithm, b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _git(folder: Path, *arguments: str) -> str:
    """Return the output of a git command in a folder.

    Raises:
        OSError: Git is not installed.
        subprocess.SubprocessError: Git refuses, or takes too long.
        ValueError: The output is not text.
    """
    environment = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ} | _QUIET
    done = subprocess.run(
        ["git", *_SETTINGS, "-C", str(folder), *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=GIT_LIMIT_S,
        check=True,
        env=environment,
    )
    return done.stdout.decode()
