"""Generates one scenario: map → site → net → lanelets → traffic → ego and goal → CommonRoad file → checks.

A scenario that fails is generated again with other traffic at the same site, then at other sites that fit the request.
Of the scenarios that were written, the one with the fewest faults is kept.
"""

import gc
import logging
import math
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

from ...schemas.errors import InvalidRequest, NotPossible, with_values
from ...schemas.generation import (
    LONGEST_DURATION_S,
    THROUGH,
    USUAL_DURATION_S,
    Density,
    GeneratedScenario,
    GenerationRequest,
    RequestedManoeuvre,
    VehicleDemand,
)
from ...schemas.text import cited, counted
from ...schemas.vocabulary import EGO_CLASSES
from ..execution import ProgressReporter
from ..maps import LaneletMap, NetMap, OsmMap, Site, read_map_file
from ..traffic import GeneratedVehicle, lane_km_of, plan_counts
from ..vehicles import vehicle_classes
from .checks import check_scenario, faults_of
from .flows import flow_notes
from .others import LIKELY_AT, MOST_TRIES, EgoChoice, can_be_scripted, found_in, scripted
from .people import people_notes, target_pedestrians
from .planning_problem import NO_TURN, PlanningTask, TaskSpec, choose_task
from .record import absences_of, record_of, with_scripted
from .site_network import SITE_LOST, SiteNetwork, prepare_site, with_later_lights
from .sites import fitting_sites, lacking_turn, other_types, with_streets_that_meet
from .traffic import NO_ROOM, TrafficAim, along_the_site, generate_traffic, without_spares
from .turning_trips import has_ways, needed_s, possible_turns
from .writer import STEP_S, write_scenario

logger = logging.getLogger(__name__)
OWN_ROUNDS, MOST_ROUNDS, MOST_SITES = 2, 5, 10
"""Rounds of traffic at the site's own place, rounds of traffic in all, and sites tried in all (chosen)."""
ROUNDS_TO_SCRIPT = 3
"""Rounds of traffic searched for a manoeuvre of another road user before it is scripted (chosen)."""
LIGHTS_LATER_S, TURNING_SITES = (0.0, 30.0, 60.0, 15.0, 45.0), 2
"""Shifts of the lights for each round with vehicles that make the ego's requested turn, and the sites that try each.

The shifts cover netconvert's usual cycle of 90 s (chosen).
"""
ENOUGH_WITH_TURN = 2
"""Scenarios with the ego's turn after which no further lights are tried (chosen), even if each has a fault."""
DENSER: Mapping[Density, Density] = MappingProxyType({"low": "medium", "medium": "high"})
"""The next density, in which more vehicles may make a turn."""
MOST_LOST = 40
"""Further sites that are skipped because their nets do not show them (chosen): each takes half a second."""
SHOWN_LOST = 3
"""Maximum number of lost sites that a note or a refusal lists."""


def generate_scenario(request: GenerationRequest, report: ProgressReporter) -> GeneratedScenario:
    """Generate one scenario in the request's folder: ``scenario.xml`` and ``scenario.net.xml``.

    A scenario that fails its checks is generated again with other traffic, then at other sites; the notes report this.
    The same request gives the same bytes on one type of machine.

    Raises:
        NotPossible: the map has no such site, a class of vehicles finds no road or no room, or no car can have the
            requested goal.
        InvalidRequest: the ego or goal has no valid form, or the ego's class is excluded from the traffic.
        UnsafeInput: the map file is broken or hostile.
    """
    with _no_collection():
        request.check_turn()
        ego_notes, request = _with_ego_class(request)
        report(0.0, "reading the map")
        osm = read_map_file(Path(request.map_path))
        report(0.02, "looking for sites")
        taken = list[str]()
        if request.longer_streets:
            request, taken = with_streets_that_meet(osm, request)
        sites = fitting_sites(osm, request)
        if request.site_index >= len(sites):
            raise NotPossible(
                f"{cited(request.place)} ({request.map_id}) has only {counted(len(sites), 'site')} for this request"
            )
        own_and_others = sites[request.site_index :: request.site_step]
        with tempfile.TemporaryDirectory(dir=request.folder) as scratch:
            attempts = _Attempts(request, Path(scratch), report)
            attempts.run(osm, own_and_others)
            attempts.turn(is_drawn=not isinstance(osm, (LaneletMap, NetMap)))
            attempts.script()
            best = attempts.best(osm)
            shutil.move(best.path, Path(request.folder) / "scenario.xml")
            shutil.move(best.site.net_path, Path(request.folder) / "scenario.net.xml")
        notes = (*taken, *ego_notes, *best.faults, *best.scenario.notes, *attempts.notes_besides(best))
        if best.scenario.duration_s > request.duration_s:
            notes = (f"recorded for {best.scenario.duration_s:g} s, which the ego's turn needs at this site", *notes)
        return best.scenario.model_copy(update={"notes": notes})


@contextmanager
def _no_collection() -> Iterator[None]:
    """Suspend garbage collection, which would scan all states of the traffic over and over."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _with_ego_class(request: GenerationRequest) -> tuple[list[str], GenerationRequest]:
    """Return notes on the ego, and the request with the ego's class added to the classes of the other vehicles.

    Raises:
        InvalidRequest: no ego can be of this class, and the traffic excludes it.
    """
    ego = request.ego
    other = ego.other_class or ego.vehicle_class
    if other == "car":
        return [], request
    stated = next((demand for demand in request.vehicles if demand.vehicle_class == other), None)
    if stated is None:
        vehicles = (*request.vehicles, VehicleDemand(vehicle_class=other))
    elif ego.other_class is None:
        vehicles = request.vehicles
    elif stated.most == 0:
        raise InvalidRequest(
            f"no ego can be a {other}, so ego type:{other} adds a {other} to the traffic, but vehicles excludes it",
            valid=[f"type:{name}" for name in EGO_CLASSES],
            next_step=f"leave {other}=0 out of vehicles, or choose another ego",
        )
    else:
        at_least_one = stated if stated.least != 0 else stated.model_copy(update={"least": 1})
        vehicles = tuple(at_least_one if demand is stated else demand for demand in request.vehicles)
    if ego.other_class is None:
        return [], request.model_copy(update={"vehicles": vehicles})
    notes = [f"the ego must be a motor vehicle, so it is a car; the requested {other} is in the traffic"]
    return notes, request.model_copy(update={"vehicles": vehicles})


@dataclass(frozen=True)
class _Attempt:
    """One attempt: a scenario in its own file, and its faults as text.

    ``lacks``: no road user makes the requested manoeuvre; the scenario serves only as a base for scripting. ``astray``:
    the ego's goal must be beyond the site, but its route misses the site's own junction or turns elsewhere too.
    ``followable``: whether a planner can follow the ego's lanes as fast as its goal needs.
    """

    scenario: GeneratedScenario
    path: Path
    site: SiteNetwork
    faults: tuple[str, ...]
    unusable: bool
    lacks: bool = False
    astray: bool = False
    followable: bool = True


class _Attempts:
    """Rounds of traffic at sites until a scenario has no fault; keeps the ``made`` scenarios and the ``refusals``.

    ``lost``: sites that were skipped because their nets lack the features of their type.
    """

    def __init__(self, request: GenerationRequest, scratch: Path, report: ProgressReporter) -> None:
        self._request, self._scratch, self._report = request, scratch, report
        self._requested = request.others
        most = ROUNDS_TO_SCRIPT if self._requested is not None and can_be_scripted(self._requested) else MOST_ROUNDS
        self._rounds, self._most_rounds = 0, request.most_rounds or most
        self.made: list[_Attempt] = []
        self.refusals: list[NotPossible] = []
        self.lost: list[Site] = []
        self._fit: list[tuple[SiteNetwork, Path]] = []

    def run(self, osm: OsmMap, sites: Iterable[Site]) -> None:
        """Try the first usable site twice and each other site once; a single site gets all tries.

        If tries are left and no road user makes the requested manoeuvre, the first site gets these too. A lost site
        uses no try: the next site replaces it. If the request limits the number of sites, the limit applies only until
        a site has given a scenario.
        """
        fit = self._fit
        few = self._request.most_sites
        for number, site in enumerate(sites):
            most = MOST_SITES if few is None or self.made else few
            if number - len(self.lost) >= most or len(self.lost) == MOST_LOST:
                break
            folder = self._scratch / str(number)
            folder.mkdir()
            try:
                prepared = prepare_site(self._request, osm, site, folder, self._report)
            except NotPossible as refusal:
                place = f"{site.latitude:.5f},{site.longitude:.5f}"
                logger.debug(
                    "site_refused number=%d kind=%s at=%s reason=%r", number, site.kind, place, refusal.message
                )
                if refusal.reason == SITE_LOST:
                    self.lost.append(site)
                else:
                    self.refusals.append(refusal)
                continue
            fit.append((prepared, folder))
            if self._is_done(prepared, folder, range(OWN_ROUNDS if len(fit) == 1 else 1)):
                return
            if self._request.goal.lanelet is not None:  # an id refers to another lanelet elsewhere
                break
        is_sought = bool(fit) and self._requested is not None and all(attempt.lacks for attempt in self.made)
        is_full = any(refusal.reason == NO_ROOM for refusal in self.refusals)
        is_routed = self._lacks_turn() and has_ways(fit[0][0].focus)  # more chance traffic hardly helps
        if (len(fit) == 1 or is_sought) and few is None and not is_full and not is_routed:
            self._is_done(*fit[0], range(OWN_ROUNDS, MOST_ROUNDS))

    def turn(self, *, is_drawn: bool) -> None:
        """If no ego takes the requested way through the site, route vehicles along it until one of them can be the ego.

        If the turn takes longer than the recording, and the call does not state the duration, the recording is longer.
        If these vehicles wait at red lights, the cycles of the lights are shifted, unless the map states their programs
        (``is_drawn``: it does not). A request with a limit on rounds or sites skips this step.
        """
        usable = [attempt for attempt in self.made if not attempt.unusable]
        lacks = self._lacks_turn()
        astray = bool(usable) and all(attempt.astray for attempt in usable)
        if self._request.most_sites is not None or not (lacks or astray):
            return
        for number, later_s in enumerate(LIGHTS_LATER_S, start=MOST_ROUNDS):
            for site, folder in self._fit[: 1 if astray else TURNING_SITES]:
                shifted = folder / f"lights_{number}"
                shifted.mkdir()
                tried = with_later_lights(site, later_s, shifted) if is_drawn and not site.footways else site
                made = len(self.made)
                longer = self._with_time_for_turn(site) if lacks else self._request
                if self._is_faultless(tried, number, shifted, routed=longer):
                    return
                if lacks and sum(not attempt.unusable for attempt in self.made) >= ENOUGH_WITH_TURN:
                    return
                if astray and any(one.followable and not one.astray and not one.unusable for one in self.made[made:]):
                    return

    def best(self, osm: OsmMap) -> _Attempt:
        """Return the usable attempt with the fewest faults; the first wins a tie.

        If possible, a planner can follow it, and it is not astray. The latter comes first if streets or a turn are
        requested.

        Raises:
            NotPossible: no attempt is usable. The stated cause is a ramp that does not lead where it must, otherwise
                the first refusal, otherwise the faults of the first attempt. If all sites were lost, the error lists
                the other types that the map has.
        """
        usable = [attempt for attempt in self.made if not attempt.unusable and not attempt.lacks]
        if usable:
            return min(usable, key=self._rank)
        if (lacking := lacking_turn(osm, self._request)) is not None:
            raise lacking
        if self._requested is not None and any(attempt.lacks for attempt in self.made):
            raise self._without_manoeuvre(self._requested)
        if self.refusals and self.refusals[0].reason == NO_TURN and self._fit:
            raise self._without_turn(self.refusals[0])
        if self.refusals:
            raise self.refusals[0]
        if self.made:
            raise NotPossible(
                f"no scenario here passes its checks: {'; '.join(self.made[0].faults)}",
                next_step="choose another place, scenario_type, density or seed",
            )
        raise NotPossible(
            self._lost_sites(),
            valid=other_types(osm, self._request),
            next_step="choose another scenario_type, or another place",
            reason=SITE_LOST,
        )

    def _rank(self, attempt: _Attempt) -> tuple[bool, bool, bool, int]:
        """Return the rank of a usable attempt; the least is the best."""
        names_a_way = bool(self._request.streets) or self._request.goal.turn is not None
        return attempt.astray and names_a_way, not attempt.followable, attempt.astray, len(attempt.faults)

    def notes_besides(self, best: _Attempt) -> list[str]:
        """Return notes on the skipped sites and on why the other attempts were dropped, each reason once.

        Reasons that also apply to the best attempt are left out, because its own notes state them.
        """
        others = [attempt for attempt in self.made if attempt is not best and not attempt.lacks]
        faults = [fault for attempt in others for fault in attempt.faults]
        reasons = dict.fromkeys([*faults, *(refusal.message for refusal in self.refusals)])
        passed_over = [f"skipped: {self._lost_sites()}"] if self.lost else []
        noted = {*best.faults, *best.scenario.notes}
        return [*passed_over, *(f"one attempt was discarded: {reason}" for reason in reasons if reason not in noted)]

    def _lost_sites(self) -> str:
        named = [f"{site.kind} at {site.latitude:.5f}, {site.longitude:.5f}" for site in self.lost[:SHOWN_LOST]]
        more = [f"{len(self.lost) - SHOWN_LOST} more"] if len(self.lost) > SHOWN_LOST else []
        return f"{counted(len(self.lost), 'site')} lost when the road network is built: {'; '.join([*named, *more])}"

    def _is_done(self, site: SiteNetwork, folder: Path, rounds: Iterable[int]) -> bool:
        """Generate traffic at a site until a scenario has no fault or the rounds are used up; return True if one has no
        fault. A full site gets one round: different traffic would not find more room there.
        """
        for number in rounds:
            refused = len(self.refusals)
            if self._is_faultless(site, number, folder) or self._rounds == self._most_rounds:
                return True
            if any(refusal.reason == NO_ROOM for refusal in self.refusals[refused:]):
                return False
        return False

    def _lacks_turn(self) -> bool:
        """Return whether no ego so far takes the requested way through the site, and no attempt is usable."""
        has_no_turn = any(refusal.reason == NO_TURN for refusal in self.refusals)
        return has_no_turn and all(attempt.unusable for attempt in self.made)

    def _with_time_for_turn(self, site: SiteNetwork) -> GenerationRequest:
        """Return the request with the duration that the ego's turn needs at a site, if it may be prolonged."""
        request = self._request
        if request.longest_s is None or (wanted_s := self._needed_s(site)) <= request.duration_s:
            return request
        return request.model_copy(update={"duration_s": min(wanted_s, request.longest_s)})

    def _needed_s(self, site: SiteNetwork) -> float:
        """Return the duration in whole seconds that the ego's turn needs at a site."""
        ego_class = vehicle_classes()[self._request.ego.vehicle_class]
        return float(math.ceil(needed_s(site.net, site.focus, self._request.goal.turn, ego_class.sumo_class)))

    def _is_faultless(
        self, site: SiteNetwork, round_number: int, folder: Path, *, routed: GenerationRequest | None = None
    ) -> bool:
        """Make one scenario, and return whether it has no fault.

        ``routed``: the request, with its duration, if vehicles are routed along the way that the ego must take.
        """
        self._rounds += 1
        path = folder / f"scenario_{round_number}.xml"
        try:
            scenario, missed, astray, followable = _write(
                routed or self._request, site, round_number, path, self._report, turning=routed is not None
            )
        except NotPossible as refusal:
            logger.debug("round_refused round=%d reason=%r", round_number, refusal.message)
            self.refusals.append(refusal)
            return False
        broken, weak = faults_of(scenario.checks)
        lacks = self._requested is not None and not scenario.others
        faults = (*broken, *weak, *missed)
        self.made.append(_Attempt(scenario, path, site, faults, bool(broken), lacks, astray, followable))
        logger.debug("round_made round=%d faults=%r lacks_manoeuvre=%s", round_number, faults, lacks)
        return not faults and not lacks

    def script(self) -> None:
        """Script an actor in one of the scenarios if no traffic contains the requested manoeuvre."""
        if self._requested is None or any(not attempt.unusable and not attempt.lacks for attempt in self.made):
            return
        bases = sorted((attempt for attempt in self.made if not attempt.unusable), key=lambda one: len(one.faults))
        numbers = iter(range(MOST_TRIES))
        for base in bases:
            made = _scripted(base, self._requested, self._request.seed, numbers)
            if made is not None:
                self.made.append(made)
                return

    def _without_turn(self, refusal: NotPossible) -> NotPossible:
        """Return the refusal: it lists the calls that keep the turn first, or else the possible turns."""
        site, request = self._fit[0][0], self._request
        ego = vehicle_classes()[request.ego.vehicle_class]
        there = possible_turns(site.net, site.focus, ego.sumo_class)
        if there is not None and request.goal.turn not in there and len(self._fit) == 1:
            goals = [f"{THROUGH}:{turn}" for turn in sorted(there)]
            return NotPossible(
                f"no route through the site makes the turn {request.goal.turn!r}",
                valid=goals,
                next_step="choose one of these goals, or another place",
                reason=refusal.reason,
                remedies=[with_values(goal=goal) for goal in (*goals, None)],
            )
        denser = DENSER.get(request.density)
        wanted_s = min(max(self._needed_s(site), float(USUAL_DURATION_S)), float(LONGEST_DURATION_S))
        return NotPossible(
            refusal.message,
            valid=refusal.valid,
            next_step=refusal.next_step,
            reason=refusal.reason,
            remedies=[
                *([with_values(duration_s=wanted_s)] if request.duration_s < wanted_s else []),
                with_values(seed=request.seed + 1),
                *([] if denser is None else [with_values(density=denser)]),
                with_values(goal=None, ego=None),
            ],
        )

    def _without_manoeuvre(self, wanted: RequestedManoeuvre) -> NotPossible:
        draws = counted(sum(attempt.lacks for attempt in self.made), "simulation")
        scripted_too = ", and a scripted actor found no room for it" if can_be_scripted(wanted) else ""
        return NotPossible(
            f"no road user makes the manoeuvre {wanted} on the ego's route in {draws} of traffic here{scripted_too}",
            valid=[f"scenario_type={kind}" for kind in LIKELY_AT[wanted.name]],
            next_step="choose one of these sites, a higher density, a longer duration_s or another seed",
            reason="no_manoeuvre",
        )


def _write(
    request: GenerationRequest,
    site: SiteNetwork,
    round_number: int,
    path: Path,
    report: ProgressReporter,
    *,
    turning: bool = False,
) -> tuple[GeneratedScenario, list[str], bool, bool]:
    """Generate, write and check one scenario at one site.

    ``turning``: True to route vehicles along the way through the site that the ego must take.

    Returns:
        The scenario, how its ego misses the site as text, whether the ego is astray, and whether a planner can
        follow its lanes.

    Raises:
        NotPossible: the site cannot provide what the request needs.
    """
    spec = TaskSpec(request.goal, request.ego, request.duration_s)
    aim = replace(TrafficAim.of(request, site.net), turning=turning)
    lane_km = lane_km_of(site.net)
    demand = plan_counts(request.density, request.on_wheels, lane_km, aim.per_lane_km, fewest=aim.fewest)
    requested_demand = demand.with_ego(request.ego.vehicle_class)
    traffic = generate_traffic(request, requested_demand, aim, site, round_number, path.parent, report)
    demand = traffic.demand
    ranked = along_the_site(traffic.vehicles, site)
    report(0.75, "choosing ego and goal")
    to_choose_from = ranked if request.ego.index is None else without_spares(ranked, demand)
    task = choose_task(spec, to_choose_from, site.network, site.focus, STEP_S)
    people = tuple(person.body for person in traffic.people)

    def cast_of(chosen: PlanningTask) -> tuple[GeneratedVehicle, ...]:
        ego = chosen.ego
        return without_spares((ego, *(vehicle for vehicle in ranked if vehicle is not ego)), demand)

    vehicles = cast_of(task)
    if len(vehicles) == 1 and demand.total > 1:
        raise NotPossible(
            "no vehicle but the ego found room on the roads of this site",
            next_step="choose a higher density, another place or other road_classes",
        )
    report(0.8, "writing the file")
    obstacle_ids = write_scenario(path, site.metadata, site.network, (*vehicles[1:], *people), task, site.roads)
    wanted = request.others
    if wanted is not None:
        choice = EgoChoice(path, lambda chosen: (*cast_of(chosen)[1:], *people))
        for requested in (wanted, wanted.of_any_class):
            try:
                task = choose_task(
                    spec, to_choose_from, site.network, site.focus, STEP_S, accepts=partial(choice.happens, requested)
                )
            except NotPossible:  # not on any ego's route
                continue
            vehicles = cast_of(task)
            obstacle_ids = write_scenario(path, site.metadata, site.network, (*vehicles[1:], *people), task, site.roads)
            break
    report(0.85, "reading back and checking")
    checks = check_scenario(path, task.ego.body, site.findings)
    missed = [] if task.focus_passed else [site.focus.missed(only_car=request.ego.index is not None)]
    off_street = [] if task.takes_street else [site.focus.left_the_street(only_car=request.ego.index is not None)]
    missed += off_street
    if not task.on_spot:
        missed.append(site.focus.passed_close_by(only_car=request.ego.index is not None))
    if not task.turns_clearly:
        missed.append("the ego also turns elsewhere on its route, or starts or ends too near the site to show its turn")
    if task.focus_passed and not task.focus_left:
        missed.append("the goal is on the site, not beyond it: no car that can be the ego leaves the site in time")
    if not task.takes_most:
        missed.append(
            "the goal takes less than half of the duration: cars leave the map section or turn elsewhere earlier"
        )
    if not task.followable:
        missed.append("the ego's lanes are too tight for the mean speed that the goal's time requires")
        if request.ego.vehicle_class != "car":
            missed[-1] += ", or leave no room for its body"
    # Other traffic may do better beyond the site, and on a requested street, unless the goal itself is at a place.
    faults = missed if request.goal.is_through else off_street if request.goal.lanelet is None else []
    notes = [text for text in missed if text not in faults]
    if task.stands_in:
        notes.append(
            f"{request.ego} has no goal {request.goal.in_words()} on its route; a later car that has one is the ego"
        )
    counted = [] if aim.plan is None else flow_notes(aim.plan, vehicles, site)
    walking = 0 if request.people is None else target_pedestrians(request.people, request.density, demand.total)
    if request.people is not None:
        counted += people_notes(traffic.people, walking)
    scenario = record_of(request, site, demand, aim, task, vehicles, people, obstacle_ids, checks, [*notes, *counted])
    absences = absences_of(request.ego, requested_demand, traffic, vehicles, walking, stands_in=task.stands_in)
    scenario = scenario.model_copy(update={"absences": absences})
    if wanted is not None and (found := found_in(path, wanted, scenario.vehicle_classes)) is not None:
        scenario = scenario.model_copy(update={"others": found.in_words()})
    is_direct = task.takes_street and task.focus_passed > 0 and task.on_spot and task.turns_clearly
    return scenario, faults, request.goal.is_through and not is_direct, task.followable


def _scripted(base: _Attempt, wanted: RequestedManoeuvre, seed: int, numbers: Iterator[int]) -> _Attempt | None:
    """Return an attempt's scenario with an actor that makes the manoeuvre, or None if no actor can.

    ``numbers``: the tries that the request has left.
    """
    scenario, folder = base.scenario, base.path.parent
    classes, requested = scenario.vehicle_classes, scenario.classes_asked
    needed = [name for name, count in scenario.classes_realised.items() if count <= requested.get(name, 0)]
    made = scripted(base.path, scenario.benchmark_id, wanted, classes, folder, seed, numbers, needed)
    if made is None:
        return None
    checks = check_scenario(made.path, None, base.site.findings)
    broken, weak = faults_of(checks)
    if broken:
        return None
    scenario = with_scripted(scenario, base.path, made.path, made.added).model_copy(
        update={"checks": checks, "others": made.found.in_words()}
    )
    missed = tuple(fault for fault in base.faults if fault not in faults_of(base.scenario.checks)[1])
    return replace(base, scenario=scenario, path=made.path, faults=(*weak, *missed), lacks=False)
