"""Hostile arguments, derived from each tool's JSON schema and from the grammars of some arguments."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from . import texts
from .inputs import MADE, ROOT, Call, Chance, HostileInput

_SHARE_OF_SCHEMA = 0.6
"""Share of the inputs derived from schemas; the others are sentences of the grammars (chosen)."""
_Text = Callable[[Chance], str]
_GRAMMARS: dict[str, dict[str, _Text]] = {
    "find_scenarios": {
        "tags": texts.condition,
        "features": texts.condition,
        "road_net": texts.condition,
        "obstacles": texts.condition,
        "ego_speed": texts.interval,
        "country": texts.place_name,
        "city": texts.place_name,
        "text": texts.any_text,
        "within": texts.any_text,
        "like": texts.any_text,
    },
    "configure_planner": {
        "planner": texts.name,
        "preset": texts.name,
        "weights": texts.assignment,
        "settings": texts.assignment,
        "base": texts.any_text,
    },
    "generate_scenarios": {
        "place": texts.place_name,
        "country": texts.place_name,
        "road_classes": texts.name,
        "vehicles": texts.condition,
        "ego": texts.goal,
        "goal": texts.goal,
    },
    "analyze_results": {"results": texts.any_text, "where": texts.condition},
    "compare_results": {"results": texts.any_text, "metrics": texts.name},
    "run_planner": {"scenarios": texts.any_text, "configs": texts.name},
    "describe_scenario": {"focus": texts.selector, "scenario_id": texts.any_text},
}
_EDIT_GRAMMAR: dict[str, _Text] = {
    "vehicles": texts.selector,
    "to": texts.place,
    "via": texts.place,
    "preset": texts.name,
    "params": texts.assignment,
    "vehicle_class": texts.name,
    "at": texts.place,
    "position": texts.quantity,
    "speed": texts.quantity,
    "goal_time": texts.interval,
    "goal_speed": texts.interval,
}
_EDIT_ARGUMENTS: dict[str, tuple[str, ...]] = {
    "reroute": ("vehicles", "to", "via", "turn"),
    "change_lane": ("vehicles", "lane", "time_s"),
    "set_speed": ("vehicles", "speed", "time_s"),
    "shift_time": ("vehicles", "time_s"),
    "set_behaviour": ("vehicles", "preset", "params"),
    "add_vehicle": ("vehicle_class", "count", "spacing_m", "at", "lane", "offset_m", "position", "speed", "params"),
    "remove_vehicle": ("vehicles",),
    "set_goal": ("to", "position", "rectangle_m", "goal_time", "goal_speed"),
    "set_ego": ("vehicles", "at", "offset_m", "position", "speed", "former_ego"),
}
_PLAIN: dict[str, Any] = {
    "vehicles": ["nearest:1"],
    "turn": "left",
    "lane": "left",
    "time_s": 1.0,
    "speed": "30km/h",
    "preset": "eco",
    "params": ["tau=1"],
    "to": ["lanelet_of:lead"],
    "position": "middle",
    "vehicle_class": "car",
    "at": "ego",
    "former_ego": "vanish",
}
_PLANS_ALWAYS: dict[str, dict[str, Any]] = {
    "generate_scenarios": {"place": "no such place"},
    "run_planner": {"wait_s": 0},
    "get_job": {"wait_s": 0},
}


@dataclass(frozen=True)
class Surface:
    """The server's offer by its own account: input schemas by tool, URI templates, prompts with their arguments."""

    tools: Mapping[str, Mapping[str, Any]]
    resources: Sequence[str]
    prompts: Mapping[str, Sequence[str]]


def plain_arguments(tool: str, scenario_id: str) -> dict[str, Any]:
    """Return the cheapest arguments that the tool accepts."""
    plain: dict[str, dict[str, Any]] = {
        "import_files": {"path": f"{ROOT}/small.xml"},
        "modify_scenario": {
            "scenario_id": scenario_id,
            "edits": [{"op": "remove_vehicle", "vehicles": ["nearest:1"]}],
            "dry_run": True,
        },
        "cancel_job": {"job_id": "job_00000000"},
        "export_artifacts": {"ids": [scenario_id], "folder": f"{ROOT}/out", "overwrite": True},
        "describe_scenario": {"scenario_id": scenario_id},
        "run_planner": {"scenarios": [scenario_id], "configs": ["no such planner"], "wait_s": 0},
        "render": {"ids": [scenario_id]},
    }
    return {**plain.get(tool, {}), **_PLANS_ALWAYS.get(tool, {})}


def hostile_arguments(surface: Surface, scenario_id: str, chance: Chance) -> Iterator[HostileInput]:
    """Yield endless inputs from one seed: each tool gets inputs in proportion to its schema's values, heavy ones
    fewer.
    """
    tools = [name for name in surface.tools for _ in range(_weight(name))]
    while True:
        tool = chance.choice(tools)
        source = chance.random()
        if source < 0.02:
            yield _resource(surface, chance)
        elif source < 0.03:
            yield _prompt(surface, chance)
        elif source < 0.04:
            call = Call(texts.any_text(chance)[:1000] or "x", {})
            yield HostileInput("args", "tool name", (call,))
        elif source < _SHARE_OF_SCHEMA or tool not in {*_GRAMMARS, "modify_scenario"}:
            yield _from_schema(tool, surface.tools[tool], scenario_id, chance)
        else:
            yield _from_grammar(tool, scenario_id, chance)


def _weight(tool: str) -> int:
    heavy = {"generate_scenarios": 2, "run_planner": 2, "render": 1, "describe_scenario": 2, "modify_scenario": 4}
    return heavy.get(tool, 5)


def _from_schema(tool: str, schema: Mapping[str, Any], scenario_id: str, chance: Chance) -> HostileInput:
    arguments = plain_arguments(tool, scenario_id)
    properties = dict(schema.get("properties", {}))
    causes = []
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        way = chance.random()
        if way < 0.06:
            name = texts.any_text(chance)[:400]
            arguments[name] = texts.any_value(chance)
            causes.append("unknown")
        elif way < 0.1 and schema.get("required"):
            arguments.pop(chance.choice(schema["required"]), None)
            causes.append("missing")
        else:
            name = chance.choice(list(properties))
            arguments[name], how = _hostile_value(properties[name], chance)
            causes.append(f"{name} {how}")
    return HostileInput("args", f"schema: {tool}: {causes[0]}", (Call(tool, arguments),))


def _hostile_value(schema: Mapping[str, Any], chance: Chance) -> tuple[Any, str]:
    """Return a value for a property, and its hostility."""
    way = chance.random()
    if schema.get("type") == "array" and way < 0.6:
        item = dict(schema.get("items", {}))
        if way < 0.3 and item.get("properties"):
            return [_edit_from_schema(item, chance)], "item"
        values = [texts.any_value(chance) for _ in range(chance.choice((1, 1, 2, 5, 40)))]
        return values, "items"
    if schema.get("type") in ("integer", "number") and way < 0.7:
        bounds = [schema[key] for key in ("minimum", "maximum", "exclusiveMinimum") if key in schema]
        beside = [bound + step for bound in bounds for step in (-1, 1, 1e-9)]
        return chance.choice([*texts.NUMBERS, *beside]), "number"
    if schema.get("type") == "string" and way < 0.7:
        return texts.any_text(chance), "text"
    return texts.any_value(chance), "value"


def _edit_from_schema(schema: Mapping[str, Any], chance: Chance) -> dict[str, Any]:
    properties = dict(schema["properties"])
    op = chance.choice(list(_EDIT_ARGUMENTS))
    edit = {"op": op, **{name: _PLAIN[name] for name in _EDIT_ARGUMENTS[op] if name in _PLAIN}}
    fitting = [name for name in _EDIT_ARGUMENTS[op] if name in properties]
    name = chance.choice([*fitting, chance.choice(list(properties))])
    edit[name], _ = _hostile_value(properties[name], chance)
    return edit


def _from_grammar(tool: str, scenario_id: str, chance: Chance) -> HostileInput:
    arguments = plain_arguments(tool, scenario_id)
    if tool == "modify_scenario":
        edits = [_edit(chance) for _ in range(chance.choice((1, 1, 1, 2, 5)))]
        causes = [str(edits[0]["op"])]
        arguments["edits"] = edits if chance.random() < 0.98 else edits * 100
    else:
        grammar = _GRAMMARS[tool]
        causes = chance.sample(list(grammar), chance.choice((1, 1, 2)))
        for name in causes:
            is_list = name in ("tags", "features", "road_net", "obstacles", "weights", "settings", "road_classes") or (
                name in ("vehicles", "results", "where", "metrics", "scenarios", "configs")
            )
            if is_list:
                arguments[name] = [grammar[name](chance) for _ in range(chance.choice((1, 1, 3, 30)))]
            else:
                arguments[name] = grammar[name](chance)
        if tool == "generate_scenarios" and "place" not in causes:
            arguments["duration_s"] = 5
    return HostileInput("args", f"grammar: {tool}: {causes[0]}", (Call(tool, arguments),))


def _edit(chance: Chance) -> dict[str, Any]:
    op = chance.choice(list(_EDIT_ARGUMENTS))
    names = _EDIT_ARGUMENTS[op]
    edit: dict[str, Any] = {"op": op, **{name: _PLAIN[name] for name in names if name in _PLAIN}}
    for name in chance.sample(names, min(len(names), chance.choice((1, 1, 2)))):
        if name in ("time_s", "offset_m", "spacing_m", "count"):
            edit[name] = chance.choice(texts.NUMBERS)
        elif name == "rectangle_m":
            edit[name] = [chance.choice(texts.NUMBERS) for _ in range(chance.choice((2, 2, 2, 1, 0, 50)))]
        elif name in _EDIT_GRAMMAR:
            value = _EDIT_GRAMMAR[name](chance)
            edit[name] = [value] if name in ("vehicles", "to", "via", "params") else value
    return edit


def _resource(surface: Surface, chance: Chance) -> HostileInput:
    uri = chance.choice(surface.resources)
    for name in ("{id}", "{kind}", "{name}"):
        uri = uri.replace(name, chance.choice(("scenario", "..", "%2e%2e%2f", texts.any_text(chance)[:2000], MADE)))
    if chance.random() < 0.2:
        uri = texts.any_text(chance) or "x"
    return HostileInput("args", "resource", (Call(uri, {}, "resource"),))


def _prompt(surface: Surface, chance: Chance) -> HostileInput:
    name = chance.choice(list(surface.prompts))
    values = {argument: texts.any_text(chance) for argument in surface.prompts[name]}
    if chance.random() < 0.2:
        values[texts.any_text(chance)] = "x"
    return HostileInput("args", "prompt", (Call(name, values, "prompt"),))
