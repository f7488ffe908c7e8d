"""A CommonRoad file as its moving obstacles, each the bytes that it takes up, and the rest as a short document.

Nearly all of a large file are states, and an edit leaves nearly all of them as they are: what is not looked into need
not be parsed, and what was read of an obstacle before is known again by its bytes.

Only files are split where bytes tell what a parser would find: in UTF-8, without comments, CDATA sections, processing
instructions, document types, default namespaces and carriage returns.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

CHUNK = "chunk"
"""The attribute of a stand-in that tells the number of its chunk; a file that has such an attribute is not split."""
_DECLARED_UTF8 = re.compile(
    rb"(\xef\xbb\xbf)?<\?xml version=[\"']1\.0[\"']( encoding=[\"'](?i:utf-8)[\"'])?[^>\w]*\?>"
)
_NOT_PLAIN = (b"<!", b"\r", b"xmlns=", f" {CHUNK}=".encode())
_BEGIN = re.compile(rb"<(dynamicObstacle|obstacle)\s([^>]*[^/>])>")
_ID = re.compile(rb"(?<!\S)id\s*=\s*([\"'])([^\"'<>&]*)\1")
_STAND_IN = re.compile(rb"<(?:dynamicObstacle|obstacle) id=\"[^\"]*\" chunk=\"(\d+)\"/>")


def is_declared_utf8(content: bytes) -> bool:
    """Whether a file begins with an XML declaration of UTF-8, or of no encoding, which means the same."""
    return _DECLARED_UTF8.match(content) is not None


@dataclass(frozen=True)
class SplitDocument:
    """``chunks``: moving obstacles in the order of the file; ``rest``: the file with a stand-in for each of them.

    A stand-in is an empty element of the same name with the obstacle's id and the number of its chunk.
    """

    chunks: tuple[bytes, ...]
    rest: bytes

    @classmethod
    def of(cls, content: bytes) -> "SplitDocument | None":
        """Split a file; None for one whose bytes may mean something else."""
        if not is_declared_utf8(content) or content.count(b"<?") != 1 or any(mark in content for mark in _NOT_PLAIN):
            return None
        chunks: list[bytes] = []
        rest: list[bytes] = []
        at = 0
        for begin, end, name, number in _obstacles(content):
            rest += [content[at:begin], b'<%b id="%b" chunk="%d"/>' % (name, number, len(chunks))]
            chunks.append(content[begin:end])
            at = end
        return cls(tuple(chunks), b"".join((*rest, content[at:])))

    def with_chunks(self, rest: bytes, made_of: Callable[[bytes], bytes] = bytes) -> bytes:
        """A rest, as it was or serialised anew, with the chunks, or what is made of them, in place of stand-ins."""
        return _STAND_IN.sub(lambda found: made_of(self.chunks[int(found[1])]), rest)


def _obstacles(content: bytes) -> Iterator[tuple[int, int, bytes, bytes]]:
    """Where obstacles begin and end that have one id, which tells them, and no element with an id inside."""
    at = 0
    while found := _BEGIN.search(content, at):
        closing = b"</%b>" % found[1]
        at = content.find(closing, found.end()) + len(closing)
        if at < len(closing):
            return
        number = _ID.search(found[2])
        if number is not None and content.count(b"id=", found.start(), at) == 1:
            yield found.start(), at, found[1], number[2]
