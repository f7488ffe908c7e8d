"""Traffic in SUMO: the only access to libsumo, and how a generated site is filled with traffic.

``Sumo``: The running simulation: puts vehicles in, gives them orders, reads what they and the lanes are like.
``sumo_running``: A simulation with its network, vehicle types and options, as a context manager; yields ``Sumo``.
``sumo_version``: The installed version of SUMO.
``vehicle_type``: A ``vType`` element of SUMO.
``sumo_pose``: Front bumper and SUMO's angle of a vehicle, from its centre in m and heading in rad.
``LaneChanges``: Which changes of lane a vehicle of SUMO does.
``LaneHint``: SUMO's edge and lane index.
``NO_LANE``: The ``LaneHint`` for an unknown lane.
``Demand``: Vehicles wanted by class.
``plan_counts``: The ``Demand`` of a density and the classes asked for, on a site with kilometres of lane.
``lane_km_of``: Kilometres of lane that are open to cars, the insides of junctions left out.
``FEWEST``: The least number of vehicles on a site.
``PAPER_TRIPS``: The paper's numbers of trips by density.
``VEHICLES_PER_LANE_KM``: Vehicles on a kilometre of lane at the first step, the ego included, by density.
``OpenEdges``: The edges of a net that are open to a class: how long, fast and wide they are, and what follows them.
``TripMaker``: Makes trips of a class on a net, each long enough to last through the recording where the net allows it.
``TooFewFoundRoom``: What is raised where too few vehicles are there at step 0.
``simulate_traffic``: Fill a site with the wanted vehicles, let them drive for the warm-up and record what follows.
``DrivingStyle``: How all drivers of a traffic drive: a factor on free speeds, parameters of SUMO's vehicle types.
``published_calibrations``: All published calibrations of drivers by name.
``SPEED_FACTORS``: Free speeds in bad weather over those in good weather.
``SPEED_FACTORS_SOURCE``: Whose figures they are.
``SHARES_OF_DAY_SOURCE``: Whose figures the hours' shares of a day are.
``heavy_factor``: The share of goods vehicles in an hour's traffic over that in the whole day's.
``NIGHT_HOURS``: Hours that are night.
``words_of_hour``: What a catalogue calls an hour: night, rush hour or nothing.
``vehicles_per_lane_km``: How dense traffic is in an hour of a working day.
``WalkedPerson``: A person who was simulated, and whether he is on a crossing during the recording.
``Pedestrians``: Puts people onto the pavements of a simulation, and records them.
``apart``: The people who overlap no vehicle and nobody before them.
``plan_walks``: Walks along pavements and over crossings near a place.
``WARM_UP_S``: How long vehicles drive before the first recorded step, in s.
``GeneratedVehicle``: A generated vehicle from step 0 on: class, motion of the centre, and whether it can be driven.
``generated_vehicles``: The recorded vehicles with smoothed, drivable motions.
``drop_infeasible``: Removes the fewest vehicles so that the others are drivable and apart; returns both.
``DroppedVehicle``: A recorded vehicle that is left out, and why.
``DECIMALS``: Decimal places of the motions.
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
    from .demand import OpenEdges, TripMaker, lane_km_of
    from .motions import DECIMALS, DroppedVehicle, GeneratedVehicle, drop_infeasible, generated_vehicles
    from .pedestrians import Pedestrians, WalkedPerson, apart, plan_walks
    from .simulation import WARM_UP_S, DrivingStyle, TooFewFoundRoom, simulate_traffic
    from .sumo import NO_LANE, LaneChanges, LaneHint, Sumo, sumo_pose, sumo_running, sumo_version, vehicle_type
    from .vehicle_counts import FEWEST, PAPER_TRIPS, VEHICLES_PER_LANE_KM, Demand, plan_counts

__getattr__, __dir__ = lazy_face(__name__, __file__)
