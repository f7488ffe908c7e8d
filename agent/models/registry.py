"""Looks up models by name (``ollama:MODEL``, ``openai:MODEL@URL``), and imports a client only when it opens a model."""

import importlib
from collections.abc import Callable
from typing import cast

from ...schemas.errors import closest
from ...schemas.text import quoted
from ..errors import SettingsFault
from .interface import ChatModel, ModelSettings

MODEL_SERVERS = {"ollama": ".ollama_model:OllamaModel", "openai": ".openai_model:OpenAIModel"}
"""Maps the word before the colon to a class that takes the rest of the name, and the settings."""
MODEL_FORMS = ("ollama:MODEL", "openai:MODEL@URL")


def open_model(name: str, settings: ModelSettings) -> ChatModel:
    """Return the model with a name such as ``ollama:qwen3:8b`` or ``openai:my-model@http://localhost:8000/v1``.

    Raises:
        SettingsFault: The name has no valid form, or a required package is missing.
    """
    server, colon, rest = name.partition(":")
    if not (colon and rest and server in MODEL_SERVERS):
        problem = f"{quoted(name)} is not a model name" if name else "no model is given"
        known = MODEL_FORMS if not colon else closest(server, MODEL_FORMS)
        raise SettingsFault(
            problem, valid=known, next_step="give one in --model or PLANNERFORGE_AGENT_MODEL, such as ollama:qwen3:8b"
        )
    module, _, attribute = MODEL_SERVERS[server].partition(":")
    maker = getattr(importlib.import_module(module, __package__), attribute)
    return cast("Callable[[str, ModelSettings], ChatModel]", maker)(rest, settings)
