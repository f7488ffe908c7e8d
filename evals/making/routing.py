"""Requests of every class that a router distinguishes, one or several per request, and some outside the server's
scope."""

from collections.abc import Iterator, Mapping
from typing import Any

from .materials import STYLES, CorpusLine, Draw, rounds, styled

_QUESTIONS: Mapping[str, tuple[str, ...]] = {
    "qa": (
        "What is a CommonRoad scenario?",
        "What does a time to collision of 2 seconds mean?",
        "Which maps can I make scenarios from?",
        "What is the difference between a lanelet and a lane?",
    ),
    "param_qa": (
        "Which weights does Frenetix have?",
        "What does the prediction weight do?",
        "Which presets can the planner take?",
        "How does Comfort differ from Default?",
    ),
    "batch_qa": (
        "How many scenarios may a batch have?",
        "Which batches are there?",
        "Can a batch run two planners at once?",
        "What does a batch keep of each run?",
    ),
    "batch_sim": (
        "Run the planner on 20 scenarios as a batch.",
        "Start a batch over all scenarios of the last search.",
        "Simulate everything tagged urban with the current weights.",
        "Run the 10 scenario batch once more.",
    ),
    "param_mod": (
        "Use the Comfort preset.",
        "Set prediction to 0.5.",
        "Raise responsibility a little.",
        "Switch to the safety preset.",
    ),
    "analysis": (
        "Why did the last run fail?",
        "Which cost term was the largest in that run?",
        "When did the ego come closest to another vehicle?",
        "Explain how the run ended.",
    ),
    "batch_analysis": (
        "How many runs of the last batch reached the goal?",
        "Compare the last two batches.",
        "Which scenarios of the batch ended in a collision?",
        "Sum up the batch.",
    ),
    "fail": (
        "Order a pizza for the team.",
        "What will the weather be tomorrow?",
        "Write a poem about spring.",
        "Book a flight to Tokyo.",
    ),
}
_EDITS: Mapping[str, str] = {
    "T": "send vehicle {} to lanelet {}",
    "B": "make vehicle {} aggressive",
    "P": "remove vehicle {}",
    "G": "put the ego's goal on lanelet {}",
}
_CHAINS = (("param_mod", "batch_sim"), ("batch_sim", "batch_analysis"), ("vehicle_mod", "param_mod"))


def routing_lines(count: int, draw: Draw) -> Iterator[CorpusLine]:
    """Yield requests for each class in turn, with edits of one or several letters, and for two classes in sequence."""
    styles = rounds(STYLES, draw)
    kinds = rounds([*_QUESTIONS, "vehicle_mod", "vehicle_mod", "vehicle_mod_composite", "multi_step"], draw)
    drawn = {kind: rounds(texts, draw) for kind, texts in _QUESTIONS.items()}
    for _ in range(count):
        kind, style = next(kinds), next(styles)
        if kind in _QUESTIONS:
            text, truth = next(drawn[kind]), {"actions": [kind]}
        elif kind == "multi_step":
            text, truth = _chain(draw)
        else:
            text, truth = _edit(draw, several=kind == "vehicle_mod_composite")
        phrased = styled(text, text.rstrip(".?"), style, draw)
        expect: Any = "refuse" if kind == "fail" else "ok"
        yield CorpusLine("routing", phrased, truth, expect, kind, style, phrased)


def _edit(draw: Draw, *, several: bool) -> tuple[str, dict[str, Any]]:
    letters = sorted(draw.sample(sorted(_EDITS), 2 if several else 1), key="TBPG".index)
    parts = [_EDITS[letter].format(draw.randint(20, 400), draw.randint(1000, 9000)) for letter in letters]
    text = " and ".join(parts)
    return f"{text[0].upper()}{text[1:]}.", {"actions": ["vehicle_mod"], "vehicle_mod": "".join(letters)}


def _chain(draw: Draw) -> tuple[str, dict[str, Any]]:
    chosen = draw.choice(_CHAINS)
    truth: dict[str, Any] = {"actions": list(chosen)}
    parts = []
    for action in chosen:
        if action == "vehicle_mod":
            part, edit = _edit(draw, several=False)
            truth |= {"vehicle_mod": edit["vehicle_mod"]}
        else:
            part = draw.choice(_QUESTIONS[action])
        parts.append(part.rstrip(".?"))
    return f"{parts[0]}, then {parts[1][0].lower()}{parts[1][1:]}.", truth
