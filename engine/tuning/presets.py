"""The five presets of cost weights. The paper names them; the values are those of its released code."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from plannerforge.engine.tuning.weights import cost_weights
from plannerforge.schemas.errors import UnknownName, closest


@dataclass(frozen=True)
class Preset:
    """A full set of weights, by default Frenetix's thirteen in their order.

    ``short_name`` is the paper's in its comparison figure.
    """

    name: str
    short_name: str
    intent: str
    values: tuple[float, ...]
    names: tuple[str, ...] = field(default_factory=lambda: tuple(cost_weights()))

    @property
    def weights(self) -> dict[str, float]:
        """The values by weight."""
        return dict(zip(self.names, self.values, strict=True))


_PRESETS = (
    Preset(
        "Default",
        "Default",
        "the reference's tuning: follow the path, keep the speed",
        (0.0, 0.0, 0.2, 0.2, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 0.0, 0.2, 0.0),
    ),
    Preset(
        "Comfort",
        "Comfort",
        "gentle: jerk and acceleration count most",
        (0.2, 0.2, 0.8, 0.8, 0.0, 0.0, 0.5, 0.3, 0.0, 1.0, 0.3, 0.2, 0.1),
    ),
    Preset(
        "Balanced",
        "Balanced",
        "between the others",
        (0.3, 0.3, 0.5, 0.5, 0.1, 0.2, 0.7, 0.6, 0.2, 2.0, 0.8, 0.3, 0.2),
    ),
    Preset(
        "Efficiency-Sporty",
        "Sporty",
        "brisk: speed and progress count, comfort less",
        (0.2, 0.15, 0.25, 0.25, 0.2, 0.6, 0.6, 1.0, 0.4, 2.0, 0.6, 0.2, 0.1),
    ),
    Preset(
        "Safety-Conservative",
        "Safety",
        "Default with distance to others, prediction and responsibility",
        (0.0, 0.0, 0.2, 0.2, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 1.0, 0.5, 0.3),
    ),
)


def presets() -> dict[str, Preset]:
    """The presets of Frenetix by name."""
    return {preset.name: preset for preset in _PRESETS}


def find_preset(word: str, among: Mapping[str, Preset] | None = None) -> Preset:
    """A preset by its name or the paper's short name, whatever the case; of Frenetix unless others are given.

    Raises:
        UnknownName: with the names, the likeliest first.
    """
    folded, available = word.strip().lower(), among or presets()
    for preset in available.values():
        if folded in (preset.name.lower(), preset.short_name.lower()):
            return preset
    likely = closest(word, available)
    raise UnknownName(
        f"there is no preset '{word}'",
        valid=[*likely, *(name for name in available if name not in likely)],
        next_step="name one of them, or set single weights with name=value",
    )
