"""What the server's process and a worker process say to each other: one JSON object a line."""

import json
from dataclasses import dataclass
from typing import Any

from plannerforge.schemas.errors import PlannerForgeError, rebuild

LONGEST_LINE_BYTES = 256 * 1024**2


@dataclass(frozen=True)
class Order:
    """Work for a worker: the entry point ``module:function`` and its request as JSON."""

    entry_point: str
    request: str

    def line(self) -> bytes:
        """The order as one line."""
        return _line({"entry_point": self.entry_point, "request": self.request})

    @classmethod
    def read(cls, line: bytes | str) -> "Order":
        """The order that a line holds."""
        content = json.loads(line)
        return cls(content["entry_point"], content["request"])


@dataclass(frozen=True)
class Progress:
    """How far the work is: share in [0, 1] and a few words."""

    share: float
    message: str

    def line(self) -> bytes:
        """The report as one line."""
        return _line({"share": self.share, "message": self.message})


@dataclass(frozen=True)
class Answer:
    """The response of an operation as JSON."""

    response: str

    def line(self) -> bytes:
        """The answer as one line."""
        return _line({"response": self.response})


@dataclass(frozen=True)
class Failure:
    """An error of an operation; ``unexpected`` holds the traceback of one that nobody foresaw."""

    code: str
    message: str
    valid: tuple[str, ...]
    next_step: str
    unexpected: str = ""

    @classmethod
    def of(cls, error: PlannerForgeError) -> "Failure":
        """The failure that carries a domain error across processes."""
        return cls(error.code, error.message, error.valid, error.next_step)

    def error(self) -> PlannerForgeError:
        """The domain error, made again."""
        return rebuild(self.code, self.message, self.valid, self.next_step)

    def line(self) -> bytes:
        """The failure as one line."""
        return _line({"failure": [self.code, self.message, list(self.valid), self.next_step, self.unexpected]})


def read_report(line: bytes) -> Progress | Answer | Failure:
    """What a line of a worker says."""
    content = json.loads(line)
    if "share" in content:
        return Progress(content["share"], content["message"])
    if "response" in content:
        return Answer(content["response"])
    code, message, valid, next_step, unexpected = content["failure"]
    return Failure(code, message, tuple(valid), next_step, unexpected)


def _line(content: dict[str, Any]) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"
