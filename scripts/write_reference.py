"""Write the reference pages in ``docs/``: ``make reference``. A test compares the pages with this script's output.

The sources are the server's descriptions, the models' docstrings, the settings and the command line. Examples and
refusals come from recorded pages (``docs/answers.md``, ``docs/refusals.md``).
"""

import ast
import inspect
import json
import re
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel

CHECKOUT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(CHECKOUT))

from plannerforge.agent.settings import AgentSettings  # noqa: E402 - the checkout is found first
from plannerforge.cli.main import application  # noqa: E402
from plannerforge.engine.exploration import catalogue, pre_crash_types  # noqa: E402
from plannerforge.engine.tuning.settings import known_settings  # noqa: E402
from plannerforge.engine.tuning.tunings import LARGEST_WEIGHT, TUNINGS, PlannerTuning  # noqa: E402
from plannerforge.schemas.analysis.suite import SuiteFile  # noqa: E402
from plannerforge.schemas.base import COMMON_FIELDS  # noqa: E402
from plannerforge.schemas.errors import PlannerForgeError, error_classes  # noqa: E402
from plannerforge.schemas.modification import EDITS, Edit  # noqa: E402
from plannerforge.schemas.planning import CommandPlanner, DeclaredPreset, DeclaredWeight  # noqa: E402
from plannerforge.server.settings import Settings  # noqa: E402
from plannerforge.server.tool_schema import output_schema, tool_description  # noqa: E402
from plannerforge.tools.registry import TOOLS, ToolSpec  # noqa: E402

DOCS = CHECKOUT / "docs"
REFERENCE = DOCS / "reference"
MARK = "<!-- from here on written by scripts/write_reference.py -->\n"
MADE = "*`make reference` generates this page from the program.*"
Schema = Mapping[str, Any]


def pages() -> dict[Path, str]:
    """Return the text of every reference page by its file."""
    tools = {REFERENCE / "tools" / f"{spec.name}.md": tool_page(spec) for spec in TOOLS}
    head, mark, _ = (DOCS / "settings.md").read_text(encoding="utf-8").partition(MARK)
    return tools | {
        REFERENCE / "tools" / "index.md": tools_page(),
        REFERENCE / "types.md": types_page(),
        REFERENCE / "command_line.md": command_line_page(),
        REFERENCE / "configurations.md": configurations_page(),
        REFERENCE / "logical_scenarios.md": logical_scenarios_page(),
        DOCS / "settings.md": f"{head}{mark}\n{settings_table()}\n",
    }


def table(heading: str, rows: Iterator[tuple[str, ...]] | list[tuple[str, ...]]) -> str:
    """Return a Markdown table; ``heading``: the cells of its first line, separated by ``|``."""
    names = heading.split("|")
    lines = [names, ["---"] * len(names), *([_cell(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |".replace("|  |", "| |") for line in lines)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


# Tools


def tools_page() -> str:
    """Return the overview of all tools."""
    rows = [
        (f"[`{spec.name}`]({spec.name}.md)", _described(spec).description or "", _effect(spec), _set_of(spec))
        for spec in TOOLS
    ]
    return (
        f"# Tools\n\n{MADE}\n\n{table('tool|description for the model|effect|sets', rows)}\n\n"
        "No tool deletes anything. `essential` is the set for small models. Unknown arguments are refused by name\n"
        "([errors](../../errors.md)). The JSON schemas are the resources `plannerforge://schema/{tool}`\n"
        "([resources](../../resources.md)).\n"
    )


def tool_page(spec: ToolSpec) -> str:
    """Return a tool's page: arguments, answer, an example, refusals."""
    described = _described(spec)
    parts = [
        f"# {spec.name}\n\n{MADE}",
        f"{described.description}\n\n{_effect(spec)}. Sets: {_set_of(spec)}.",
        f"## Arguments\n\n{_arguments(spec.arguments_type, described.input_schema)}",
    ]
    if spec.name == "modify_scenario":
        schema = described.input_schema["properties"]["edits"]["items"]
        kinds = [
            (f"`{name}`", kind.letter, ", ".join(f"`{word}`" for word in kind.arguments))
            for name, kind in EDITS.items()
        ]
        parts.append(
            f"### An edit\n\n{_arguments(Edit, schema)}\n\nThe table shows the arguments of each `op` "
            f"([what they do](../../edits.md)).\n\n{table('`op`|letter|arguments', kinds)}"
        )
    parts += [f"## Answer\n\n{_answer(spec)}", f"## Example\n\n{_recorded('answers.md', spec.name)}"]
    parts.append(
        f"## Refusals\n\nThese are examples; [errors](../../errors.md) lists all codes.\n\n"
        f"{_recorded('refusals.md', spec.name)}"
    )
    return "\n\n".join(parts) + "\n"


@cache
def _described(spec: ToolSpec) -> Any:
    return tool_description(spec)


def _effect(spec: ToolSpec) -> str:
    reads = "Creates nothing" if spec.read_only and not spec.making else "Creates artifacts"
    if spec.read_only and spec.making:
        reads = f"Creates nothing without {', '.join(f'`{name}`' for name in spec.making)}"
    return reads + ("; may call online services" if spec.open_world else "")


def _set_of(spec: ToolSpec) -> str:
    return "`all` and `essential`" if spec.essential else "`all`"


def _arguments(model: type[BaseModel], schema: Schema) -> str:
    meanings, required = field_docstrings(model), schema.get("required", [])
    rows = []
    for name, part in schema["properties"].items():
        default = "required" if name in required else _default(part)
        meaning = meanings.get(name) or part.get("description", "")
        rows.append((f"`{name}`", _type(part), default, meaning))
    return table("argument|type|default|meaning", rows) if rows else "It takes no arguments."


def _default(schema: Schema) -> str:
    value = schema.get("default")
    return "none" if value in (None, [], "") else f"`{json.dumps(value, ensure_ascii=False)}`"


def field_docstrings(model: type[BaseModel]) -> dict[str, str]:
    """Return the strings below a model's fields, by field."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if issubclass(base, BaseModel) and base.__module__.startswith("plannerforge"):
            for field, text in pairwise(_classes(base.__module__)[base.__name__].body):
                if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and _is_text(text):
                    found[field.target.id] = ast.literal_eval(text.value)  # type: ignore[attr-defined]
    return found


@cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    """Return the definitions of a module's classes; ``inspect.getsource`` parses the module for each of them."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _type(schema: Schema) -> str:
    """Return the type as text, with its bounds."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return "any JSON" if name == "JsonValue" else f"[{name}](TYPES#{name.lower()})"
    if "anyOf" in schema:
        arms = [part for part in schema["anyOf"] if part.get("type") != "null"]
        return " or ".join(map(_type, arms)) + (" or null" if len(arms) < len(schema["anyOf"]) else "")
    if "const" in schema or "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema.get("enum", [schema.get("const")]))
    kind = schema.get("type", "any")
    if kind == "array" and "prefixItems" in schema:
        return "pair of " + ", ".join(map(_type, schema["prefixItems"]))
    if kind == "array":
        items = schema.get("items", {})
        return "list of edits" if items.get("type") == "object" else f"list of {_plural(_type(items))}"
    if kind == "object":
        values = schema.get("additionalProperties")
        return f"object: name → {_type(values)}" if isinstance(values, dict) and values else "object"
    word = {"string": "text", "integer": "whole number", "boolean": "true or false"}.get(kind, kind)
    return f"{word}{_bounds(schema)}"


def _plural(text: str) -> str:
    return {"text": "texts", "number": "numbers", "whole number": "whole numbers"}.get(text, text)


def _bounds(schema: Schema) -> str:
    lowest, above = schema.get("minimum"), schema.get("exclusiveMinimum")
    highest = schema.get("maximum", schema.get("exclusiveMaximum"))
    words = [f"from {lowest:g}"] if lowest is not None else [f"above {above:g}"] if above is not None else []
    words += [f"to {highest:g}"] if highest is not None else []
    return f", {' '.join(words)}" if words else ""


def _answer(spec: ToolSpec) -> str:
    model = spec.result_type
    if model is None:
        return "The pictures, with a sentence and a link for each; no structured content."
    fields = _fields(model, output_schema(model)).replace("TYPES", "../types.md")
    return f"{_doc(model)}\n\n{fields}\n\nThe answer's text says the same ([how](../../answers.md))."


def _fields(model: type[BaseModel], schema: Schema) -> str:
    """Return the table of a model's fields with types and meanings."""
    meanings = meanings_of(model)
    rows = [(f"`{name}`", _type(part), meanings[name]) for name, part in schema.get("properties", {}).items()]
    return table("field|type|meaning", rows)


def meanings_of(model: type[BaseModel]) -> dict[str, str]:
    """Return the meaning and unit of each field of an answer, empty if unknown.

    The sources are the field's description and docstring, the model's docstring (``name``: meaning, or a sentence that
    names the field) and the fields of all answers. Fields that answers leave out are not listed.
    """
    described = COMMON_FIELDS | _field_descriptions(_doc(model)) | field_docstrings(model)
    return {
        name: _with_unit(name, field.description or described.get(name, ""))
        for name, field in model.model_fields.items()
        if field.exclude is not True
    }


def _field_descriptions(doc: str) -> dict[str, str]:
    """Return what a docstring says of each field that it names.

    A definition counts first ("``gap_m``: meaning"), then a sentence that begins with the name ("``judged`` counts the
    examined collisions." gives "counts the examined collisions"), then any other sentence with the name.
    """
    clauses = re.split(r"(?<=[.;])\s+", re.sub(r"\s+- (?=`)", "; ", " ".join(doc.split())))
    defined: dict[str, str] = {}
    begun: dict[str, str] = {}
    named: dict[str, str] = {}
    for clause in (one.rstrip(".;") for one in clauses):
        for names, meaning in re.findall(r"((?:`\w+`(?:, | and )?)+): ([^;.]+)", clause):
            defined |= dict.fromkeys(re.findall(r"`(\w+)`", names), meaning)
        if begins := re.match(r"`(\w+)` (?:(?:is|are) )?(.+)", clause):
            begun.setdefault(begins[1], begins[2])
        named = dict.fromkeys(re.findall(r"`(\w+)`", clause), clause) | named
    return named | begun | defined


UNITS = {
    "per_lane_km": "1/km",
    "mps": "m/s",
    "mps2": "m/s²",
    "kmh": "km/h",
    "bytes": "bytes",
    "rad": "rad",
    "deg": "°",
    "s": "s",
    "m": "m",
    "km": "km",
}
"""The spelling of units in field names."""


def _with_unit(name: str, meaning: str) -> str:
    unit = next((unit for ending, unit in UNITS.items() if name.endswith(f"_{ending}")), "")
    return f"{meaning} ({unit})" if meaning and unit else meaning


def _doc(model: type[BaseModel]) -> str:
    return inspect.cleandoc(model.__doc__ or "").replace("``", "`")


def _recorded(page: str, tool: str) -> str:
    """Return a tool's section of a recorded page, without its heading."""
    text = (DOCS / page).read_text(encoding="utf-8")
    found = re.search(rf"^### {tool}\n\n(.*?)(?=^### |\Z)", text, re.DOTALL | re.MULTILINE)
    if found is None:
        raise LookupError(
            f"docs/{page} shows nothing of {tool}: record it with pytest tests/contract --update-snapshots"
        )
    return found[1].rstrip()


def types_page() -> str:
    """Return the page of the models in answers."""
    definitions: dict[str, Schema] = {}
    models: dict[str, type[BaseModel]] = {}
    for spec in TOOLS:
        if spec.result_type is not None:
            definitions |= output_schema(spec.result_type).get("$defs", {})
            models |= {model.__name__: model for model in models_below(spec.result_type, set())}
    parts = [
        f"## {name}\n\n{_doc(models[name])}\n\n{_fields(models[name], definitions[name])}".replace("TYPES#", "#")
        for name in sorted(models.keys() & definitions.keys())
    ]
    return (
        f"# Types of answers\n\n{MADE}\n\nThe [tools](tools/index.md)' structured answers contain these types.\n\n"
        + ("\n\n".join(parts) + "\n")
    )


def models_below(model: type[BaseModel], seen: set[type[BaseModel]]) -> set[type[BaseModel]]:
    """Return a model and all models that it contains."""
    if model not in seen:
        seen.add(model)
        for field in model.model_fields.values():
            for part in _types_in(field.annotation):
                models_below(part, seen)
    return seen


def _types_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in getattr(annotation, "__args__", ()):
        yield from _types_in(part)


# Settings


def settings_table() -> str:
    """Return the table of the server's settings."""
    schema = Settings.model_json_schema()
    rows = []
    for name, field in Settings.model_fields.items():
        part = schema["properties"][name]
        kind = "text" if part.get("format") in {"path", "password"} else _type(part)
        kind = "section" if name == "planners" else kind
        rows.append((f"`{name}`", kind, _setting_default(name, field.get_default()), str(field.description)))
    return table("setting|type|default|meaning", rows)


def _setting_default(name: str, value: Any) -> str:
    if name == "workspace":
        return "the user's data folder"
    if value in (None, "", (), {}) or str(value) == "PydanticUndefined":
        return "none"
    if isinstance(value, tuple):
        return " ".join(f"`{part}`" for part in value)
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    text = re.sub(r"PlannerForge-MCP/[\w.]+", "PlannerForge-MCP/VERSION", str(value))
    return f"`{value:g}`" if isinstance(value, float) else f"`{text}`"


# The command line


@cache
def _program() -> Any:
    """Return the command line as a click group of typer's."""
    return typer.main.get_command(application)


def command_line_page() -> str:
    """Return the page of all commands."""
    parts = [_command_part(path, command) for path, command in commands(_program(), ("plannerforge",))]
    return f"# Command line\n\n{MADE}\n\n`plannerforge --help` and `plannerforge COMMAND --help` say the same.\n\n" + (
        "\n\n".join(parts) + "\n"
    )


def commands(group: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield all commands below a group, with their paths."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


def _command_part(path: tuple[str, ...], command: Any) -> str:
    arguments = [part for part in command.params if part.param_type_name == "argument"]
    options = [part for part in command.params if part.param_type_name == "option"]
    usage = " ".join([*path, *(_as_called(part) for part in arguments), *(["[OPTIONS]"] if options else [])])
    rows = [(f"`{_metavar(part)}`", _shown(part), _help(part)) for part in arguments]
    rows += [
        (", ".join(f"`{flag}`" for flag in (*part.opts, *part.secondary_opts)), _shown(part), _help(part))
        for part in options
    ]
    shown = f"\n\n{table('argument or option|default|meaning', rows)}" if rows else ""
    return f"## {' '.join(path[1:])}\n\n```text\n{usage}\n```\n\n{inspect.cleandoc(command.help or '')}{shown}"


def _metavar(part: Any) -> str:
    return str(part.name).upper()


def _as_called(part: Any) -> str:
    name = _metavar(part) + ("..." if part.nargs == -1 else "")
    return name if part.required else f"[{name}]"


_DEFAULT = re.compile(r"\s*\[default: ([^\]]*)\]")
"""How a flag's help states a setting's default."""


def _shown(part: Any) -> str:
    default = _DEFAULT.search(part.help or "")
    value = default[1] if default else part.default
    return "" if value in (None, False, (), "") or callable(value) or "UNSET" in str(value) else f"`{value}`"


def _help(part: Any) -> str:
    return _DEFAULT.sub("", part.help or "")


# Configurations


_TYPOLOGY = (
    "The logical scenarios cover {covered} of {types} types, with {percent:.1f} % of the crashes of light vehicles in\n"
    "the United States. The source is W. G. Najm, J. D. Smith, M. Yanagisawa, Pre-Crash Scenario Typology for Crash\n"
    "Avoidance Research, DOT HS 810 767 (2007), with the crashes of the year 2004 (General Estimates System)."
)


def logical_scenarios_page() -> str:
    """Return the page of logical scenarios, and of the pre-crash types that they cover."""
    scenarios = [
        (
            f"`{name}`",
            one.summary,
            ", ".join(f"`{axis.name}` {axis.low:g} to {axis.high:g}" for axis in one.parameters),
            f"`{one.base}`",
            one.source,
        )
        for name, one in catalogue().items()
    ]
    types = [
        (
            f"`nhtsa:{one.number}`",
            one.name,
            f"{one.crashes:,}",
            f"{one.percent:.2f} %",
            ", ".join(f"`{name}`" for name in one.scenarios) or one.why_not,
        )
        for one in pre_crash_types()
    ]
    covered = [one for one in pre_crash_types() if one.scenarios]
    parts = [
        f"# Logical scenarios\n\n{MADE}",
        "[`explore_boundary`](../boundaries.md) maps two parameters of one of these logical scenarios.",
        table("name|what happens|parameters|road|source", scenarios),
        "## NHTSA's pre-crash types",
        _TYPOLOGY.format(covered=len(covered), types=len(types), percent=sum(one.percent for one in covered)),
        table("`scenario`|type|crashes in 2004|share|logical scenarios", types),
    ]
    return "\n\n".join(parts) + "\n"


def configurations_page() -> str:
    """Return the page of planner configurations and user files."""
    settings = [
        (
            f"`{setting.name}`",
            f"{setting.lowest:g} to {setting.highest:g}{f' {setting.unit}' if setting.unit else ''}",
            setting.meaning,
        )
        for setting in known_settings().values()
    ]
    parts = [
        f"# Configurations\n\n{MADE}",
        "This page lists weights, presets and settings of planners, and the keys of suites, programs and the agent.",
        *(_planner_part(name, tuning) for name, tuning in TUNINGS.items()),
        f"## Settings of all planners\n\n{table('setting|range|meaning', settings)}",
        "[Planners](../planners.md) lists the settings that a planner ignores.",
        "## A suite\n\nThese are the keys of the file of `plannerforge test` ([how to write it](../gate.md)).",
        _model_table(SuiteFile),
        "## A planner that is a program",
        "These are the keys of a section `[planners.NAME]` in the settings file ([how](../own_planner.md#a-program)).",
        _model_table(CommandPlanner),
        f"A weight:\n\n{_model_table(DeclaredWeight)}\n\nA preset:\n\n{_model_table(DeclaredPreset)}",
        "## The agent\n\nSet these as `PLANNERFORGE_AGENT_…` for `plannerforge agent` and `chat` ([how](../agent.md)).",
        _model_table(AgentSettings),
        f"## Errors\n\n{_errors_table()}\n\n[Errors](../errors.md) says when each occurs.",
    ]
    return "\n\n".join(parts) + "\n"


def _planner_part(name: str, tuning: PlannerTuning) -> str:
    presets = tuning.presets
    rows = [
        (
            f"`{weight.name}`",
            weight.meaning,
            weight.raising,
            "0 or more" if weight.highest == LARGEST_WEIGHT else f"{weight.lowest:g} to {weight.highest:g}",
            *(f"{preset.weights.get(weight.name, 0.0):g}" for preset in presets.values()),
        )
        for weight in tuning.weights.values()
    ]
    named = [
        (f"`{preset.name}`" + (f", `{preset.short_name}`" if preset.short_name != preset.name else ""), preset.intent)
        for preset in presets.values()
    ]
    heads = "|".join(preset.short_name for preset in presets.values())
    return (
        f"## {name}\n\n{tuning.summary[:1].upper()}{tuning.summary[1:]}.\n\n{table('preset|meant for', named)}\n\n"
        f"{table(f'weight|meaning|raising it|range|{heads}', rows)}"
    )


def _model_table(model: type[BaseModel]) -> str:
    schema, documented = model.model_json_schema(), field_docstrings(model)
    rows = [
        (
            f"`{name}`",
            _type(schema["properties"][name]).replace("TYPES", ""),
            "required" if field.is_required() else _default(schema["properties"][name]),
            documented.get(name) or field.description or "",
        )
        for name, field in model.model_fields.items()
    ]
    return re.sub(r"\[(\w+)\]\(#\w+\)", r"\1", table("key|type|default|meaning", rows))


def _errors_table() -> str:
    known = [error for error in error_classes().values() if error.__module__ == PlannerForgeError.__module__]
    rows = [(f"`{error.code}`", error.__name__, _base(error), error.usual_step) for error in known]
    return table("code|class|kind of|usual next step", sorted(rows))


def _base(error: type[PlannerForgeError]) -> str:
    (base, *_) = error.__bases__
    return base.__name__ if issubclass(base, PlannerForgeError) else ""


def main() -> None:
    """Write the pages that differ, and print their names."""
    for file, text in pages().items():
        file.parent.mkdir(parents=True, exist_ok=True)
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")
            sys.stdout.write(f"{file.relative_to(CHECKOUT)}\n")


if __name__ == "__main__":
    main()
