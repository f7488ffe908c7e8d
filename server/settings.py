"""Settings from flags, environment variables (``PLANNERFORGE_…``) or ``plannerforge.toml``, in this order."""

import json
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from platformdirs import user_config_path, user_data_path
from pydantic import Field, SecretStr, ValidationInfo, field_validator
from pydantic_settings import (
    BaseSettings,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from .. import __version__
from ..engine.execution import Limits
from ..schemas.catalog import PACKAGED_MODEL, PACKAGED_MODELS
from ..schemas.maps import NOMINATIM_URL, OVERPASS_URLS, MapServices, OnlineMode
from ..schemas.planning import CommandPlanner
from ..schemas.text import in_any_case

if TYPE_CHECKING:
    from ..workflows.services import ServiceOptions

RECORDINGS_FOLDER = "recordings"
"""The workspace's folder in which workers cache what they read; it may be deleted at any time."""
_APPLICATION = "plannerforge"
_HUB_NAME = re.compile(r"[A-Za-z0-9][\w.-]*/[A-Za-z0-9][\w.-]*")
_ADDRESS = re.compile(r"https?://[A-Za-z0-9.\-]+(:\d{1,5})?(/[A-Za-z0-9._~/\-]*)?")
ANSWERS_FOLDER = "answers"
"""The workspace's folder in which answers of map services are cached; it may be deleted at any time."""
LogFormat = Literal["text", "json"]
Addresses = Annotated[tuple[str, ...], NoDecode]
"""In a variable, addresses are separated by commas or spaces, or are a JSON list."""
Secrets = Annotated[tuple[SecretStr, ...], NoDecode]
"""In a variable, secrets are separated by commas or line breaks, or are a JSON list."""
Folders = Annotated[tuple[Path, ...], NoDecode]
"""In a variable, folders are separated as in PATH, or are a JSON list."""


class Settings(BaseSettings):
    """The settings of a server, read at its start: each is a variable, a key of the file and, unless secret, a flag."""

    model_config = SettingsConfigDict(env_prefix="PLANNERFORGE_", extra="forbid", frozen=True)

    workspace: Path = Field(
        default_factory=lambda: user_data_path(_APPLICATION), description="folder in which everything is stored"
    )
    workspace_mb: int = Field(
        0,
        ge=0,
        description="size limit of the workspace (0: no limit); when it is full, the server removes caches, then "
        "refuses calls that store something",
    )
    roots: Folders = Field(
        (), description="folders where files may be read and written; default: the workspace and the start folder"
    )
    map_folders: Folders = Field((), description="folders with .osm maps, in addition to the built-in maps")
    starter: bool = Field(True, description="add the starter scenarios to a new workspace")
    workers: int = Field(2, ge=1, le=64, description="number of worker processes for simulation and planning")
    cluster: str = Field(
        "", description="Dask scheduler for runs and generation: tcp://host:8786, or the path of a scheduler file"
    )
    planners: dict[str, CommandPlanner] = Field(
        default_factory=dict, description="your own planner programs, each in a section [planners.NAME]"
    )
    worker_memory_mb: int = Field(4096, ge=512, description="maximum data memory of each worker process")
    operation_timeout_s: float = Field(300.0, gt=0, le=3600, description="time limit for an operation in a worker")
    file_mb: int = Field(100, ge=1, description="maximum size of a file that the server reads")
    embedding_model: str = Field(
        PACKAGED_MODEL,
        description="model for text search: packaged, or its English half all-MiniLM-L6-v2; with the extra embeddings, "
        "also a folder or hub name that sentence-transformers can load",
    )
    warm_up: bool = Field(True, description="start workers and load the text index in advance")
    maps_online: OnlineMode = Field(
        "online",
        description="for places that no local map covers: online asks services, cache uses only cached answers, "
        "offline refuses",
    )
    nominatim_url: str = Field(NOMINATIM_URL, description="map service that finds places by name")
    overpass_urls: Addresses = Field(OVERPASS_URLS, description="map services that provide roads, in the order of use")
    maps_user_agent: str = Field(
        f"PlannerForge-MCP/{__version__} (scenario-based testing of motion planners; by osmnx)",
        min_length=8,
        description="name that map services receive; add your contact address",
    )
    maps_delay_s: float = Field(1.0, ge=0, le=3600, description="minimum time between requests to the same map service")
    maps_timeout_s: float = Field(30.0, ge=1, le=300, description="time limit for a request to a map service")
    maps_cache_mb: int = Field(500, ge=1, description="maximum size of cached answers from map services")
    maps_cache_days: float = Field(90.0, gt=0, description="age at which a cached answer is requested again")
    maps_km2: float = Field(10.0, ge=1, le=100, description="maximum area that is fetched at once")
    tools: Literal["all", "essential"] = Field(
        "all", description="tools to offer; essential: a small set for small models"
    )
    read_only: bool = Field(False, description="offer only tools that create nothing")
    links: bool = Field(
        True, description="link new artifacts in answers; turn this off if your host can't handle links"
    )
    journal: bool = Field(True, description="record each call in the workspace's journal")
    journal_mb: int = Field(20, ge=1, description="size at which the server starts a new journal file; it keeps five")
    journal_redact: tuple[str, ...] = Field(
        (),
        description="regular expressions for text to remove from journal and log, in addition to keys, tokens and "
        "passwords",
    )
    http_host: str = Field(
        "127.0.0.1", description="address on which serve --http listens; all except loopback require a token"
    )
    http_port: int = Field(8765, ge=0, le=65535, description="port on which serve --http listens; 0: any free port")
    http_url: str = Field("", description="URL that clients use, such as https://forge.example.org/mcp")
    http_hosts: Addresses = Field((), description="Host headers to accept, in addition to this machine's own names")
    http_origins: Addresses = Field((), description="Origin headers to accept from web pages")
    http_tokens: Secrets = Field((), description="bearer tokens, separated by commas: NAME TOKEN [read-only]")
    http_token_file: Path | None = Field(None, description="file with a bearer token per line: NAME TOKEN [read-only]")
    http_proxies: Addresses = Field((), description="addresses of proxies that may set X-Forwarded-For")
    http_body_mb: int = Field(4, ge=1, le=64, description="maximum size of an HTTP request")
    http_calls: int = Field(16, ge=1, le=256, description="maximum concurrent HTTP requests per client")
    http_rate: float = Field(100.0, ge=1, description="maximum HTTP requests per second and client")
    http_stop_s: float = Field(10.0, ge=0, le=600, description="time that calls in progress get when the server stops")
    oauth_issuer: str = Field("", description="OAuth authorization server for tokens; needs http_url")
    oauth_keys_url: str = Field("", description="URL of the issuer's public keys; default: from its metadata")
    server_memory_mb: int = Field(1024, ge=256, description="maximum data memory of the server process")
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] = Field(
        "WARNING", description="lowest level of logged messages"
    )
    log_format: LogFormat = Field("text", description="format of the log lines")
    telemetry_endpoint: str = Field(
        "", description="OpenTelemetry collector for traces and metrics, such as http://127.0.0.1:4318"
    )

    @field_validator("maps_online", "tools", "log_level", "log_format", mode="before")
    @classmethod
    def _any_case(cls, value: Any, info: ValidationInfo) -> Any:
        return in_any_case(value, get_args(cls.model_fields[str(info.field_name)].annotation))

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
            raise ValueError(f"'{value}' begins like a JSON list of folders but is not one: {error}") from error

    @field_validator("planners", mode="before")
    @classmethod
    def _sections(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return json.loads(value)
        except json.JSONDecodeError as error:
            raise ValueError(f"'{value}' is not a JSON object of planners: {error}") from error

    @field_validator("overpass_urls", "http_hosts", "http_origins", "http_proxies", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return _listed_texts(value) if isinstance(value, str) else value

    @field_validator("nominatim_url", "overpass_urls")
    @classmethod
    def _addresses(cls, value: Any) -> Any:
        every = (value,) if isinstance(value, str) else value
        wrong = next((address for address in every if not _ADDRESS.fullmatch(address)), None)
        if wrong is not None or not every:
            raise ValueError(f"'{wrong or ''}' is not an address such as {NOMINATIM_URL}")
        return value

    @field_validator("http_tokens", mode="before")
    @classmethod
    def _secrets(cls, value: Any) -> Any:
        if not isinstance(value, str) or value.lstrip().startswith("["):
            return _listed_texts(value) if isinstance(value, str) else value
        return [part.strip() for part in re.split(r"[,\n]", value) if part.strip()]

    @field_validator("http_url", "oauth_issuer", "oauth_keys_url", "telemetry_endpoint")
    @classmethod
    def _one_address(cls, value: str) -> str:
        if value and not _ADDRESS.fullmatch(value):
            raise ValueError(f"'{value}' is not an address such as https://forge.example.org/mcp")
        return value

    @field_validator("journal_redact")
    @classmethod
    def _expressions(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for pattern in value:
            try:
                re.compile(pattern)
            except re.error as error:
                raise ValueError(f"'{pattern}' is not a regular expression: {error}") from error
        return value

    @field_validator("embedding_model")
    @classmethod
    def _known_model(cls, value: str) -> str:
        folder = Path(value).expanduser()
        if (folder / "config.json").is_file():
            return str(folder.resolve())
        if value in PACKAGED_MODELS or (_HUB_NAME.fullmatch(value) and not folder.exists()):
            return value
        raise ValueError(
            f"'{value}' is neither {' nor '.join(PACKAGED_MODELS)}, "
            "nor a folder with a model, nor 'owner/model' on the hub"
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
        """Return the sources of settings: flags override the environment, and the environment overrides the file."""
        del dotenv_settings, file_secret_settings
        file = TomlConfigSettingsSource(settings_cls, settings_file())
        return init_settings, env_settings, file

    def map_services(self) -> MapServices:
        """Return the map services and how to use them."""
        return MapServices(
            mode=self.maps_online,
            nominatim_url=self.nominatim_url.rstrip("/"),
            overpass_urls=tuple(url.rstrip("/") for url in self.overpass_urls),
            user_agent=self.maps_user_agent,
            delay_s=self.maps_delay_s,
            timeout_s=self.maps_timeout_s,
            cache=str(self.workspace.expanduser().resolve() / ANSWERS_FOLDER),
            cache_mb=self.maps_cache_mb,
            cache_days=self.maps_cache_days,
            most_km2=self.maps_km2,
        )

    def limits(self, start_folder: Path) -> Limits:
        """Return the limits of every call."""
        roots = self.roots or (start_folder,)
        return Limits(
            roots=tuple(dict.fromkeys(root.expanduser().resolve() for root in (*roots, self.workspace))),
            worker_count=self.workers,
            worker_memory_bytes=self.worker_memory_mb * 1024**2,
            operation_timeout_s=self.operation_timeout_s,
            file_bytes=self.file_mb * 1024**2,
            recordings=self.workspace.expanduser().resolve() / RECORDINGS_FOLDER,
        )

    def service_options(self, start_folder: Path) -> "ServiceOptions":
        """Return the options for opening services."""
        from ..workflows.services import ServiceOptions  # only needed where services are opened

        return ServiceOptions(
            workspace=self.workspace.expanduser().resolve(),
            limits=self.limits(start_folder),
            workspace_bytes=self.workspace_mb * 1024**2,
            cluster=self.cluster,
            planners=self.planners,
            map_folders=self.map_folders,
            with_starter=self.starter,
            embedding_model=self.embedding_model,
            online=self.map_services(),
            links=self.links,
        )


def _listed_texts(value: str) -> Any:
    if not value.lstrip().startswith("["):
        return [part for part in re.split(r"[,\s]+", value) if part]
    try:
        return json.loads(value)
    except json.JSONDecodeError as error:
        raise ValueError(f"'{value}' begins like a JSON list of addresses but is not one: {error}") from error


def settings_file() -> Path:
    """Return the path of the settings file."""
    return user_config_path(_APPLICATION) / "plannerforge.toml"
