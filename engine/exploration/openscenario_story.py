"""OpenSCENARIO stories as logical scenarios: entities, actions and triggers become edits on a drawn road.

Lanes are counted from the ego's lane, and distances from the ego, so the story does not need the file's roads. What has
no counterpart among the edits is refused by the name of its element; nothing is guessed from names. The planner drives
the ego, so the ego's own events are left out.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from lxml import etree

from ...schemas.errors import InvalidRequest, UnknownName
from ...schemas.exploration import LogicalScenario
from ...schemas.text import one_line, shown_name
from ...schemas.vocabulary import ROAD_FRICTIONS
from ..vehicles import vehicle_classes
from .formulas import names_in
from .openscenario_file import WRITE_YAML, OpenScenario, open_scenario, own_name
from .roads import LANE_M

_CLASSES: Final[Mapping[str, str]] = {
    "car": "car",
    "van": "car",
    "truck": "truck",
    "semitrailer": "trailer",
    "bus": "bus",
    "motorbike": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
"""The class of an added road user by OpenSCENARIO's category."""
_PEDESTRIAN_M = 0.5
_CROSSING = ("pedestrian", "bicycle")
_LONGEST_S, _AFTER_S = 60.0, 10.0
"""The duration of the long roads' scenarios, and how long a run lasts after the last event or meeting (chosen)."""
_HOLD_MPS2 = 1.0
"""The rate of an edit that only keeps a speed (chosen)."""
_LEAST_RATE_MPS2, _LEAST_LATERAL_S, _LEAST_S = 0.1, 0.5, 0.1
"""The least values that edits accept."""
_ACROSS = 0.5
"""The least sine of a heading across the road (chosen)."""
_STRAIGHT_M = 1.0
"""The most that the ends of a crossing may differ along the road (chosen)."""
_PEAK: Final[Mapping[str, float]] = {"linear": 1.0, "cubic": 1.5, "sinusoidal": math.pi / 2}
"""The peak rate of a transition divided by its mean rate, by its shape."""
_ROADS: Final[Mapping[str, tuple[str, float]]] = {"three_lanes_long": ("2", 300.0), "two_way_long": ("1", 200.0)}
"""The ego's lanelet on a road, and its station in m."""
_ONCOMING: Final = ("2", 2800.0)
"""The oncoming lanelet of the two-way road, and the station next to the ego."""
_POSITIONS = ["LanePosition", "RelativeLanePosition"]
_GROUPS = ("Condition", "ByEntityCondition", "ByValueCondition", "EntityCondition")
"""Elements that only contain a condition."""
_ACTIONS = ["SpeedAction", "LaneChangeAction", "FollowTrajectoryAction of a crossing pedestrian or cyclist"]
_TRIGGERS = [
    "SimulationTimeCondition",
    "StoryboardElementStateCondition",
    "RelativeDistanceCondition",
    "TimeHeadwayCondition",
    "TimeToCollisionCondition",
    "TraveledDistanceCondition of the ego",
]


@dataclass(frozen=True)
class _Place:
    """A place on the road: index of the lane, metres along the road from its start and left of the lane's centre.

    Lanes are numbered without a gap at the reference line, so neighbours differ by 1.
    """

    lane: int
    s: str
    aside: str
    heading_rad: float = 0.0


@dataclass(frozen=True)
class _Trigger:
    """When something happens: at a time, or once the ego has done something (``when`` of an edit)."""

    time_s: str = "0"
    when: str = ""


@dataclass
class _Entity:
    """A road user of the file. Lengths before and behind its reference point are in m, speeds in m/s."""

    name: str
    kind: str
    front_m: str
    rear_m: str
    place: _Place | None = None
    speed: str = "0"
    gap_s: str = ""
    has_controller: bool = False

    @property
    def length_m(self) -> float:
        """The length of the class that replaces it."""
        return _PEDESTRIAN_M if self.kind == "pedestrian" else vehicle_classes()[self.kind].length_m


@dataclass
class _Edits:
    """The edits that have been written, and the derived values that they use; ``taken``: other names."""

    taken: frozenset[str] = frozenset()
    written: list[dict[str, Any]] = field(default_factory=list)
    derived: dict[str, str] = field(default_factory=dict)

    def add(self, op: str, **arguments: Any) -> str:
        """Add an edit, and return the name of the vehicle that it adds."""
        self.written.append({"op": op} | arguments)
        return f"new:{len(self.written) - 1}"

    def value(self, formula: str, purpose: str) -> str:
        """Return the name of a derived value."""
        for name, known in self.derived.items():
            if known == formula:
                return name
        name = f"{own_name(purpose)}_{len(self.derived)}"
        while name in self.taken:
            name += "_"
        self.derived[name] = formula
        return name


def logical_scenario_of(path: Path, allowed: Callable[[str], Path]) -> LogicalScenario:
    """Return the logical scenario of an OpenSCENARIO XML file: a scenario, or a distribution of its parameters.

    Args:
        path: the file.
        allowed: returns the path of a file that may be read, or raises OutsideRoots.

    Raises:
        UnsafeInput: a file is too large, broken or hostile.
        OutsideRoots: the file refers to a file elsewhere.
        InvalidRequest: an element has no counterpart among the edits.
    """
    return _Story(open_scenario(path, allowed), path).logical()


class _Story:
    """A storyboard that becomes edits."""

    def __init__(self, scenario: OpenScenario, path: Path) -> None:
        self._scenario, self._path = scenario, path
        self._entities: dict[str, _Entity] = {}
        self._edits = _Edits(frozenset(scenario.values))
        self._vehicles: dict[str, str] = {}
        self._speeds: dict[str, str] = {}
        self._lanes: dict[str, int] = {}
        self._crossing: set[str] = set()
        self._crossed: set[str] = set()
        self._times: dict[str, tuple[_Trigger, str]] = {}
        self._friction = ""
        self._reacts = False

    def logical(self) -> LogicalScenario:
        """Return the logical scenario."""
        scenario = self._scenario
        for element in scenario.root.iterfind("Entities/ScenarioObject"):
            entity = self._entity(element)
            self._entities[entity.name] = entity
        self._ego = self._found_ego()
        self._initialise()
        self._crossing = {one.name for one in self._others if self._is_crossing(one)}
        self._road = self._chosen_road()
        self._edits.add("set_ego", speed=self._text(self._ego.speed, "ego_speed", "m/s"))
        if self._friction:
            self._edits.add("set_weather", params=[f"friction=${{{self._edits.value(self._friction, 'friction')}}}"])
        events = list(self._events())
        for entity in self._others:
            if entity.name in self._crossing:
                continue
            if entity.kind == "pedestrian":
                raise InvalidRequest(
                    f"{scenario.file}: the pedestrian '{shown_name(entity.name)}' does not cross the road",
                    valid=["a pedestrian who crosses the ego's lane"],
                    next_step="make it a vehicle, or leave it out of the file",
                )
            self._place(entity)
        for event in events:
            self._apply(*event)
        parameters, constants = scenario.parameters()
        if not parameters:
            raise InvalidRequest(
                f"{scenario.file} has no numeric parameters that its story uses",
                valid=["<ParameterDeclaration> elements that speeds, positions or triggers refer to"],
                next_step="declare parameters, and refer to them in the story",
            )
        used = {name for formula in self._edits.derived.values() for name in names_in(formula)}
        header = scenario.root.find("FileHeader")
        about = "" if header is None else one_line(header.get("description", ""))
        version = "" if header is None else f" {header.get('revMajor')}.{header.get('revMinor')}"
        return LogicalScenario(
            name=own_name(self._path.stem),
            summary=shown_name(about) if about else scenario.file,
            base=self._road,
            parameters=parameters,
            derived={name: value for name, value in constants.items() if name in used} | self._edits.derived,
            edits=tuple(self._edits.written),
            horizon_s=self._horizon_s(),
            traffic="reactive" if self._reacts else "recorded",
            source=f"OpenSCENARIO{shown_name(version)}, {scenario.file}",
            notes=tuple(dict.fromkeys(scenario.notes)),
        )

    # Entities

    def _entity(self, element: etree._Element) -> _Entity:
        scenario = self._scenario
        name = element.get("name", "")
        reference = element.find("CatalogReference")
        described = next((one for one in element if one.tag in ("Vehicle", "Pedestrian", "MiscObject")), None)
        if reference is not None:
            described = scenario.entry(
                scenario.text(reference.get("catalogName", "")), scenario.text(reference.get("entryName", ""))
            )
        if described is None:
            raise self._refused(element, name, ["Vehicle", "Pedestrian", "CatalogReference"])
        word = described.get("vehicleCategory") or described.get("pedestrianCategory") or described.tag
        kind = _CLASSES.get(scenario.text(word, _declared(described)))
        box = described.find("BoundingBox")
        center, size = (None if box is None else box.find(one) for one in ("Center", "Dimensions"))
        if kind is None or center is None or size is None:
            raise self._refused(described, name, [f"category {', '.join(_CLASSES)}, with a BoundingBox"])
        local = _declared(described)
        if reference is not None:
            assigned = reference.iterfind("ParameterAssignments/ParameterAssignment")
            local |= {one.get("parameterRef", ""): one.get("value", "") for one in assigned}
        middle, length = (self._formula(self._stated(*one), local) for one in ((center, "x"), (size, "length")))
        front, rear = f"({length}) / 2 + ({middle})", f"({length}) / 2 - ({middle})"
        return _Entity(name, kind, front, rear, has_controller=element.find("ObjectController") is not None)

    def _found_ego(self) -> _Entity:
        """Return the ego: the entity of this name, or the only one with a controller."""
        named = [one for one in self._entities.values() if one.name.lower() == "ego"]
        controlled = [one for one in self._entities.values() if one.has_controller]
        for found in (named, controlled):
            if len(found) == 1:
                return found[0]
        raise InvalidRequest(
            f"{self._scenario.file} does not say which entity is the ego",
            valid=["an entity named Ego", "a single entity with an <ObjectController>"],
            next_step="name the entity that the planner drives Ego",
        )

    @property
    def _others(self) -> list[_Entity]:
        return [one for one in self._entities.values() if one is not self._ego]

    def _known(self, name: str) -> _Entity:
        if name not in self._entities:
            raise UnknownName(
                f"{self._scenario.file} refers to the entity '{shown_name(name)}', which it does not have",
                valid=list(self._entities),
            )
        return self._entities[name]

    # Initial states

    def _initialise(self) -> None:
        """Read the initial actions: places first, because speeds and gaps may refer to them."""
        scenario = self._scenario
        for action in scenario.root.iterfind("Storyboard/Init/Actions/GlobalAction/*"):
            self._global(action)
        for action in scenario.root.iterfind("Storyboard/Init/Actions/UserDefinedAction"):
            raise self._refused(action, "", ["Private actions, EnvironmentAction"])
        private = list(scenario.root.iterfind("Storyboard/Init/Actions/Private"))
        waiting = [
            (self._known(scenario.text(one.get("entityRef", ""))), action)
            for one in private
            for action in one.iterfind("PrivateAction/*")
        ]
        places = {entity.name: action for entity, action in waiting if action.tag == "TeleportAction"}
        for entity in self._entities.values():
            if entity.name not in places:
                raise InvalidRequest(
                    f"{scenario.file}: '{shown_name(entity.name)}' has no initial <TeleportAction>",
                    valid=_POSITIONS,
                    next_step="give every entity a position",
                )
            self._locate(entity, places, ())
        for entity, action in waiting:
            self._initial(entity, action)

    def _locate(self, entity: _Entity, places: Mapping[str, etree._Element], after: tuple[str, ...]) -> _Place:
        if entity.place is None:
            if entity.name in after or entity.name not in places:
                raise InvalidRequest(f"{self._scenario.file}: positions refer to each other: {', '.join(after)}")
            entity.place = self._position(
                self._only(places[entity.name], "Position/*"), entity.name, places, (*after, entity.name)
            )
        return entity.place

    def _position(
        self,
        element: etree._Element,
        owner: str,
        places: Mapping[str, etree._Element],
        after: tuple[str, ...] = (),
        local: Mapping[str, str] | None = None,
    ) -> _Place:
        scenario = self._scenario
        aside = self._formula(element.get("offset", "0"), local)
        heading = element.find("Orientation")
        heading_rad = 0.0 if heading is None else scenario.fixed(heading.get("h", "0"), local)
        if element.tag == "LanePosition":
            lane = _index(round(scenario.fixed(self._stated(element, "laneId"), local)))
            return _Place(lane, self._formula(self._stated(element, "s"), local), aside, heading_rad)
        along = element.get("ds") or element.get("dsLane")
        if element.tag == "RelativeLanePosition" and along is not None:
            of = self._locate(self._known(scenario.text(element.get("entityRef", ""), local)), places, after)
            lane = of.lane + round(scenario.fixed(element.get("dLane", "0"), local))
            return _Place(lane, f"({of.s}) + ({self._formula(along, local)})", aside, heading_rad)
        raise self._refused(element, owner, _POSITIONS)

    def _initial(self, entity: _Entity, action: etree._Element) -> None:
        inner = next(iter(action), action)
        if action.tag == "TeleportAction":
            return
        if action.tag in ("ControllerAction", "ActivateControllerAction", "VisibilityAction", "AppearanceAction"):
            if entity is not self._ego:
                self._scenario.notes.append(f"<{action.tag}> of '{shown_name(entity.name)}' is left out")
            return
        if inner.tag == "SpeedAction":
            entity.speed = self._target_speed(inner, entity.name, {})
            return
        if inner.tag == "LongitudinalDistanceAction" and self._is_gap_to_ego(inner, entity):
            entity.gap_s = self._formula(self._stated(inner, "timeGap"))
            return
        if entity is self._ego:
            self._scenario.notes.append(f"<{inner.tag}> of the ego is left out, because the planner drives it")
            return
        raise self._refused(inner, entity.name, ["TeleportAction", "SpeedAction", "LongitudinalDistanceAction"])

    def _is_gap_to_ego(self, action: etree._Element, entity: _Entity) -> bool:
        """Return True for a time gap ahead of the ego in its lane."""
        leads = action.get("displacement", "leadingReferencedEntity") == "leadingReferencedEntity"
        refers = self._scenario.text(action.get("entityRef", "")) == self._ego.name
        return (
            leads
            and refers
            and action.get("timeGap") is not None
            and action.get("freespace") == "true"
            and self._left(entity) == 0
        )

    def _global(self, action: etree._Element) -> None:
        if action.tag != "EnvironmentAction":
            raise self._refused(action, "", ["EnvironmentAction"])
        condition = next(action.iter("RoadCondition"), None)
        if condition is not None:
            factor = self._formula(condition.get("frictionScaleFactor", "1"))
            if factor != "1":
                self._friction = f"({factor}) * {ROAD_FRICTIONS['dry']:g}"
        self._scenario.notes.append("<EnvironmentAction>: only the roads' friction is used")

    # The road

    @property
    def _forward(self) -> int:
        """1 if the ego drives towards greater s, otherwise −1."""
        place = self._ego.place
        return 1 if place is None or place.lane < 0 else -1

    def _left(self, entity: _Entity) -> int:
        """Return how many lanes an entity is to the left of the ego's lane at the start."""
        return self._left_of(entity.place.lane) if entity.place else 0

    def _left_of(self, lane: int) -> int:
        return self._forward * (lane - (self._ego.place.lane if self._ego.place else 0))

    def _is_oncoming(self, entity: _Entity) -> bool:
        """Return True if an entity's lane leads the other way."""
        return entity.place is not None and (entity.place.lane < 0) != (self._forward == 1)

    def _ahead(self, entity: _Entity) -> str:
        """Return the distance from the ego's reference point to that of an entity, along the road."""
        if entity.place is None or self._ego.place is None:
            return "0"
        return f"{self._forward} * (({entity.place.s}) - ({self._ego.place.s}))"

    def _chosen_road(self) -> str:
        lanes: dict[str, int] = {}
        oncoming = walks = False
        for entity in self._others:
            if entity.name in self._crossing:
                walks = True
                continue
            left = self._left(entity)
            oncoming |= self._is_oncoming(entity)
            lanes[entity.name] = left
            if abs(left) > 1 or (self._is_oncoming(entity) and left != 1):
                raise InvalidRequest(
                    f"{self._scenario.file}: '{shown_name(entity.name)}' begins {abs(left)} lanes from the ego",
                    valid=["the ego's lane", "a lane next to it"],
                    next_step="move it nearer, or write the logical scenario as YAML",
                )
        lanes |= dict.fromkeys((name for name in self._actors_of("LaneChangeAction") if name in lanes), 1)
        if oncoming and any(left and not self._is_oncoming(self._entities[name]) for name, left in lanes.items()):
            raise InvalidRequest(
                f"{self._scenario.file} has oncoming traffic next to the ego, and lanes that lead the ego's way",
                valid=["only oncoming traffic next to the ego", "only lanes that lead the ego's way"],
                next_step="write the logical scenario as YAML, on a road of your own",
            )
        needs_lanes = any(left for name, left in lanes.items() if not self._is_oncoming(self._entities[name]))
        return "two_way_long" if oncoming or (walks and not needs_lanes) else "three_lanes_long"

    def _actors_of(self, action: str) -> Iterator[str]:
        """Yield the names of the entities that do an action of the story."""
        for group in self._scenario.root.iterfind("Storyboard/Story/Act/ManeuverGroup"):
            if next(group.iter(action), None) is not None:
                local = self._local(group)
                for one in group.iterfind("Actors/EntityRef"):
                    yield self._scenario.text(one.get("entityRef", ""), local)

    def _aside_m(self, place: _Place) -> float:
        """Return how far a place is to the left of the ego's lane centre, for the declared values."""
        return LANE_M * self._left_of(place.lane) + self._forward * self._scenario.now(place.aside)

    # Placing

    def _place(self, entity: _Entity) -> None:
        """Write the edits that add an entity, and keep its initial speed."""
        aside_m = self._scenario.fixed_formula(entity.place.aside) if entity.place else 0.0
        if abs(aside_m) > 0.01 or self._is_turned(entity):
            raise InvalidRequest(
                f"{self._scenario.file}: '{shown_name(entity.name)}' does not begin in the middle of a lane with the "
                f"lane's heading",
                valid=["offset 0 and the heading of the lane", "a pedestrian or cyclist who crosses"],
                next_step=WRITE_YAML,
            )
        speed = self._text(entity.speed, f"{entity.name}_speed", "m/s")
        vehicle = {"vehicle_class": entity.kind, "speed": speed}
        if self._is_oncoming(entity):
            lanelet, next_to_ego_m = _ONCOMING
            away = f"{next_to_ego_m:g} - ({self._centres_m(entity)})"
            name = self._edits.add(
                "add_vehicle", at=lanelet, position=self._text(away, f"{entity.name}_at", "m"), **vehicle
            )
        else:
            lane = {0: {}, 1: {"lane": "left"}, -1: {"lane": "right"}}[self._left(entity)]
            where = (
                {"gap_s": f"${self._edits.value(entity.gap_s, f'{entity.name}_gap')}"}
                if entity.gap_s
                else {"offset_m": f"${self._edits.value(self._centres_m(entity), f'{entity.name}_ahead')}"}
            )
            name = self._edits.add("add_vehicle", at="ego", **lane, **where, **vehicle)
        self._edits.add("set_speed", vehicles=[name], speed=speed, rate_mps2=_HOLD_MPS2)
        self._vehicles[entity.name] = name
        self._speeds[entity.name] = entity.speed
        self._lanes[entity.name] = self._left(entity)

    def _is_turned(self, entity: _Entity) -> bool:
        return entity.place is not None and abs(math.sin(entity.place.heading_rad / 2)) > 0.1

    def _centres_m(self, entity: _Entity) -> str:
        """Return the distance between the centres that gives the file's gap between the bodies."""
        ego = self._ego
        bodies_m = (entity.length_m + ego.length_m) / 2
        return f"({self._ahead(entity)}) - ({entity.rear_m}) - ({ego.front_m}) + {bodies_m:g}"

    def _text(self, formula: str, purpose: str, unit: str) -> str:
        return f"${{{self._edits.value(formula, purpose)}}}{unit}"

    # Events

    def _events(self) -> Iterator[tuple[_Entity, _Trigger, etree._Element, Mapping[str, str]]]:
        """Yield the entity, the trigger, the event and the local parameters of every event of another road user."""
        for act in self._scenario.root.iterfind("Storyboard/Story/Act"):
            begins = self._trigger(act.find("StartTrigger"), act, None, self._local(act)) or _Trigger()
            if begins.when:
                raise self._refused(act, act.get("name", ""), ["an act that starts at a time"])
            self._times[act.get("name", "")] = begins, begins.time_s
            for group in act.iterfind("ManeuverGroup"):
                local = self._local(group)
                actors = [
                    self._known(self._scenario.text(one.get("entityRef", ""), local))
                    for one in group.iterfind("Actors/EntityRef")
                ]
                if group.find("CatalogReference") is not None:
                    raise self._refused(group.find("CatalogReference"), group.get("name", ""), ["Maneuver"])
                for event in group.iterfind("Maneuver/Event"):
                    for actor in actors:
                        if actor is self._ego:
                            if next(event.iter("ControllerAction"), None) is None:
                                name = shown_name(event.get("name", ""))
                                self._scenario.notes.append(
                                    f"the event '{name}' of the ego is left out, because the planner drives it"
                                )
                        else:
                            yield actor, begins, event, local

    def _local(self, element: etree._Element) -> dict[str, str]:
        """Return the parameters that the story around an element declares."""
        found: dict[str, str] = {}
        for ancestor in (*reversed(list(element.iterancestors())), element):
            if ancestor.tag != "OpenSCENARIO":
                found |= _declared(ancestor)
        return found

    def _apply(self, actor: _Entity, begins: _Trigger, event: etree._Element, local: Mapping[str, str]) -> None:
        """Write the edits of an event."""
        trigger = self._trigger(event.find("StartTrigger"), event, actor, local) or begins
        if not trigger.when and begins.time_s != "0":
            trigger = replace(trigger, time_s=f"max({trigger.time_s}, {begins.time_s})")
        actions = [inner for action in event.iterfind("Action") for inner in _leaves(action)]
        if actor.name not in self._vehicles:
            self._cross(actor, trigger, actions, event, local)
            return
        end = trigger.time_s
        for number, action in enumerate(actions):
            if action.tag == "SpeedAction":
                lasts = self._change_speed(actor, trigger, action, local)
            elif action.tag == "LaneChangeAction":
                lasts = self._change_lane(actor, trigger, action, local)
            else:
                raise self._refused(action, actor.name, _ACTIONS)
            end = f"({trigger.time_s}) + ({lasts})"
            names = [one.get("name", "") for one in event.iterfind("Action")]
            if number < len(names):
                self._times[names[number]] = trigger, end
        self._times[event.get("name", "")] = trigger, end

    def _change_speed(self, actor: _Entity, trigger: _Trigger, action: etree._Element, local: Mapping[str, str]) -> str:
        """Write a change of speed, and return its duration as a formula."""
        target = self._target_speed(action, actor.name, local)
        change = f"abs(({target}) - ({self._speeds[actor.name]}))"
        dynamics = action.find("SpeedActionDynamics")
        value = self._formula("0" if dynamics is None else dynamics.get("value", "0"), local)
        dimension = "time" if dynamics is None else dynamics.get("dynamicsDimension")
        shape = "step" if dynamics is None else dynamics.get("dynamicsShape", "linear")
        if shape == "step":
            raise InvalidRequest(
                f"{self._scenario.file}: a <SpeedAction> of '{shown_name(actor.name)}' changes the speed in one step",
                valid=["dynamicsShape linear, cubic or sinusoidal, with a rate, a time or a distance"],
                next_step="give the change a rate in m/s²",
            )
        rate = {
            "rate": f"abs({value})",
            "time": f"{change} / max(abs({value}), {_LEAST_S})",
            "distance": f"{change} * (({target}) + ({self._speeds[actor.name]})) / 2 / max(abs({value}), {_LEAST_S})",
        }.get(dimension or "", "")
        if not rate:
            raise self._refused(action, actor.name, ["dynamicsDimension rate, time or distance"])
        rate = f"max({rate}, {_LEAST_RATE_MPS2})"
        self._edits.add(
            "set_speed",
            vehicles=[self._vehicles[actor.name]],
            speed=self._text(target, f"{actor.name}_to", "m/s"),
            rate_mps2=f"${self._edits.value(rate, f'{actor.name}_rate')}",
            **self._given(trigger, actor),
        )
        self._speeds[actor.name] = target
        return f"{change} / {rate}"

    def _change_lane(self, actor: _Entity, trigger: _Trigger, action: etree._Element, local: Mapping[str, str]) -> str:
        """Write a lane change, and return its duration as a formula."""
        scenario = self._scenario
        relative, absolute = (action.find(f"LaneChangeTarget/{one}TargetLane") for one in ("Relative", "Absolute"))
        if relative is not None:
            of = self._known(scenario.text(relative.get("entityRef", ""), local))
            lane = (of.place.lane if of.place else 0) + round(scenario.fixed(self._stated(relative, "value"), local))
        elif absolute is not None:
            lane = _index(round(scenario.fixed(self._stated(absolute, "value"), local)))
        else:
            raise self._refused(action, actor.name, ["RelativeTargetLane", "AbsoluteTargetLane"])
        to_left = self._left_of(lane)
        step = to_left - self._lanes[actor.name]
        if abs(step) != 1 or abs(to_left) > 1 or self._is_oncoming(actor):
            raise InvalidRequest(
                f"{scenario.file}: a <LaneChangeAction> moves '{shown_name(actor.name)}' by {abs(step)} lanes, "
                f"{abs(to_left)} lanes from the ego's",
                valid=["a change by one lane between the ego's lane and the lanes next to it"],
                next_step=WRITE_YAML,
            )
        dynamics = action.find("LaneChangeActionDynamics")
        if dynamics is None:
            raise self._refused(action, actor.name, ["LaneChangeActionDynamics"])
        value = self._formula(self._stated(dynamics, "value"), local)
        shape, dimension = dynamics.get("dynamicsShape"), dynamics.get("dynamicsDimension")
        lasts = {
            "time": value,
            "rate": f"{LANE_M * _PEAK.get(shape or '', 0.0):.6g} / max(abs({value}), {_LEAST_S})",
            "distance": f"({value}) / max({self._speeds[actor.name]}, {_LEAST_S})",
        }.get(dimension or "", "")
        if not lasts or shape not in _PEAK:
            raise self._refused(
                action, actor.name, [f"dynamicsShape {', '.join(_PEAK)}, with a time, rate or distance"]
            )
        lasts = f"max({lasts}, {_LEAST_LATERAL_S})"
        self._edits.add(
            "change_lane",
            vehicles=[self._vehicles[actor.name]],
            lane="left" if step > 0 else "right",
            lateral_s=f"${self._edits.value(lasts, f'{actor.name}_lateral')}",
            **self._given(trigger, actor),
        )
        self._lanes[actor.name] = to_left
        return lasts

    def _given(self, trigger: _Trigger, actor: _Entity) -> dict[str, str]:
        if trigger.when:
            self._reacts = True
            return {"when": trigger.when}
        return {"time_s": f"${self._edits.value(trigger.time_s, f'{actor.name}_begins')}"}

    # Crossing

    def _is_crossing(self, entity: _Entity) -> bool:
        """Return True if a pedestrian or cyclist walks a trajectory, or begins with a heading across the road."""
        if entity.kind not in _CROSSING:
            return False
        across = entity.place is not None and abs(math.sin(entity.place.heading_rad)) > _ACROSS
        return across or entity.name in self._actors_of("FollowTrajectoryAction")

    def _cross(
        self,
        actor: _Entity,
        trigger: _Trigger,
        actions: Sequence[etree._Element],
        event: etree._Element,
        local: Mapping[str, str],
    ) -> None:
        """Write a crossing: the side, the place and the speed."""
        if actor.name in self._crossed or actor.place is None:
            raise self._refused(event, actor.name, ["one crossing of a pedestrian or cyclist"])
        self._crossed.add(actor.name)
        begin, speed = actor.place, ""
        for action in actions:
            if action.tag == "SpeedAction":
                speed = self._target_speed(action, actor.name, local)
            elif action.tag == "FollowTrajectoryAction":
                begin, timed = self._walk(actor, action, local)
                speed = speed or timed
            else:
                raise self._refused(action, actor.name, _ACTIONS)
        side_m = self._aside_m(begin) or -math.sin(begin.heading_rad)
        speed = speed or actor.speed
        if self._scenario.now(speed) <= 0.0 or abs(side_m) < 0.1:
            raise self._refused(event, actor.name, ["a crossing with a speed, from one side of the ego's lane"])
        lanelet, station_m = _ROADS[self._road]
        ahead = f"({self._ahead(replace(actor, place=begin))}) - ({self._ego.front_m}) + {self._ego.length_m / 2:g}"
        given = (
            {"when": trigger.when}
            if trigger.when
            else {"duration_s": f"${self._edits.value(f'max({trigger.time_s}, {_LEAST_S})', f'{actor.name}_stands')}"}
        )
        self._reacts |= bool(trigger.when)
        self._edits.add(
            "add_vehicle",
            vehicle_class=actor.kind,
            at=lanelet,
            position=self._text(f"{station_m:g} + {ahead}", f"{actor.name}_at", "m"),
            side="left" if side_m > 0 else "right",
            speed=self._text(speed, f"{actor.name}_speed", "m/s"),
            **given,
        )
        self._scenario.notes.append(f"'{shown_name(actor.name)}' begins at the kerb")

    def _walk(self, actor: _Entity, action: etree._Element, local: Mapping[str, str]) -> tuple[_Place, str]:
        """Return the beginning of a straight way across the road, and the speed if its ends have times."""
        scenario = self._scenario
        vertices = list(action.iter("Vertex"))
        if len(vertices) < 2:
            raise self._refused(action, actor.name, ["Polyline"])
        begin, end = (
            self._position(self._only(vertex, "Position/*"), actor.name, {}, (), local)
            for vertex in (vertices[0], vertices[-1])
        )
        across = f"abs({LANE_M:g} * ({begin.lane} - {end.lane}) + ({begin.aside}) - ({end.aside}))"
        along_m = abs(scenario.now(f"({begin.s}) - ({end.s})"))
        if along_m > _STRAIGHT_M or scenario.now(across) < LANE_M / 2:
            raise self._refused(action, actor.name, ["a way straight across the ego's lane"])
        times = [vertex.get("time") for vertex in (vertices[0], vertices[-1])]
        if times[0] is None or times[1] is None:
            return begin, ""
        lasts = f"(({self._formula(times[1], local)}) - ({self._formula(times[0], local)}))"
        return begin, f"({across}) / {lasts}" if scenario.now(lasts) > 0.0 else ""

    # Triggers

    def _trigger(
        self, element: etree._Element | None, owner: etree._Element, actor: _Entity | None, local: Mapping[str, str]
    ) -> _Trigger | None:
        """Return a start trigger; None if there is none."""
        if element is None:
            return None
        conditions = list(element.iterfind("ConditionGroup/Condition"))
        if not conditions:
            return None
        if len(conditions) > 1:
            raise self._refused(element, owner.get("name", ""), ["a single Condition"])
        condition = conditions[0]
        delay = self._formula(condition.get("delay", "0"), local)
        kinds = [one for one in condition.iter() if one.tag.endswith("Condition") and one.tag not in _GROUPS]
        if len(kinds) != 1:
            raise self._refused(condition, owner.get("name", ""), _TRIGGERS)
        kind = kinds[0]
        if kind.tag == "SimulationTimeCondition":
            time_s = self._formula(self._stated(kind, "value"), local)
            return _Trigger(time_s if delay == "0" else f"{time_s} + {delay}")
        if kind.tag == "StoryboardElementStateCondition":
            return self._after(kind, delay, local)
        if actor is None or delay != "0":
            raise self._refused(kind, owner.get("name", ""), ["SimulationTimeCondition"])
        return self._near(kind, condition, actor, local)

    def _after(self, kind: etree._Element, delay: str, local: Mapping[str, str]) -> _Trigger:
        """Return the trigger that refers to the start or the end of an earlier action, event or act."""
        name = self._scenario.text(kind.get("storyboardElementRef", ""), local)
        if name not in self._times:
            raise self._refused(kind, name, ["an earlier act, event or action of another road user"])
        trigger, end = self._times[name]
        starts = kind.get("state") in ("startTransition", "runningState")
        if trigger.when and not starts:
            raise self._refused(kind, name, ["the end of something that starts at a time"])
        if starts:
            return trigger if delay == "0" or trigger.when else _Trigger(f"({trigger.time_s}) + {delay}")
        return _Trigger(f"({end}) + {delay}")

    def _near(
        self, kind: etree._Element, condition: etree._Element, actor: _Entity, local: Mapping[str, str]
    ) -> _Trigger:
        """Return the trigger of a distance or a time between two entities, or of a way of the ego."""
        scenario = self._scenario
        who = [
            self._known(scenario.text(one.get("entityRef", ""), local))
            for one in condition.iterfind("ByEntityCondition/TriggeringEntities/EntityRef")
        ]
        value = self._formula(self._stated(kind, "value"), local)
        if kind.tag == "TraveledDistanceCondition" and who == [self._ego]:
            lanelet, station_m = _ROADS[self._road]
            return _Trigger(when=f"ego@{lanelet}:{self._text(f'{station_m:g} + ({value})', 'passed', 'm')}")
        target = kind.get("entityRef") or next((one.get("entityRef") for one in kind.iter("EntityRef")), None)
        if target is None or len(who) != 1 or kind.get("rule") not in ("lessThan", "lessOrEqual"):
            raise self._refused(kind, actor.name, [*_TRIGGERS, "rule lessThan"])
        one, other = who[0], self._known(scenario.text(target, local))
        ego_speed = f"max({self._ego.speed}, {_LEAST_S})"
        follower, leader = (
            (other, one) if scenario.now(self._ahead(one)) > scenario.now(self._ahead(other)) else (one, other)
        )
        closing = f"max(({follower.speed}) - ({leader.speed}), {_LEAST_S})"
        distances = {
            "RelativeDistanceCondition": value,
            "TimeHeadwayCondition": f"({value}) * ({one.speed})",
            "TimeToCollisionCondition": f"({value}) * {closing}",
        }
        if kind.tag not in distances or kind.get("relativeDistanceType", "longitudinal") == "lateral":
            raise self._refused(kind, actor.name, _TRIGGERS)
        gap_m = distances[kind.tag]
        if kind.get("freespace") != "true":
            gap_m = f"{gap_m} - ({follower.front_m}) - ({leader.rear_m})"
        if follower is self._ego and leader is actor:
            # The edits' trigger measures from the ego's front to the centre of the other.
            aside = LANE_M * self._left(actor)
            center = f"max({gap_m}, 0) + {actor.length_m / 2:g}"
            seconds = f"sqrt(pow({center}, 2) + {aside * aside:g}) / {ego_speed}"
            return _Trigger(when=f"gap<={self._text(seconds, f'{actor.name}_gap', 's')}")
        if self._ego in (follower, leader):
            raise self._refused(kind, actor.name, ["the ego behind the road user that acts"])
        between = f"({self._ahead(leader)}) - ({self._ahead(follower)}) - ({leader.rear_m}) - ({follower.front_m})"
        return _Trigger(f"max(({between} - ({gap_m})) / {closing}, 0)")

    # Common parts

    def _target_speed(self, action: etree._Element, owner: str, local: Mapping[str, str]) -> str:
        absolute = action.find("SpeedActionTarget/AbsoluteTargetSpeed")
        if absolute is not None:
            return self._formula(self._stated(absolute, "value"), local)
        relative = action.find("SpeedActionTarget/RelativeTargetSpeed")
        if relative is None or relative.get("continuous") == "true":
            raise self._refused(action, owner, ["AbsoluteTargetSpeed", "RelativeTargetSpeed with continuous=false"])
        of = self._known(self._scenario.text(relative.get("entityRef", ""), local))
        value = self._formula(self._stated(relative, "value"), local)
        is_factor = relative.get("speedTargetValueType") == "factor"
        return f"({of.speed}) * ({value})" if is_factor else f"({of.speed}) + ({value})"

    def _only(self, element: etree._Element, path: str) -> etree._Element:
        """Return the only element at a path."""
        found = list(element.iterfind(path))
        if len(found) != 1:
            raise InvalidRequest(
                f"{self._scenario.file}: <{shown_name(element.tag)}> has {len(found)} elements at {path}, not 1",
                next_step="correct the file",
            )
        return found[0]

    def _stated(self, element: etree._Element, attribute: str) -> str:
        """Return an attribute that must be there."""
        value = element.get(attribute, "")
        if not value.strip():
            raise InvalidRequest(
                f"{self._scenario.file}: <{shown_name(element.tag)}> has no {attribute}",
                next_step="add the attribute to the file",
            )
        return value

    def _formula(self, text: str, local: Mapping[str, str] | None = None) -> str:
        return self._scenario.formula(text, local)

    def _horizon_s(self) -> float:
        """Return the time after the last event and the last meeting, for the declared values.

        It is limited by the stop trigger and by the duration of the road's scenario.
        """
        now = self._scenario.now
        stops = [
            now(self._formula(self._stated(one, "value")))
            for one in self._scenario.root.iterfind("Storyboard/StopTrigger//SimulationTimeCondition")
        ]
        times = [now(end) for trigger, end in self._times.values() if not trigger.when]
        for entity in self._others:
            along_mps = 0.0 if entity.name in self._crossed else now(entity.speed)
            closing_mps = now(self._ego.speed) + (along_mps if self._is_oncoming(entity) else -along_mps)
            if closing_mps > _LEAST_RATE_MPS2:
                times.append(now(self._ahead(entity)) / closing_mps)
        longest_s = min([max([*times, 0.0]) + _AFTER_S, *(time for time in stops if time > 0.0), _LONGEST_S])
        return round(max(longest_s, _LEAST_S), 1)

    def _refused(self, element: etree._Element | None, owner: str, valid: list[str]) -> InvalidRequest:
        tag = "element" if element is None else element.tag
        of = f" of '{shown_name(owner)}'" if owner else ""
        return InvalidRequest(
            f"{self._scenario.file}: <{shown_name(tag)}>{of} has no counterpart among the edits",
            valid=valid,
            next_step=WRITE_YAML,
        )


def _declared(element: etree._Element) -> dict[str, str]:
    """Return the values of the parameters that an element declares, by name."""
    declarations = element.iterfind("ParameterDeclarations/ParameterDeclaration")
    return {one.get("name", ""): one.get("value", "") for one in declarations}


def _index(lane: int) -> int:
    """Return the number of a lane without the gap at the reference line: −1 for lane −1, 0 for lane 1."""
    return lane - 1 if lane > 0 else lane


def _leaves(action: etree._Element) -> list[etree._Element]:
    """Return the actions inside an action element, without the elements that only group them."""
    found = []
    for inner in action:
        grouped = inner.tag in ("PrivateAction", "LongitudinalAction", "LateralAction", "RoutingAction")
        found += _leaves(inner) if grouped else [inner]
    return found
