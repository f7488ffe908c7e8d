"""Traffic lights of a lanelet network as programs of a SUMO network.

A light of a lanelet holds for the ways that leave it in the light's directions. Format: ``tlLogic`` elements
(https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html), with the phase of time step 0 first and no offset.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plannerforge.engine.network.sumo_net_layout import NetLayout
from plannerforge.engine.network.sumo_net_right_of_way import Link, direction_letter

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork
    from commonroad.scenario.traffic_light import TrafficLight

_LETTERS = {"red": "r", "yellow": "y", "redYellow": "u", "green": "G", "inactive": "O"}
_TURNS = {
    "left": "lt",
    "straight": "s",
    "right": "r",
    "leftStraight": "lts",
    "straightRight": "sr",
    "leftRight": "ltr",
    "all": "ltsr",
}
ROUNDING_S = 1e-6
"""A phase that begins at a time holds at it, however times and durations are rounded."""


@dataclass(frozen=True)
class Signal:
    """One traffic light: its phases as (seconds, SUMO's letter) from time step 0 on, and the lanelets it stands at.

    ``turns``: SUMO's direction letters that it holds for.
    """

    key: int
    phases: tuple[tuple[float, str], ...]
    lanelets: frozenset[int]
    turns: str

    @property
    def program(self) -> str:
        """SUMO's id of the light."""
        return f"tl{self.key}"

    def letter_at(self, time_s: float) -> str:
        """SUMO's letter of the phase at a time after time step 0."""
        left_s = (time_s + ROUNDING_S) % sum(seconds for seconds, _ in self.phases)
        for seconds, letter in self.phases:
            if left_s < seconds:
                return letter
            left_s -= seconds
        return self.phases[-1][1]


@dataclass(frozen=True)
class Signalling:
    """Which way through a junction obeys which light: index of the way → (light, place in the light's states)."""

    signals: tuple[Signal, ...]
    places: Mapping[int, tuple[Signal, int]]

    @classmethod
    def of(cls, signals: tuple[Signal, ...], layout: NetLayout, links: Mapping[int, Link]) -> "Signalling":
        """Give every way its light: where several hold, the one for the fewest directions."""
        places: dict[int, tuple[Signal, int]] = {}
        taken: dict[int, int] = {}
        for index, path in enumerate(layout.paths):
            turn = links[index].direction if path.through else direction_letter(layout.table.lanes[path.exit].center)
            holding = [one for one in signals if path.entry in one.lanelets and turn in one.turns]
            if holding:
                light = min(holding, key=lambda one: (len(one.turns), one.key))
                places[index] = light, taken.get(light.key, 0)
                taken[light.key] = taken.get(light.key, 0) + 1
        return cls(tuple(one for one in signals if one.key in taken), places)

    def junctions(self, layout: NetLayout) -> frozenset[str]:
        """Junctions with at least one light."""
        return frozenset(junction for junction, ways in layout.links.items() if any(way in self.places for way in ways))

    def elements(self, yielding: Mapping[int, bool]) -> list[str]:
        """The ``tlLogic`` elements; a way that yields to others has a green that says so."""
        lines = []
        for light in self.signals:
            ways = sorted((place, way) for way, (signal, place) in self.places.items() if signal.key == light.key)
            lines.append(f'<tlLogic id="{light.program}" type="static" programID="0" offset="0">')
            for seconds, letter in light.phases:
                states = "".join("g" if letter == "G" and yielding[way] else letter for _, way in ways)
                lines.append(f'<phase duration="{seconds:g}" state="{states}"/>')
            lines.append("</tlLogic>")
        return lines


def signals_of(network: "LaneletNetwork", step_s: float) -> tuple[Signal, ...]:
    """The working lights of a lanelet network that stand at a lanelet and have a cycle, by ascending id."""
    places: dict[int, set[int]] = {}
    for lanelet in network.lanelets:
        for key in lanelet.traffic_lights or ():
            places.setdefault(int(key), set()).add(int(lanelet.lanelet_id))
    found = [(light, _phases(light, step_s)) for light in network.traffic_lights if light.traffic_light_id in places]
    return tuple(
        Signal(
            int(light.traffic_light_id),
            phases,
            frozenset(places[light.traffic_light_id]),
            _TURNS[str(light.direction.value)],
        )
        for light, phases in sorted(found, key=lambda one: int(one[0].traffic_light_id))
        if phases
    )


def _phases(light: "TrafficLight", step_s: float) -> tuple[tuple[float, str], ...]:
    """The cycle begun at time step 0, which may lie inside one of its elements."""
    cycle = light.traffic_light_cycle
    elements = [one for one in (cycle.cycle_elements or ()) if one.duration > 0] if cycle and light.active else []
    if not elements:
        return ()
    phases = [(int(one.duration), _LETTERS[str(one.state.value)]) for one in elements]
    passed = -int(cycle.time_offset) % sum(steps for steps, _ in phases)
    while passed >= phases[0][0]:
        passed -= phases[0][0]
        phases.append(phases.pop(0))
    first, letter = phases[0]
    begun = [(first - passed, letter), *phases[1:], *([(passed, letter)] if passed else [])]
    return tuple((steps * step_s, state) for steps, state in begun)
