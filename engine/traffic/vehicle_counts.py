"""How many vehicles of each class a site gets: the numbers in the request, and a density for the rest."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from ...schemas.errors import UnknownName, closest
from ...schemas.generation import Density, VehicleDemand
from ..vehicles import vehicle_classes

VEHICLES_PER_LANE_KM: dict[Density, float] = {"low": 7.0, "medium": 16.0, "high": 28.0}
"""Vehicles per kilometre of lane at the first step, including the ego.

The bounds of levels of service A, C and E for motorways (Highway Capacity Manual, in passenger cars). The paper instead
counts trips per scenario (20, 50, 100), regardless of the size of its map.
"""
PAPER_TRIPS: dict[Density, int] = {"low": 20, "medium": 50, "high": 100}
"""Trips of a scenario by density in the paper; recorded in addition to the realised density."""
FEWEST, MOST = 8, 300
"""Bounds for vehicles on a site (chosen): fewer make no traffic, more would only be slow."""
NAMED_SHARE = 0.2
"""Share of the vehicles for a class that was requested without number or share, at least one (chosen)."""


@dataclass(frozen=True)
class Demand:
    """The wanted vehicles by class; ``least`` and ``most`` are the request's own bounds, excluding the ego.

    ``bounded_by``: what keeps the number of vehicles below the requested density, if anything. ``ego_class``: the class
    of the vehicle that is the ego.
    """

    counts: dict[str, int]
    least: dict[str, int]
    most: dict[str, int]
    bounded_by: str = ""
    ego_class: str = "car"

    @property
    def total(self) -> int:
        """All wanted vehicles, including the ego."""
        return sum(self.counts.values())

    @property
    def needed(self) -> dict[str, int]:
        """How many vehicles of each class must be present, including the ego."""
        return {name: self.least.get(name, 0) + (name == self.ego_class) for name in self.counts}

    def with_ego(self, vehicle_class: str) -> "Demand":
        """Return the same demand with one vehicle of a class as the ego instead of the default car."""
        if vehicle_class == self.ego_class:
            return self
        counts = self.counts | {"car": self.counts["car"] - 1}
        counts[vehicle_class] = counts.get(vehicle_class, 0) + 1
        return replace(self, counts=counts, ego_class=vehicle_class)

    def with_spares(self, share: float, more: Mapping[str, int]) -> "Demand":
        """Return the demand with more cars, by a share of all vehicles and at least one, and more of every class.

        A class with few vehicles gets no spare vehicle, because that would be a large part of the traffic, unless the
        class is in ``more``.
        """
        spare = {name: round(share * count) for name, count in self.counts.items()}
        spare["car"] = max(1, round(share * self.total))
        return replace(self, counts={name: n + spare[name] + more.get(name, 0) for name, n in self.counts.items()})

    def fewer(self, share: float, reason: str) -> "Demand":
        """Return a share of the vehicles of every class, but at least as many as the request needs."""
        needed = self.needed
        counts = {name: max(needed[name], int(share * count)) for name, count in self.counts.items()}
        return replace(self, counts=counts, bounded_by=reason)


def plan_counts(
    density: Density,
    vehicles: Iterable[VehicleDemand],
    lane_km: float,
    per_lane_km: float | None = None,
    *,
    fewest: int = FEWEST,
) -> Demand:
    """Split a density over the classes: requested numbers and shares first, then cars; one more car is the ego.

    ``lane_km``: kilometres of lane at the site that are open to cars. ``per_lane_km``: vehicles per kilometre of lane,
    instead of the density's. ``fewest``: the minimum number of vehicles on the site.

    Raises:
        UnknownName: a class does not exist.
    """
    known = vehicle_classes()
    requested = {demand.vehicle_class: demand for demand in vehicles}
    for name in requested:
        if name not in known:
            raise UnknownName(f"there is no vehicle class {name!r}", valid=closest(name, known), reason="unknown_class")
    dense = round((per_lane_km or VEHICLES_PER_LANE_KM[density]) * lane_km)
    wanted = min(max(dense, fewest), MOST)
    named = NAMED_SHARE / max(1, len(requested) / 2)
    counts = {name: _count_of(demand, wanted, named) for name, demand in requested.items()}
    rest = max(wanted - sum(count for name, count in counts.items() if name != "car"), 1)
    if (cars := requested.get("car")) is not None:
        rest = max(rest, cars.needed + 1)
        rest = rest if cars.most is None else min(rest, cars.most + 1)
    counts["car"] = rest
    return Demand(
        counts={name: counts[name] for name in known if counts.get(name)},
        least={name: requested[name].needed for name in known if name in requested},
        most={name: limit for name, demand in sorted(requested.items()) if (limit := demand.most) is not None},
        bounded_by=f"a site has at most {MOST} vehicles" if dense > MOST else "",
    )


def _count_of(demand: VehicleDemand, wanted: int, named_share: float) -> int:
    """Return how many of ``wanted`` vehicles are of a class: its number, or its share and at least one."""
    if demand.least is not None:
        return demand.least
    return max(1, round(wanted * (named_share if demand.share is None else demand.share)))
