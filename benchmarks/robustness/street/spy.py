"""A planner program that looks for secrets and writes what it finds: ``spy.py FILE``; standard library only.

It reads the environment, the command line and the open descriptors of itself, its ancestors and their descendants, as
far as the operating system permits. It returns no plan.
"""

import os
import sys
from pathlib import Path

_MOST_BYTES = 1_000_000


def parent_of(process: int) -> int:
    """Return the parent of a process, or 0 if it is unknown."""
    try:
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    except (OSError, ValueError, IndexError):
        return 0


def read(path: Path) -> bytes:
    """Return the beginning of a file; empty if it cannot be read at once."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError:
        return b""
    try:
        return os.read(descriptor, _MOST_BYTES)
    except OSError:
        return b""
    finally:
        os.close(descriptor)


def places_of(process: int) -> dict[str, bytes]:
    """Return the readable content of a process, by place."""
    base = Path(f"/proc/{process}")
    seen = {f"{process} {name}": read(base / name) for name in ("environ", "cmdline")}
    try:
        descriptors = [path.name for path in (base / "fd").iterdir()]
    except OSError:
        descriptors = []
    for descriptor in descriptors:
        path = base / "fd" / descriptor
        try:
            target = str(path.readlink())
        except OSError:
            continue
        is_file = target.startswith("/") and not target.startswith(("/dev/", "/proc/"))
        is_mine = process == os.getpid()  # reading would remove data from another process's pipe
        seen[f"{process} descriptor {descriptor} {target}"] = target.encode() + (
            read(path) if is_file or "memfd" in target else b""
        )
        if is_mine and target.startswith("pipe:") and descriptor not in ("0", "1", "2"):
            seen[f"own pipe {descriptor}"] = read(path)
    return seen


def main() -> None:
    """Look, and write a line for each place: its name and its bytes in hexadecimal."""
    line = sys.stdin.buffer.readline()
    chain, process = [os.getpid()], os.getpid()
    while process > 1:
        process = parent_of(process)
        chain.append(process)
    family = set(chain)
    everything = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    server = set(chain[:-2])  # whatever these started, but not all that the first process of the machine did
    for other in everything:
        ancestor = other
        while ancestor > 1 and ancestor not in server:
            ancestor = parent_of(ancestor)
        if ancestor in server:
            family.add(other)
    seen = {"request": line}
    for process in sorted(family - {0}):
        seen |= places_of(process)
    with Path(sys.argv[1]).open("a", encoding="utf-8") as file:
        file.writelines(f"{name.encode().hex()} {content.hex()}\n" for name, content in seen.items())
    sys.stdout.write("{}\n")


if __name__ == "__main__":
    main()
