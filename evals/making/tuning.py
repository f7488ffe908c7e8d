"""Requests that change a planner's configuration: presets, values, factors, and invalid names or values."""

from collections.abc import Iterator
from typing import Any

from ...engine.tuning import tuning_of
from .materials import STYLES, CorpusLine, Draw, rounds, styled

_NO_WEIGHTS = ("cornering_grip", "tyre_wear", "politeness")
_NO_PRESETS = ("Turbo", "Zen", "Racing")
_PLANNER = "frenetix"
_FACTORS = {2.0: "Double", 0.5: "Halve", 3.0: "Triple"}


def tuning_lines(count: int, draw: Draw) -> Iterator[CorpusLine]:
    """Yield requests of every kind in turn, on Frenetix' configurations."""
    styles = rounds(STYLES, draw)
    for number in range(count):
        maker = _MAKERS[number % len(_MAKERS)]
        preset = draw.choice(sorted(tuning_of(_PLANNER).presets)) if maker is _relative else "Default"
        yield maker({"planner": _PLANNER, "preset": preset}, next(styles), draw)


def _line(
    context: dict[str, str],
    text: str,
    terse: str,
    truth: dict[str, Any],
    expect: Any,
    category: str,
    style: Any,
    draw: Draw,
) -> CorpusLine:
    whole = {"planner": context["planner"], "preset": None, "weights": None, **truth}
    phrased = styled(text, terse, style, draw)
    return CorpusLine("tuning", phrased, whole, expect, category, style, phrased, {"context": context})


def _weights(context: dict[str, str], preset: str | None = None) -> dict[str, float]:
    tuning = tuning_of(context["planner"])
    return dict(tuning.presets[preset or context["preset"]].weights)


def _preset(context: dict[str, str], style: Any, draw: Draw) -> CorpusLine:
    name = draw.choice(sorted(tuning_of(context["planner"]).presets))
    truth = {"preset": name, "weights": _weights(context, name), "weights_complete": True}
    return _line(context, f"Use the {name} preset.", name, truth, "ok", "preset", style, draw)


def _assigned(context: dict[str, str], draw: Draw, most: int) -> dict[str, float]:
    names = draw.sample(sorted(tuning_of(context["planner"]).weights), draw.randint(1, most))
    return {name: round(draw.uniform(0.05, 3.0), 2) for name in names}


def _explicit(context: dict[str, str], style: Any, draw: Draw) -> CorpusLine:
    explicit = _assigned(context, draw, 3)
    truth = {"weights": _weights(context) | explicit, "weights_complete": True, "explicit": explicit}
    words = " and ".join(f"{name} to {value:g}" for name, value in explicit.items())
    terse = ", ".join(f"{name} {value:g}" for name, value in explicit.items())
    return _line(context, f"Set {words}.", terse, truth, "ok", "explicit", style, draw)


def _mixed(context: dict[str, str], style: Any, draw: Draw) -> CorpusLine:
    name, explicit = draw.choice(sorted(tuning_of(context["planner"]).presets)), _assigned(context, draw, 2)
    truth = {
        "preset": name,
        "weights": _weights(context, name) | explicit,
        "weights_complete": True,
        "explicit": explicit,
    }
    words = " and ".join(f"{key} at {value:g}" for key, value in explicit.items())
    return _line(
        context, f"Take the {name} preset, but with {words}.", f"{name}, {words}", truth, "ok", "mixed", style, draw
    )


def _relative(context: dict[str, str], style: Any, draw: Draw) -> CorpusLine:
    weights = _weights(context)
    name = draw.choice([key for key, value in sorted(weights.items()) if value > 0])
    factor, word = draw.choice(sorted(_FACTORS.items()))
    result = round(weights[name] * factor, 6)
    change = {"op": "multiply", "by": factor, "base": weights[name], "result": result}
    truth = {"weights": weights | {name: result}, "weights_complete": True, "relative": {name: change}}
    return _line(
        context, f"{word} the {name} weight.", f"{name} times {factor:g}", truth, "ok", "relative", style, draw
    )


def _oov(context: dict[str, str], style: Any, draw: Draw) -> CorpusLine:
    if draw.random() < 0.5:
        word = draw.choice(_NO_WEIGHTS)
        return _line(
            context, f"Set the weight {word} to 0.4.", f"{word} 0.4", {"refused": [word]}, "refuse", "oov", style, draw
        )
    word = draw.choice(_NO_PRESETS)
    return _line(
        context, f"Use the preset {word}.", f"preset {word}", {"refused": [word.lower()]}, "refuse", "oov", style, draw
    )


def _bad_value(context: dict[str, str], style: Any, draw: Draw) -> CorpusLine:
    name = draw.choice(sorted(tuning_of(context["planner"]).weights))
    text = f"Set {name} to -{draw.randint(1, 9)}."
    return _line(context, text, text.rstrip("."), {"refused": [name]}, "refuse", "bad_value", style, draw)


def _clarify(context: dict[str, str], style: Any, draw: Draw) -> CorpusLine:
    text = draw.choice(("Lower the offset.", "Change the weights.", "Set it to 0.3."))
    del style
    return _line(context, text, text, {"missing": ["weight"]}, "clarify", "clarify", "normal", draw)


_MAKERS = (
    _preset,
    _explicit,
    _mixed,
    _relative,
    _explicit,
    _preset,
    _oov,
    _mixed,
    _relative,
    _bad_value,
    _explicit,
    _clarify,
)
