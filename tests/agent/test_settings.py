"""Settings of the agent: flags before variables, what they make of a model, and that the server's stay apart."""

import pytest
import typer

from plannerforge.agent.instructions import OUT_OF_SCOPE, own_instructions
from plannerforge.agent.models.interface import ModelFacts
from plannerforge.agent.settings import AgentSettings, agent_settings
from plannerforge.prompts.composition import system_prompt
from plannerforge.server.settings import Settings


@pytest.mark.parametrize(
    ("context_tokens", "parameters_billion", "tools", "why"),
    [
        (40_960, 8.2, "all", ""),
        (40_960, 4.0, "essential", "4 billion parameters"),
        (8_192, 70.0, "essential", "a context of 8,192 tokens"),
        (None, None, "all", ""),
    ],
)
def test_a_small_model_gets_the_essential_tools(
    context_tokens: int | None, parameters_billion: float | None, tools: str, why: str
) -> None:
    facts = ModelFacts(context_tokens, parameters_billion, tools=True, thinking=False)
    settings = AgentSettings()
    assert (settings.tool_set(facts), settings.small(facts)) == (tools, why)
    assert AgentSettings(tools="all").tool_set(facts) == "all"


def test_a_flag_wins_over_a_variable_that_the_server_does_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLANNERFORGE_AGENT_MODEL", "ollama:one")
    monkeypatch.setenv("PLANNERFORGE_AGENT_ROUNDS", "7")
    Settings()
    settings = agent_settings(model="ollama:two", host=None)
    assert (settings.model, settings.rounds, settings.for_turns(ModelFacts(None, None, True, True)).rounds) == (
        "ollama:two",
        7,
        7,
    )


@pytest.mark.parametrize(("word", "think"), [("auto", None), ("on", True), ("off", False)])
def test_thinking_is_left_to_the_model_or_set(word: str, think: bool | None) -> None:
    assert agent_settings(think=word).for_model().think is think


def test_words_may_be_in_any_case_and_a_wrong_one_names_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert agent_settings(think="ON", tools="Essential", condition="CP_cot").condition == "cp_cot"
    with pytest.raises(typer.Exit):
        agent_settings(think="maybe")
    said = capsys.readouterr().err
    assert all(word in said for word in ("'maybe'", "auto", "on", "off"))


@pytest.mark.parametrize(
    ("context_tokens", "characters"), [(None, 12_000), (40_960, 12_000), (8192, 8192), (512, 2000)]
)
def test_answers_of_tools_leave_room_in_a_small_context(context_tokens: int | None, characters: int) -> None:
    facts = ModelFacts(context_tokens, None, tools=True, thinking=False)
    assert AgentSettings().for_turns(facts).result_characters == characters


def test_a_key_is_not_shown() -> None:
    settings = AgentSettings(api_key="sk-secret")  # type: ignore[arg-type]
    assert "sk-secret" not in repr(settings)
    assert settings.for_model().api_key == "sk-secret"


def test_the_session_s_prompt_follows_the_agent_s_manners() -> None:
    manners, whole = own_instructions(), own_instructions("cp_icl")
    assert whole.startswith(manners)
    assert system_prompt("session", "cp_icl") in whole
    assert OUT_OF_SCOPE in manners
