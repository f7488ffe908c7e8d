"""Requests of a stranger without a token to an HTTP server, as a program: ``knocks HOST PORT SECONDS SEED``.

It shares no code with the server. Its last line counts requests and responses by kind.

Kinds: ``long_head`` (one endless header), ``many_lines`` (endless headers), ``half_head`` (kept open), ``slow_head`` (a
line per second), ``body`` (megabytes, announced), ``half_body`` (announced and not sent), ``chunks`` (mostly framing).
Others are ``stream`` (of events), ``session`` (started), ``wrong_token``, ``foreign`` (another Host and Origin),
``ready`` (requested endlessly).
"""

import asyncio
import json
import random
import sys
import time
from collections import Counter
from collections.abc import Awaitable, Callable

_HELD = 150
"""Half-open connections at a time (chosen): a stranger opens a new one for each closed one."""
_PAUSE_S = 0.02
"""Pause between two other requests of a kind (chosen): twelve kinds then make some hundred requests per second."""
_MEGABYTE = b"x" * 1024**2
_MOST_MEGABYTES = 8
_TAKEN_S = 5.0
"""Longest wait for a response before the stranger continues (chosen)."""

Knock = Callable[["Stranger"], Awaitable[str]]


class Stranger:
    """One address that knocks in every way at once.

    Args:
        host: address of the server.
        port: port of the server.
        seconds: duration.
        chance: source of all draws.
    """

    def __init__(self, host: str, port: int, seconds: float, chance: random.Random) -> None:
        self._host, self._port, self.chance = host, port, chance
        self._end = time.monotonic() + seconds
        self.seen: dict[str, Counter[str]] = {}

    async def knock(self) -> None:
        """Knock in every way until the time is over."""
        held = [self._again("half_head", _half_head, 0.5) for _ in range(_HELD)]
        slow = [self._again("slow_head", _slow_head, 0.5) for _ in range(8)]
        others = [self._again(name, kind, _PAUSE_S) for name, kind in KINDS.items()]
        await asyncio.gather(*held, *slow, *others)

    async def _again(self, name: str, kind: Knock, pause_s: float) -> None:
        counted = self.seen.setdefault(name, Counter())
        while (left_s := self._end - time.monotonic()) > 0:
            try:
                counted[await asyncio.wait_for(kind(self), left_s)] += 1
            except TimeoutError:  # an OSError too, so it comes first
                counted["held to the end"] += 1
            except (OSError, asyncio.IncompleteReadError) as error:
                counted[type(error).__name__] += 1
            await asyncio.sleep(pause_s * self.chance.uniform(0.5, 1.5))

    async def send(self, *parts: bytes, pause_s: float = 0.0, wait_s: float = _TAKEN_S) -> str:
        """Send parts on a separate connection, and return the response as a status or text."""
        reader, writer = await asyncio.open_connection(self._host, self._port)
        try:
            for part in parts:
                if reader.at_eof():
                    break
                writer.write(part)
                await writer.drain()
                if pause_s:
                    await asyncio.sleep(pause_s)
            line = await asyncio.wait_for(reader.readline(), wait_s)
            return line[9:12].decode("latin-1") or "closed"
        except TimeoutError:
            return "no answer"
        finally:
            writer.close()

    def head(self, *lines: str, method: str = "POST") -> bytes:
        """Return the head of an MCP request, with extra lines."""
        start = (f"{method} /mcp HTTP/1.1", f"Host: 127.0.0.1:{self._port}", "Content-Type: application/json")
        return "\r\n".join((*start, "Accept: application/json, text/event-stream", *lines, "", "")).encode()

    def message(self, method: str, *lines: str) -> bytes:
        """Return a whole request."""
        told = {"protocolVersion": "2025-11-25", "capabilities": {}, "clientInfo": {"name": "stranger", "version": "1"}}
        body = json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": told}).encode()
        return self.head(*lines, f"Content-Length: {len(body)}") + body


async def _long_head(stranger: Stranger) -> str:
    start = stranger.head()[:-2] + b"X-Long: "
    return await stranger.send(start, *[_MEGABYTE] * stranger.chance.randint(1, _MOST_MEGABYTES))


async def _many_lines(stranger: Stranger) -> str:
    lines = b"".join(b"X-%d: %s\r\n" % (number, b"y" * 50) for number in range(stranger.chance.randint(90, 5000)))
    return await stranger.send(stranger.head()[:-2], lines)


async def _half_head(stranger: Stranger) -> str:
    start = stranger.chance.choice([b"", b"GET /mcp HT", b"POST /mcp HTTP/1.1\r\nHost: 127.0.0.1\r\nX: "])
    return await stranger.send(start, wait_s=60.0)


async def _slow_head(stranger: Stranger) -> str:
    lines = [b"X-%d: 1\r\n" % number for number in range(60)]
    return await stranger.send(stranger.head()[:-2], *lines, pause_s=1.0)


async def _body(stranger: Stranger) -> str:
    megabytes = stranger.chance.randint(1, _MOST_MEGABYTES)
    return await stranger.send(stranger.head(f"Content-Length: {megabytes * 1024**2}"), *[_MEGABYTE] * megabytes)


async def _half_body(stranger: Stranger) -> str:
    return await stranger.send(stranger.head("Content-Length: 4000000"), b"{")


async def _chunks(stranger: Stranger) -> str:
    chunk = b"1;" + b"e" * stranger.chance.choice([10, 1000, 60_000]) + b"\r\nx\r\n"
    return await stranger.send(stranger.head("Transfer-Encoding: chunked"), *[chunk] * 200)


async def _stream(stranger: Stranger) -> str:
    return await stranger.send(stranger.head(method="GET"))


async def _session(stranger: Stranger) -> str:
    return await stranger.send(stranger.message("initialize"))


async def _wrong_token(stranger: Stranger) -> str:
    token = stranger.chance.choice(["x", "y" * 40, "z" * 60_000, "e" + "yJhbGciOiJub25lIn0.e30."])
    return await stranger.send(stranger.message("tools/list", f"Authorization: Bearer {token}"))


async def _foreign(stranger: Stranger) -> str:
    return await stranger.send(stranger.message("tools/list", "Origin: http://evil.example"))


async def _ready(stranger: Stranger) -> str:
    path = stranger.chance.choice(["ready", "health", "mcp/../ready", "x" * 5000])
    return await stranger.send(f"GET /{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n".encode())


KINDS: dict[str, Knock] = {
    "long_head": _long_head,
    "many_lines": _many_lines,
    "body": _body,
    "half_body": _half_body,
    "chunks": _chunks,
    "stream": _stream,
    "session": _session,
    "wrong_token": _wrong_token,
    "foreign": _foreign,
    "ready": _ready,
}
"""Kinds repeated with a short pause, while half and slow heads stay open."""


def main() -> None:
    """Knock, and print the responses."""
    host, port, seconds, seed = sys.argv[1:]
    stranger = Stranger(host, int(port), float(seconds), random.Random(seed))  # noqa: S311 - no secret
    asyncio.run(stranger.knock())
    sys.stdout.write(json.dumps({name: dict(counted) for name, counted in stranger.seen.items()}) + "\n")


if __name__ == "__main__":
    main()
