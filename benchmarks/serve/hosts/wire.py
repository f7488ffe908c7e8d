"""A relay between a client and the server over standard input that keeps a copy of each line.

Run it as a separate program, ``python -P wire.py COPY SERVER ARGUMENT…``; the client starts it in place of the server.
:func:`wire_facts` reads from the copy what neither the client nor the journal reports: the agreed revision, the
client's name, and whether it requested progress.
"""

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

_META = "io.modelcontextprotocol/"
"""Prefix of the keys in the revision without sessions."""


@dataclass(frozen=True)
class WireFacts:
    """Observations of a client: revision, name with version, whether it requested progress, notes sent to it."""

    revision: str = ""
    client: str = ""
    asks_progress: bool = False
    progress_notes: int = 0


def wire_facts(copy: Path) -> WireFacts:
    """Return the content of a copy, empty if there is none. The last of several sessions counts."""
    facts = WireFacts()
    for sender, message in _messages(copy):
        parameters, result = message.get("params") or {}, message.get("result") or {}
        meta = parameters.get("_meta") or {}
        told = parameters if message.get("method") == "initialize" else {}
        revision = meta.get(f"{_META}protocolVersion") if sender == "client" else result.get("protocolVersion")
        client = told.get("clientInfo") or meta.get(f"{_META}clientInfo") or {}
        asks = sender == "client" and message.get("method") == "tools/call" and "progressToken" in meta
        noted = sender == "server" and message.get("method") == "notifications/progress"
        facts = WireFacts(
            revision or facts.revision,
            f"{client['name']} {client['version']}" if client else facts.client,
            facts.asks_progress or asks,
            facts.progress_notes + noted,
        )
    return facts


def _messages(copy: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for line in copy.read_text(encoding="utf-8").splitlines() if copy.is_file() else []:
        sender, _, text = line.partition(" ")
        try:
            message = json.loads(text)
        except ValueError:
            continue
        if isinstance(message, dict):
            yield sender, message


def _main() -> int:
    """Start the server and hand lines on until it has ended; its status."""
    server = subprocess.Popen(sys.argv[2:], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: server.terminate())
    assert server.stdin is not None and server.stdout is not None  # noqa: S101, PT018 - opened with pipes
    with open(sys.argv[1], "a", encoding="utf-8") as copy:  # noqa: PTH123 - as its caller spells it
        lock = threading.Lock()
        upwards = (sys.stdin.buffer, server.stdin, copy, lock, "client")
        threading.Thread(target=_hand_on, args=upwards, daemon=True).start()
        _hand_on(server.stdout, sys.stdout.buffer, copy, lock, "server")
        return server.wait()


def _hand_on(source: IO[bytes], target: IO[bytes], copy: IO[str], lock: threading.Lock, sender: str) -> None:
    try:
        for line in iter(source.readline, b""):
            with lock:
                copy.write(f"{sender} {line.decode('utf-8', 'replace').rstrip()}\n")
                copy.flush()
            target.write(line)
            target.flush()
        target.close()
    except (BrokenPipeError, ValueError):  # the other side has gone: its own end of the pipe says so too
        return


if __name__ == "__main__":
    sys.exit(_main())
