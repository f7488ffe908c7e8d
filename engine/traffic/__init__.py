"""Traffic in SUMO: the only module that uses libsumo, and the traffic of generated sites.

``Sumo``: the running simulation: inserts vehicles, gives them orders, reads their state and that of the lanes.
``sumo_running``: context manager of a simulation with its network, vehicle types and options; yields ``Sumo``.
``sumo_version``: returns the installed version of SUMO.
``vehicle_type``: returns a ``vType`` element of SUMO.
``sumo_pose``: returns a vehicle's front bumper and its SUMO angle, from its centre in m and heading in rad.
``LaneChanges``: which lane changes a vehicle of SUMO performs.
``LaneHint``: SUMO's edge and lane index.
``NO_LANE``: the ``LaneHint`` for an unknown lane.
``Demand``: the wanted number of vehicles by class.
``plan_counts``: returns the ``Demand`` of a density and the requested classes, on a site with a given length of lane in
km.
``lane_km_of``: returns the kilometres of lane open to cars, outside junctions.
``FEWEST``: the minimum number of vehicles on a site.
``PAPER_TRIPS``: the paper's numbers of trips by density.
``VEHICLES_PER_LANE_KM``: vehicles per kilometre of lane at the first step, including the ego, by density.
``OpenEdges``: the edges of a net that are open to a class: length, speed, lanes and successors.
``LateTrip``: a trip that begins at a place and time shortly before the recording.
``TripMaker``: creates trips of a class on a net, each long enough to last through the recording if the net allows it.
``TooFewFoundRoom``: raised if too few vehicles are present at step 0.
``simulate_traffic``: fills a site with the wanted vehicles, lets them drive for the warm-up and then records them.
``DrivingStyle``: how all drivers drive: a factor on free speeds, and parameters of SUMO's vehicle types.
``published_calibrations``: returns all published calibrations of drivers by name.
``SPEED_FACTORS``: free speeds in bad weather relative to those in good weather.
``SPEED_FACTORS_SOURCE``: the source of ``SPEED_FACTORS``.
``SHARES_OF_DAY_SOURCE``: the source of the hours' shares of a day.
``heavy_factor``: returns the share of goods vehicles in an hour's traffic, relative to their share in the whole day's.
``NIGHT_HOURS``: the hours that count as night.
``words_of_hour``: returns the catalogue's words for an hour: night, rush hour or nothing.
``vehicles_per_lane_km``: returns the density of traffic in an hour of a working day.
``WalkedPerson``: a simulated person, and whether they are on a crossing during the recording.
``Pedestrians``: puts people onto the pavements of a simulation, and records them.
``apart``: returns the people who overlap no vehicle and no earlier person.
``plan_walks``: returns walks along pavements and over crossings near a place.
``LAST_INSERTION_S``: when the last vehicle enters at most, in s.
``WARM_UP_S``: how long vehicles drive before the first recorded step, in s.
``GeneratedVehicle``: a generated vehicle from step 0 on: class, motion of the centre, and whether it can be driven.
``generated_vehicles``: returns the recorded vehicles with smoothed, drivable motions.
``drop_infeasible``: removes as few vehicles as possible so that the others are drivable and do not overlap; returns the
two groups.
``DroppedVehicle``: a recorded vehicle that is left out, and the reason.
``DECIMALS``: decimal places of the motions.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .conditions import (
        NIGHT_HOURS,
        SHARES_OF_DAY_SOURCE,
        SPEED_FACTORS,
        SPEED_FACTORS_SOURCE,
        heavy_factor,
        published_calibrations,
        vehicles_per_lane_km,
        words_of_hour,
    )
    from .demand import LateTrip, OpenEdges, TripMaker, lane_km_of
    from .motions import DECIMALS, DroppedVehicle, GeneratedVehicle, drop_infeasible, generated_vehicles
    from .pedestrians import Pedestrians, WalkedPerson, apart, plan_walks
    from .simulation import LAST_INSERTION_S, WARM_UP_S, DrivingStyle, TooFewFoundRoom, simulate_traffic
    from .sumo import NO_LANE, LaneChanges, LaneHint, Sumo, sumo_pose, sumo_running, sumo_version, vehicle_type
    from .vehicle_counts import FEWEST, PAPER_TRIPS, VEHICLES_PER_LANE_KM, Demand, plan_counts

__getattr__, __dir__ = lazy_face(__name__, __file__)
