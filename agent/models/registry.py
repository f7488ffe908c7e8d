"""Models by name: ``ollama:MODEL`` and ``openai:MODEL@URL``; what a name needs is imported when it is opened."""

import importlib
from collections.abc import Callable
from typing import cast

from ...schemas.errors import closest
from ...schemas.text import quoted
from ..errors import SettingsFault
from .interface import ChatModel, ModelSettings

MODEL_SERVERS = {"ollama": ".ollama_model:OllamaModel", "openai": ".openai_model:OpenAIModel"}
"""By the word before the colon: a class that takes what stands behind it, and the settings."""
MODEL_FORMS = ("ollama:MODEL", "openai:MODEL@URL")


def open_model(name: str, settings: ModelSettings) -> ChatModel:
    """The model of a name such as ``ollama:qwen3:8b`` or ``openai:my-model@http://localhost:8000/v1``.

    Raises:
        SettingsFault: the name has none of the forms, or the package that it needs is missing.
    """
    server, colon, rest = name.partition(":")
    if not (colon and rest and server in MODEL_SERVERS):
        problem = f"{quoted(name)} names no model" if name else "no model is named"
        known = MODEL_FORMS if not colon else closest(server, MODEL_FORMS)
        raise SettingsFault(
            problem, valid=known, next_step="name one by --model or PLANNERFORGE_AGENT_MODEL, such as ollama:qwen3:8b"
        )
    module, _, attribute = MODEL_SERVERS[server].partition(":")
    maker = getattr(importlib.import_module(module, __package__), attribute)
    return cast("Callable[[str, ModelSettings], ChatModel]", maker)(rest, settings)
