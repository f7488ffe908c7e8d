"""Settings of the agent, from flags or the environment (``PLANNERFORGE_AGENT_…``); flags take precedence."""

from typing import Any, Literal, get_args

import typer
from pydantic import Field, SecretStr, ValidationError, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from ..schemas.base import problems_of
from ..schemas.text import in_any_case
from .connection import ToolSet
from .loop import TurnLimits
from .models.interface import ModelFacts, ModelSettings

SMALL_CONTEXT_TOKENS = 12_000
"""Chosen: the full list of tools takes 4,000 tokens, and a session of ten calls takes another 4,000."""

_LEAST_RESULT_CHARACTERS = 2000
"""Minimum characters of a tool's answer, whatever the context. In a larger context, an answer may have as many
characters as the context has tokens, which takes about a quarter of it (chosen).
"""


class AgentSettings(BaseSettings):
    """The settings of an agent, read at its start. Every field is a variable; the common ones are also flags."""

    model_config = SettingsConfigDict(env_prefix="PLANNERFORGE_AGENT_", frozen=True)

    model: str = Field("", description="ollama:MODEL, or openai:MODEL@URL")
    host: str = Field("", description="Ollama's address; default: OLLAMA_HOST or this machine")
    api_key: SecretStr = Field(SecretStr(""), description="key of an OpenAI-compatible server; default: OPENAI_API_KEY")
    think: Literal["auto", "on", "off"] = Field(
        "auto", description="whether the model thinks before it answers; auto: its default"
    )
    context_tokens: int = Field(
        0, ge=0, description="size of the model's context in tokens; 0: its own, at most 16,384"
    )
    answer_tokens: int = Field(4096, ge=64, description="longest answer in tokens, including thinking")
    keep_alive: str = Field("5m", description="how long Ollama keeps the model in memory, such as 5m; -1: forever")
    temperature: float | None = Field(None, ge=0, le=2, description="default: the model's own")
    seed: int | None = Field(None, description="for the model's sampling; default: none")
    silence_s: float = Field(300.0, gt=0, description="longest wait for the model's next data")
    rounds: int = Field(24, ge=1, description="most model calls in a turn")
    turn_tokens: int = Field(500_000, ge=1000, description="most tokens of a turn, including prompts and answers")
    turn_s: float = Field(1800.0, gt=0, description="longest turn")
    repeats: int = Field(2, ge=1, description="how often the same call may give the same answer in a turn")
    history_tokens: int = Field(
        125_000, ge=500, description="length of the conversation from which the model summarises it"
    )
    result_characters: int = Field(12_000, ge=200, description="most characters of a tool's answer that the model sees")
    tools: Literal["auto", "all", "essential"] = Field(
        "auto", description="tools of PlannerForge's own server; auto: the essential ones for a small model"
    )
    small_parameters_billion: float = Field(7.0, ge=0, description="a model with fewer parameters is small")
    condition: Literal["none", "baseline", "cp", "cp_cot", "cp_icl", "cp_icl_cot"] = Field(
        "cp",
        description="session prompt in addition to the agent's own text, for PlannerForge's own server; none: without",
    )
    server: str = Field("", description="command that starts another MCP server")
    url: str = Field("", description="address of an MCP server (streamable HTTP)")

    @field_validator("think", "tools", "condition", mode="before")
    @classmethod
    def _any_case(cls, value: Any, info: ValidationInfo) -> Any:
        return in_any_case(value, get_args(cls.model_fields[str(info.field_name)].annotation))

    def for_model(self) -> ModelSettings:
        """Return the options of requests to the model."""
        return ModelSettings(
            host=self.host,
            api_key=self.api_key.get_secret_value(),
            think=None if self.think == "auto" else self.think == "on",
            context_tokens=self.context_tokens,
            answer_tokens=self.answer_tokens,
            keep_alive=self.keep_alive,
            temperature=self.temperature,
            seed=self.seed,
            silence_s=self.silence_s,
        )

    def for_turns(self, facts: ModelFacts | None = None) -> TurnLimits:
        """Return the limits of a turn; tool answers must leave space in the model's context."""
        context_tokens = facts.context_tokens if facts is not None else None
        room = max(context_tokens or self.result_characters, _LEAST_RESULT_CHARACTERS)
        return TurnLimits(
            rounds=self.rounds,
            tokens=self.turn_tokens,
            turn_s=self.turn_s,
            repeats=self.repeats,
            answer_tokens=self.answer_tokens,
            result_characters=min(self.result_characters, room),
            history_tokens=self.history_tokens,
        )

    def small(self, facts: ModelFacts) -> str:
        """Return why a model is too small for the full list of tools; empty if it is not."""
        size, context = facts.parameters_billion, facts.context_tokens
        if context is not None and context < SMALL_CONTEXT_TOKENS:
            return f"a context of {context:,} tokens"
        if size is not None and size < self.small_parameters_billion:
            return f"{size:g} billion parameters"
        return ""

    def tool_set(self, facts: ModelFacts) -> ToolSet:
        """Return the model's set of tools from PlannerForge's own server."""
        if self.tools == "auto":
            return "essential" if self.small(facts) else "all"
        return self.tools


def agent_settings(**flags: Any) -> AgentSettings:
    """Return settings with the given flags; an invalid flag or variable ends the program with one line."""
    try:
        return AgentSettings(**{name: value for name, value in flags.items() if value is not None})
    except ValidationError as error:
        faults = zip(error.errors(include_url=False), problems_of(AgentSettings, error, "setting"), strict=True)
        problems = "; ".join(
            f"{problem} (valid: {', '.join(valid)})" if detail["type"] == "literal_error" else problem
            for detail, (problem, valid) in faults
        )
        typer.echo(f"plannerforge: {problems}", err=True)
        raise typer.Exit(2) from None
