"""A scenario for others: facts with computed features, the description in words, files in the formats of other tools.

``Manoeuvre``: What a road user does on the ego's way, and when.
``manoeuvres_met``: What road users would do on the way of an ego with a planning problem of its own.
``read_facts``: An operation: the facts of one CommonRoad file, for the catalogue.
``describe``: An operation: ego, vehicles and lanelets near the focus of a scenario.
``write_opendrive``: An operation: write the lanelets of a scenario as OpenDRIVE; what is lost, how near the bounds are.
``write_openscenario``: An operation: write the recording of a scenario as OpenSCENARIO XML; what is lost.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .description import describe
    from .exchange.opendrive import write_opendrive
    from .exchange.openscenario import write_openscenario
    from .facts import manoeuvres_met, read_facts
    from .manoeuvres import Manoeuvre

__getattr__, __dir__ = lazy_face(__name__, __file__)
