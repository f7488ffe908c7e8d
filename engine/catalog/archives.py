"""Download an archive of scenarios, check its hash, and unpack it within limits.

pooch also downloads files with a known hash, but accepts a download of any length. With pooch, a limit on the length
would still need most of this module, as a custom downloader, in addition to pooch's dependencies (requests,
platformdirs, packaging).
"""

import hashlib
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from urllib.error import URLError
from urllib.parse import urlsplit
from urllib.request import urlopen

from ...schemas.errors import InvalidRequest, PlannerForgeError, ResourceFailure, UnsafeInput
from ...schemas.text import one_line, quoted, shown_name
from ..workspace import disk_failure

LARGEST_DOWNLOAD_BYTES = 4 * 1024**3
"""The limit of the file at an address (chosen)."""
LARGEST_MEMBER_BYTES = 100_000_000
"""The limit of one file in an archive (chosen)."""
LARGEST_WHOLE_BYTES = 20 * 1024**3
"""The limit of all files of an archive: a few bytes of a zip can contain gigabytes (chosen)."""
TIMEOUT_S = 30.0
"""The longest time without a byte from the server (chosen)."""
MOST_MEMBERS = 100_000
"""The most files in an archive (chosen)."""
_LONGEST_NAME_BYTES, _KEPT_CHARACTERS = 200, 40
"""A file system takes 255 bytes; of a longer name, the end is kept after its number (chosen)."""
_BLOCK = 1 << 20
"""The bytes in memory at one time."""
OnProgress = Callable[[int, int | None], None]
"""Receives the bytes downloaded so far, and the total if the server gives it."""


def download(url: str, sha256: str, folder: Path, on_progress: OnProgress) -> Path:
    """Return the file at an address, stored in a folder under its hash; download it only if it is missing.

    Args:
        on_progress: called after each block.

    Raises:
        InvalidRequest: the address is not http(s), or the hash is not a SHA-256.
        UnsafeInput: the content has another hash, or is larger than 4 GiB; nothing is kept.
        ResourceFailure: the address cannot be reached, or the disk cannot be written.
    """
    wanted, parts = sha256.strip().lower(), urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.netloc:
        raise InvalidRequest(f"{quoted(url)} is not an http(s) address", valid=["https://…", "http://…"])
    if not re.fullmatch(r"[0-9a-f]{64}", wanted):
        raise InvalidRequest(f"{quoted(sha256)} is not a SHA-256", valid=["64 hexadecimal digits"])
    ending = ".xml" if parts.path.endswith(".xml") else ".zip"
    target = folder / f"{wanted}{ending}"
    if target.is_file():
        return target
    part = target.with_suffix(".part")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        digest = _stream(url, part, on_progress)
        if digest != wanted:
            raise UnsafeInput(
                f"{url} has the SHA-256 {digest}, not {wanted}", next_step="check the address and the hash"
            )
        part.replace(target)
    except (URLError, OSError) as error:
        raise ResourceFailure(f"{url} cannot be fetched: {getattr(error, 'reason', error)}") from error
    finally:
        part.unlink(missing_ok=True)
    return target


@contextmanager
def unpack(file: Path) -> Iterator[Path]:
    """Yield a temporary folder with a copy of the XML file, or with an archive's XML files without their subfolders.

    Raises:
        UnsafeInput: the file is neither XML nor a zip archive, or it unpacks to more than the limits allow.
    """
    with tempfile.TemporaryDirectory(dir=file.parent) as name:
        folder = Path(name)
        if file.suffix == ".xml":
            shutil.copyfile(file, folder / file.name)
        else:
            with _readable(one_line(file.name)), zipfile.ZipFile(file) as archive:
                _extract(archive, folder)
        yield folder


@contextmanager
def _readable(name: str) -> Iterator[None]:
    """Refuse an archive that Python's zipfile cannot read; its decoders may raise any error.

    Raises:
        UnsafeInput: the archive or a member is broken, encrypted or compressed in an unknown way.
    """
    try:
        yield
    except PlannerForgeError:
        raise
    except Exception as error:
        what = one_line(str(error)) or type(error).__name__
        raise UnsafeInput(f"{name} cannot be read as a zip archive: {what}") from error


def _stream(url: str, part: Path, on_progress: OnProgress) -> str:
    """Write the address's content into a file, and return its SHA-256."""
    digest, done = hashlib.sha256(), 0
    with urlopen(url, timeout=TIMEOUT_S) as answer, part.open("wb") as stream:  # noqa: S310 - http(s) only, checked above
        length = answer.headers.get("Content-Length")
        total = int(length) if length and length.isdigit() else None
        while block := answer.read(_BLOCK):
            done += len(block)
            if done > LARGEST_DOWNLOAD_BYTES:
                raise UnsafeInput(
                    f"{url} is larger than {LARGEST_DOWNLOAD_BYTES:,} bytes",
                    next_step="split it, or import a part of it",
                )
            digest.update(block)
            stream.write(block)
            on_progress(done, total)
    return digest.hexdigest()


def _extract(archive: zipfile.ZipFile, folder: Path) -> None:
    """Write every XML member under its bare name, so that no path in the archive leads outside the folder."""
    whole = 0
    members = [member for member in archive.infolist() if not member.is_dir()]
    if len(members) > MOST_MEMBERS:
        raise UnsafeInput(
            f"the archive has {len(members):,} files; at most {MOST_MEMBERS:,} are unpacked",
            next_step="split the archive",
        )
    for number, member in enumerate(members):
        name = PurePosixPath(member.filename).name
        if not name.lower().endswith(".xml"):
            continue
        target = folder / name
        if len(name.encode()) > _LONGEST_NAME_BYTES or target.exists():
            target = folder / f"{number}-{name[-_KEPT_CHARACTERS:]}"
        written = 0
        with archive.open(member) as source, _writing(target) as write:
            while block := source.read(_BLOCK):
                written += len(block)
                whole += len(block)
                if written > LARGEST_MEMBER_BYTES or whole > LARGEST_WHOLE_BYTES:
                    raise UnsafeInput(
                        f"{shown_name(name)} unpacks to more than {LARGEST_MEMBER_BYTES:,} bytes, or all files "
                        f"together to more than {LARGEST_WHOLE_BYTES:,}",
                        next_step="split the archive, or leave the large file out",
                    )
                write(block)


@contextmanager
def _writing(target: Path) -> Iterator[Callable[[bytes], None]]:
    """Yield a function that writes blocks to a new file; report a full disk as such, not as a fault of the archive.

    Raises:
        ResourceFailure: the disk cannot be written.
    """

    def write(block: bytes) -> None:
        try:
            stream.write(block)
        except OSError as error:
            raise disk_failure(target.parent, error) from error

    try:
        stream = target.open("wb", buffering=0)
    except OSError as error:
        raise disk_failure(target.parent, error) from error
    with stream:
        yield write
