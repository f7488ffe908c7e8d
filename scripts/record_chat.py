"""Record ``docs/chat.md``, a chat through five stages: ``make chat-page``.

The program, the tools and their answers are real. The model is a script behind the tests' local Ollama, because the
package includes no model. It makes the calls of a good model, one of them wrong at first, and repeats the tools'
answers.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(CHECKOUT / "tests"))

from support.model_servers import Reply, serving  # noqa: E402 - the tests are no package

TARGET = CHECKOUT / "docs" / "chat.md"
SHOWN_WORKSPACE = "~/plannerforge"
HEAD = """\
# A chat

This page is a recording of `plannerforge chat` in five stages: generate, describe, modify, run and compare. The
program, the tools and their answers are real. The package includes no model, so a script takes its place, behind a
local server that speaks Ollama's protocol. It makes the calls that a good model would make, including one wrong call
that it corrects, and repeats the tools' answers. [The agent](agent.md) explains how to use your own model. To record
the page again, run `make chat-page` (`scripts/record_chat.py`).

```
$ plannerforge chat --model ollama:big:70b
"""

Answers = Sequence[str]
"""The tools' answers in this turn so far."""
Turn = Callable[[Answers, str], Reply]
"""The model's next message, from those answers and the current ids."""


def call(tool: str, **arguments: Any) -> Reply:
    """Return a message that makes a call."""
    return Reply(calls=((tool, arguments),))


def first_words(text: str, lines: int = 1) -> str:
    """Return the first lines of a tool's answer, as a model repeats them."""
    return "\n".join(line.strip() for line in text.splitlines()[:lines])


def refuse(answers: Answers, state: str) -> Reply:
    """Refuse a request that is out of scope."""
    del answers, state
    return Reply("Out of scope: I work on driving scenarios and motion planners.")


def generate(answers: Answers, state: str) -> Reply:
    """Generate a scenario; the first call names a place that no map covers."""
    del state
    if not answers:
        return call("generate_scenarios", place="Springfield", scenario_type="signalised_intersection", duration_s=12)
    if len(answers) == 1:
        wanted = {"scenario_type": "signalised_intersection", "density": "medium", "vehicles": ["truck=2"]}
        return call("generate_scenarios", **wanted, duration_s=12, seed=7)
    return Reply(f"There is no map of Springfield, so I took a built-in one.\n{first_words(answers[-1], 2)}")


def look(answers: Answers, state: str) -> Reply:
    """Describe and render the scenario."""
    scenario = state_of(state, "scenario")
    if not answers:
        return call("describe_scenario", scenario_id=scenario)
    if len(answers) == 1:
        return call("render", ids=[scenario])
    return Reply(first_words(answers[0], 3))


def modify(answers: Answers, state: str) -> Reply:
    """Make a driver aggressive and add a truck."""
    edits = [
        {"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": "aggressive"},
        {"op": "add_vehicle", "vehicle_class": "truck", "at": "ego", "lane": "same", "offset_m": -20},
    ]
    if not answers:
        return call("modify_scenario", scenario_id=state_of(state, "scenario"), edits=edits)
    return Reply(first_words(answers[-1], 3))


def run(answers: Answers, state: str) -> Reply:
    """Run two configurations, and wait for the job if there is one."""
    if not answers:
        return call("configure_planner", preset="Safety-Conservative")
    if len(answers) == 1:
        config = re.findall(r"cfg_\w+", answers[0])[0]
        scenario = state_of(state, "scenario")
        return call("run_planner", scenarios=[scenario], configs=["frenetix:Default", config], wait_s=40)
    if "running" in answers[-1].splitlines()[0]:
        return call("get_job", job_id="latest", wait_s=40)
    return Reply(first_words(answers[-1], 3))


def compare(answers: Answers, state: str) -> Reply:
    """Compare the two."""
    if not answers:
        return call("compare_results", results=[state_of(state, "batch")])
    return Reply(first_words(answers[-1], 3))


STAGES: Mapping[str, Turn] = {
    "Write me a poem about the sea.": refuse,
    "I need a 12 s scenario at a signalised intersection in Springfield, with medium traffic and two trucks.": generate,
    "What is going on there? Show me.": look,
    "Make the nearest driver aggressive and put a truck 20 m behind the ego.": modify,
    "Run Frenetix on it, with its default and with the Safety-Conservative preset.": run,
    "Which of the two is better?": compare,
}


def state_of(line: str, kind: str) -> str:
    """Return the current id of a kind from the line of current ids.

    Raises:
        LookupError: the line has no id of this kind.
    """
    found = re.search(rf"\b{kind} ([\w.-]+)", line)
    if found is None:
        raise LookupError(f"no {kind} in {line!r}")
    return found[1]


def script(request: Mapping[str, Any]) -> Reply:
    """Return the model's message for the stage that the user's text starts."""
    messages = request["messages"]
    last = max(number for number, message in enumerate(messages) if message["role"] == "user")
    typed, _, state = messages[last]["content"].partition("\n\n")
    answers = [message["content"] for message in messages[last:] if message["role"] == "tool"]
    return STAGES[typed](answers, state)


def record() -> str:
    """Return the session as the terminal shows it."""
    lines = [line for text in STAGES for line in (text, *(["/state"] if text.startswith("Which") else []))]
    with serving("ollama", script) as server, tempfile.TemporaryDirectory() as folder:
        program = "from plannerforge.cli.main import main; main()"
        flags = ["--model", "ollama:big:70b", "--host", server.url, "--workspace", folder]
        done = subprocess.run(
            [sys.executable, "-c", program, "chat", *flags],
            input="\n".join([*lines, "/quit", ""]),
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": str(CHECKOUT), "COLUMNS": "118", "PLANNERFORGE_MAPS_ONLINE": "offline"},
        )
    text = done.stdout.replace(str(Path(folder).resolve()), SHOWN_WORKSPACE)
    return re.sub(r"chats/\d{4}-\d\d-\d\d-\d{6}", "chats/2026-11-23-091500", text)


if __name__ == "__main__":
    TARGET.write_text(f"{HEAD}{record().rstrip()}\n```\n", encoding="utf-8")
