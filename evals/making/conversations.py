"""Conversations of several turns; each turn builds on the results of the previous turns."""

from collections.abc import Iterator, Mapping
from typing import Any

from ...engine.cosimulation import presets
from ...engine.tuning import tuning_of
from .generation import generation_lines
from .materials import CorpusLine, Draw, Materials, rounds
from .modification import PossibleEdits, words_of
from .selection import plain_search

Turn = dict[str, Any]
_STARTS = ("generate", "select_by_id", "select_by_slots")


def conversation_lines(materials: Materials, possible: PossibleEdits, count: int, draw: Draw) -> Iterator[CorpusLine]:
    """Yield conversations of five or six turns: get a scenario, edit it, run a planner, tune it, run again, compare."""
    generated = (line for line in generation_lines(materials, 4 * count, draw) if line.expect == "ok")
    editable = rounds(materials.scenarios, draw)
    starts = rounds(_STARTS, draw)
    for _ in range(count):
        start = next(starts)
        if start == "generate":
            first = next(generated)
            turns, about, fields = [_turn("generate", first.text, first.truth)], first.about, dict(first.fields)
            turns.append(_edit_at_run_time(draw))
        elif start == "select_by_slots":
            text, truth = plain_search(materials, draw)
            turns, about, fields = [_turn("select", text, truth)], text, {}
        else:
            one = next(editable)
            edits = next((possible.of(one)[key] for key in ("B", "P") if key in possible.of(one)), None)
            truth = {"scenario": one.name}
            turns, about = [_turn("select", f"Load {one.facts.scenario_id}.", truth)], one.name
            fields = {"scenario": one.name}
            if edits:
                text = " and ".join(words_of(edit) for edit in edits)
                turns.append(_turn("modify", f"{text[0].upper()}{text[1:]}.", {"edits": list(edits)}))
        where = "first_match" if start == "select_by_slots" else "latest"
        yield _conversation(start, [*turns, *_tested(len(turns), where, draw)], about, fields)


def _turn(action: str, text: str, truth: Mapping[str, Any]) -> Turn:
    return {"text": text, "action": action, "truth": dict(truth), "expect": "ok"}


def _edit_at_run_time(draw: Draw) -> Turn:
    preset, number = draw.choice(sorted(presets())), draw.choice((1, 2, 3))
    edit: dict[str, Any] = {
        "op": "set_behaviour",
        "selector": {"by": "nearest_to_ego", "n": number},
        "preset": preset,
        "expected_params": presets()[preset],
        "vehicle_ids": None,
    }
    truth = {"edits": [edit], "resolve": "at_run_time", "scenario": "latest"}
    text = words_of(edit) if number > 1 else f"give the vehicle nearest to the ego the {preset} behaviour"
    return _turn("modify", f"{text[0].upper()}{text[1:]}.", truth)


def _tested(before: int, scenario: str, draw: Draw) -> list[Turn]:
    """Return turns that request a run, a configuration change, the run again, and a comparison or an analysis."""
    names = sorted(tuning_of("frenetix").presets)
    weights = dict(tuning_of("frenetix").presets["Default"].weights)
    run = {
        "planner": "frenetix",
        "preset": "Default",
        "preset_named": False,
        "traffic": "recorded",
        "scenario": scenario,
        "mode": "single",
        "expected_weights": weights,
    }
    turns = [_turn("test", draw.choice(("Run Frenetix on it.", "Test the planner.", "Now simulate that.")), run)]
    if draw.random() < 0.5:
        name = draw.choice([one for one in names if one != "Default"])
        after = dict(tuning_of("frenetix").presets[name].weights)
        tune: dict[str, Any] = {"planner": "frenetix", "preset": name, "weights": {}, "expected_weights": after}
        text = f"Use the {name} preset."
    else:
        name = "Default"
        changed = {draw.choice(("prediction", "responsibility", "velocity_offset")): round(draw.uniform(0.3, 2.0), 1)}
        after = weights | changed
        tune = {"planner": "frenetix", "preset": None, "weights": changed, "expected_weights": after}
        text = "Set " + " and ".join(f"{key} to {value:g}" for key, value in changed.items()) + "."
    turns.append(_turn("tune", text, tune))
    turns.append(_turn("test", "Run it again.", {**run, "preset": name, "expected_weights": after}))
    first, second = before + 1, before + 3
    if draw.random() < 0.6:
        turns.append(_turn("compare", "Which of the two runs is better?", {"between_turns": [first, second]}))
    else:
        asks = {"about_turn": second, "asks": ["outcome"]}
        turns.append(_turn("analyse", "How did the last run end?", asks))
    return turns


def _conversation(start: str, turns: list[Turn], about: str, fields: Mapping[str, Any]) -> CorpusLine:
    actions = [turn["action"] for turn in turns]
    numbered = [{"turn": number, **turn} for number, turn in enumerate(turns, start=1)]
    text = "\n".join(turn["text"] for turn in turns)
    truth = {"actions": actions, "start": start, "refused_turns": []}
    category = f"{start}:{'>'.join(actions)}"
    return CorpusLine("e2e", text, truth, "ok", category, "normal", about, {**fields, "turns": numbered})
