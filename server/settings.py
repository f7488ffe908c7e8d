"""Settings: by flag, by environment (``PLANNERFORGE_…``), by ``plannerforge.toml``, in this order."""

import json
import os
import re
from pathlib import Path
from typing import Annotated, Any, Literal

from platformdirs import user_config_path, user_data_path
from pydantic import Field, field_validator
from pydantic_settings import (
    BaseSettings,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from ..engine.execution import Limits
from ..schemas.catalog import PACKAGED_MODEL

RECORDINGS_FOLDER = "recordings"
"""Where, in the workspace, workers keep what they read; it may be deleted at any time."""
_APPLICATION = "plannerforge"
_HUB_NAME = re.compile(r"[A-Za-z0-9][\w.-]*/[A-Za-z0-9][\w.-]*")
Folders = Annotated[tuple[Path, ...], NoDecode]
"""In a variable, folders are separated as in PATH, or a JSON list."""


class Settings(BaseSettings):
    """The settings of a server, read at its start. Every field is a flag, a variable and a key of the file."""

    model_config = SettingsConfigDict(env_prefix="PLANNERFORGE_", extra="forbid", frozen=True)

    workspace: Path = Field(
        default_factory=lambda: user_data_path(_APPLICATION), description="folder for everything that is made"
    )
    roots: Folders = Field(
        (), description="folders that files may be read from and written to; default: workspace and start folder"
    )
    map_folders: Folders = Field((), description="folders with .osm maps, beside the built-in ones")
    starter: bool = Field(True, description="put the starter scenarios into a new workspace")
    workers: int = Field(2, ge=1, le=64, description="worker processes for simulation and planning")
    worker_memory_mb: int = Field(4096, ge=512, description="data memory of one worker process")
    operation_timeout_s: float = Field(300.0, gt=0, le=3600, description="time limit of one operation in a worker")
    file_mb: int = Field(100, ge=1, description="largest file that is read")
    embedding_model: str = Field(
        PACKAGED_MODEL, description="what ranks by text: a folder or a hub name that sentence-transformers loads"
    )
    warm_up: bool = Field(True, description="start workers and make the text index ready before they are asked for")
    tools: Literal["all", "essential"] = Field("all", description="essential: the small set for small models")
    read_only: bool = Field(False, description="offer only tools that make nothing")
    journal: bool = Field(True, description="write one line per call into the workspace's journal")
    journal_mb: int = Field(20, ge=1, description="size at which the journal is rotated; five are kept")
    journal_redact: tuple[str, ...] = Field(
        (), description="regular expressions of what the journal leaves out, beside keys, tokens and passwords"
    )
    server_memory_mb: int = Field(1024, ge=256, description="data memory of the server's own process")
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] = Field("WARNING", description="what goes to stderr")

    @field_validator("roots", "map_folders", mode="before")
    @classmethod
    def _separated(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if not value.lstrip().startswith("["):
            return [part for part in value.split(os.pathsep) if part]
        try:
            return json.loads(value)
        except json.JSONDecodeError as error:
            raise ValueError(f"'{value}' begins like a JSON list of folders and is none: {error}") from error

    @field_validator("journal_redact")
    @classmethod
    def _expressions(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for pattern in value:
            try:
                re.compile(pattern)
            except re.error as error:
                raise ValueError(f"'{pattern}' is no regular expression: {error}") from error
        return value

    @field_validator("embedding_model")
    @classmethod
    def _known_model(cls, value: str) -> str:
        folder = Path(value).expanduser()
        if (folder / "config.json").is_file():
            return str(folder.resolve())
        if value == PACKAGED_MODEL or (_HUB_NAME.fullmatch(value) and not folder.exists()):
            return value
        raise ValueError(
            f"'{value}' is neither {PACKAGED_MODEL}, nor a folder with a model, nor 'owner/model' on the hub"
        )

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Flags win over the environment, the environment over the file."""
        del dotenv_settings, file_secret_settings
        file = TomlConfigSettingsSource(settings_cls, settings_file())
        return init_settings, env_settings, file

    def limits(self, start_folder: Path) -> Limits:
        """The bounds of every call."""
        roots = self.roots or (start_folder,)
        return Limits(
            roots=tuple(dict.fromkeys(root.expanduser().resolve() for root in (*roots, self.workspace))),
            worker_count=self.workers,
            worker_memory_bytes=self.worker_memory_mb * 1024**2,
            operation_timeout_s=self.operation_timeout_s,
            file_bytes=self.file_mb * 1024**2,
            recordings=self.workspace.expanduser().resolve() / RECORDINGS_FOLDER,
        )


def settings_file() -> Path:
    """Where the settings file is looked for."""
    return user_config_path(_APPLICATION) / "plannerforge.toml"
