"""Generated traffic: how many vehicles, where they drive, SUMO's simulation, and drivable motions of it.

``TripMaker``: Makes trips of a class on a net, each long enough to last through the recording where the net allows
    it.
``lane_km_of``: Kilometres of lane that are open to cars, the insides of junctions left out.
``DECIMALS``: TODO.
``Participant``: A vehicle from step 0 on.
``participants``: The recorded vehicles with smoothed, drivable motions.
``drop_infeasible``: The vehicles without the fewest whose removal leaves all drivable and no two overlapping.
``WARM_UP_S``: TODO.
``simulate_traffic``: Fill a site with the wanted vehicles, let them drive for the warm-up and record what follows.
``Demand``: Vehicles wanted by class.
``FEWEST``: Bounds for vehicles on a site.
``PAPER_TRIPS``: TODO.
``VEHICLES_PER_LANE_KM``: Vehicles on a kilometre of lane at the first step, the ego included.
``plan_counts``: Split a density over the classes.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .demand import TripMaker as TripMaker
    from .demand import lane_km_of as lane_km_of
    from .motions import DECIMALS as DECIMALS
    from .motions import Participant as Participant
    from .motions import drop_infeasible as drop_infeasible
    from .motions import participants as participants
    from .simulation import WARM_UP_S as WARM_UP_S
    from .simulation import simulate_traffic as simulate_traffic
    from .vehicle_counts import FEWEST as FEWEST
    from .vehicle_counts import PAPER_TRIPS as PAPER_TRIPS
    from .vehicle_counts import VEHICLES_PER_LANE_KM as VEHICLES_PER_LANE_KM
    from .vehicle_counts import Demand as Demand
    from .vehicle_counts import plan_counts as plan_counts

__getattr__, __dir__ = lazy_face(__name__, __file__)
