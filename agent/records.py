"""Stores conversations in the workspace: one folder each, with the messages as JSON lines and the pictures."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path

from ..engine.workspace import make_private, write_whole
from ..schemas.errors import ResourceFailure
from .errors import SettingsFault
from .memory import SessionState, as_json, from_json
from .models.interface import Message

_FOLDER, _FILE = "chats", "messages.jsonl"
_ENDINGS = {"image/png": ".png", "image/gif": ".gif", "image/jpeg": ".jpg", "image/svg+xml": ".svg"}


def server_log(workspace: Path) -> Path | None:
    """Return the file for a server's standard error, and create its folder; None if that is impossible."""
    try:
        make_private(workspace / _FOLDER)
    except ResourceFailure:
        return None
    return workspace / _FOLDER / "server.log"


class ChatRecord:
    """A conversation's folder, which is created at the first write."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def begin(cls, workspace: Path, now: datetime) -> "ChatRecord":
        """Return a new conversation, with its start time as its name."""
        chats = workspace / _FOLDER
        name = f"{now:%Y-%m-%d-%H%M%S}"
        names = (name, *(f"{name}-{number}" for number in range(2, 100)))
        return cls(next(chats / free for free in names if not (chats / free).exists()))

    @classmethod
    def newest(cls, workspace: Path) -> "ChatRecord":
        """Return the latest conversation.

        Raises:
            SettingsFault: There is no earlier conversation.
        """
        found = sorted(workspace.glob(f"{_FOLDER}/*/{_FILE}"))
        if not found:
            raise SettingsFault(f"there is no earlier chat in {workspace / _FOLDER}", next_step="start a new one")
        return cls(found[-1].parent)

    def save(self, messages: Sequence[Message], state: SessionState) -> None:
        """Write the current conversation to its file, either completely or not at all."""
        self._make_folder()
        lines = [json.dumps({"state": asdict(state)}), *(as_json(message) for message in messages)]
        text = "".join(f"{line}\n" for line in lines)
        write_whole(self.folder / _FILE, lambda path: path.write_text(text, encoding="utf-8"))

    def load(self) -> tuple[tuple[Message, ...], SessionState]:
        """Return the messages and the current ids.

        Raises:
            SettingsFault: The file cannot be read.
        """
        path = self.folder / _FILE
        try:
            first, *lines = path.read_text(encoding="utf-8").splitlines()
            state = SessionState(**{name: str(value) for name, value in json.loads(first)["state"].items()})
            return tuple(from_json(line) for line in lines), state
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise SettingsFault(f"the chat {path} cannot be read: {error}", next_step="start a new one") from error

    def save_picture(self, data: bytes, mime_type: str) -> Path:
        """Write a picture and return its file, numbered in the order of the conversation."""
        self._make_folder()
        number = 1 + len(list(self.folder.glob("picture-*")))
        path = self.folder / f"picture-{number}{_ENDINGS.get(mime_type, '.bin')}"
        path.write_bytes(data)
        return path

    def _make_folder(self) -> None:
        make_private(self.folder)
